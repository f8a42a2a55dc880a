"""Laws of the one call where answers form curves: seven joints, straight wrists, targets that leave some freedom."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.errors import PieperError
from pieper.ik import target
from pieper.ik.numeric import solve_numeric
from pieper.ik.solve import solve, solver
from tests.judge import MEASURED, apart, inside, joints, left, poses
from tests.reference import product_of_exponentials as textbook
from tests.robots import ROBOTS, chain

SEVEN = tuple(robot.name for robot in ROBOTS if robot.dof == 7)
SIX = tuple(robot.name for robot in ROBOTS if robot.dof == 6)
WRISTS = tuple(name for name in SIX if solver(chain(name)).family.name == "spherical wrist")


@pytest.mark.parametrize("name", SEVEN)
def test_seven_joints_are_sampled_and_every_answer_gives_its_pose_back(name):
    arm = chain(name)
    wanted = poses(arm, joints(arm, 12, seed=1))
    answers = solve(arm, wanted)
    assert answers.reached.all()
    assert answers.free == 1
    assert not answers.complete.any()
    assert (answers.count > 4).all()
    for k, s in zip(*np.nonzero(answers.valid), strict=True):
        assert max(left(textbook.fk(arm, answers.q[k, s]), wanted[k])) <= MEASURED
    np.testing.assert_array_equal(answers.within_limits[answers.valid], inside(arm, answers.q)[answers.valid])


@pytest.mark.parametrize("name", SEVEN)
def test_a_value_of_the_redundancy_gives_every_answer_for_it(name):
    arm = chain(name)
    q = joints(arm, 12, seed=2)
    held = next(i for i in range(7) if arm.joint_names[i] in solver(arm).info.structure)
    answers = solve(arm, poses(arm, q), redundancy=q[:, held : held + 1])
    assert answers.complete.all()
    assert (np.nanmin(apart(answers.q, q[:, None]), axis=1) < 1e-6).all()
    named = solve(arm, textbook.fk(arm, q[0]), redundancy={arm.joint_names[2]: q[0, 2]})
    assert np.nanmin(apart(named.q, q[0])) < 1e-6


@pytest.mark.parametrize("name", SEVEN)
def test_a_seed_is_stayed_near(name):
    """The first answer is no farther from the seed than the one that grows out of it by iteration."""
    arm = chain(name)
    q = joints(arm, 8, seed=3)
    seeds = np.clip(q + np.random.default_rng(3).normal(scale=0.05, size=q.shape), *arm.limits.T)
    wanted = poses(arm, q)
    answers = solve(arm, wanted, seed=seeds)
    grown = solve_numeric(arm, wanted, seed=seeds)
    distance = np.linalg.norm(answers.q[:, 0] - seeds, axis=1)
    assert (distance <= np.linalg.norm(grown.q[:, 0] - seeds, axis=1) + 1e-9).all()


def test_the_nearest_of_a_whole_curve():
    arm = pieper.load("panda")
    q = joints(arm.chain, 1, seed=4)[0]
    seed = np.clip(q + 0.1, *arm.limits.T)
    T = textbook.fk(arm.chain, q)
    nearest = arm.nearest_ik(T, seed)
    assert max(left(textbook.fk(arm.chain, nearest), T)) <= MEASURED
    assert inside(arm.chain, nearest)
    dense = arm.ik(T, redundancy=np.linspace(*arm.limits[6], 400)[None].ravel())
    sampled = np.linalg.norm(dense.q[dense.within_limits] - seed, axis=1).min()
    assert np.linalg.norm(nearest - seed) <= sampled + 1e-9
    curves = arm.self_motion(T)
    assert any(bool(curve.contains(q)) for curve in curves)


def test_the_nearest_of_six_joints_is_the_nearest_copy():
    arm = pieper.load("ur5e")
    q = joints(arm.chain, 1, seed=5)[0]
    T = arm.fk(q)
    seed = np.array([3.0, -5.0, 1.0, 4.0, 2.0, -6.0])
    copies = np.array(list(arm.ik(T).copies(seed=seed)))
    np.testing.assert_allclose(arm.nearest_ik(T, seed), copies[0], atol=1e-9)
    T[:3, 3] = [9.0, 0.0, 0.0]
    with pytest.raises(PieperError, match=r"no joint values of 'ur5e' to take: out of reach by"):
        arm.nearest_ik(T, seed)


@pytest.mark.parametrize("name", WRISTS)
def test_a_straight_wrist_is_a_curve_with_its_coupling_in_words(name):
    arm = chain(name)
    q = joints(arm, 1, seed=6)[0]
    w4, w5, w6 = arm.screws[3:, 3:]
    q[4] = np.arctan2(-w4 @ np.cross(w5, w6), w4 @ np.cross(w5, np.cross(w5, w6)))
    T = textbook.fk(arm, q)
    curves = solve(arm, T).curves()
    assert curves
    couplings = {curve.coupling for curve in curves}
    names = arm.joint_names
    assert any(names[3] in words and names[5] in words for words in couplings)
    for curve in curves:
        assert curve.closed
        for point in curve.q[:: max(1, len(curve.q) // 7)]:
            assert max(left(textbook.fk(arm, point), T)) <= MEASURED
    assert any(bool(curve.contains(q)) for curve in curves)


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "fanuc_crx10ia"])
def test_regular_poses_have_no_curves(name):
    arm = chain(name)
    assert solve(arm, textbook.fk(arm, joints(arm, 1, seed=7)[0])).curves() == []


@pytest.mark.parametrize("name", SIX)
def test_some_rows_are_met_and_say_how_free_they_leave_the_arm(name):
    arm = chain(name)
    T = textbook.fk(arm, joints(arm, 1, seed=8)[0])
    position = solve(arm, target.ignore_orientation(T[:3, 3]))
    assert position.free == 3
    jaw = solve(arm, target.position_and_axis(T[:3, 3], T[:3, :3] @ [0.6, 0.0, 0.8], axis_tip=[0.6, 0.0, 0.8]))
    assert jaw.free == 1
    for answers in (position, jaw):
        assert answers.reached
        assert answers.count > 4
        for q in answers.q[answers.valid]:
            here = textbook.fk(arm, q)
            assert np.linalg.norm(here[:3, 3] - T[:3, 3]) <= MEASURED
    for q in jaw.q[jaw.valid]:
        axes = textbook.fk(arm, q)[:3, :3] @ [0.6, 0.0, 0.8], T[:3, :3] @ [0.6, 0.0, 0.8]
        assert np.linalg.norm(np.cross(*axes)) <= 1.01e-9
    one = solve(arm, target.ignore_orientation(T[:3, 3]), count=1)
    assert one.q.shape == (1, 6)
    assert one.reached


def test_five_joints_and_one_axis_are_complete():
    arm = chain("so101")
    q = joints(arm, 10, seed=9)
    T = poses(arm, q)
    answers = solve(arm, target.position_and_axis(T[:, :3, 3], T[:, :3, 2]))
    assert answers.free == 0
    assert (np.nanmin(apart(answers.q, q[:, None]), axis=1) < 1e-6).all()


def test_seven_joints_out_of_reach_and_out_of_limits():
    arm = chain("franka_panda")
    far = textbook.fk(arm, joints(arm, 1, seed=10)[0])
    far[:3, 3] *= 20.0
    answers = solve(arm, np.stack([far, textbook.fk(arm, joints(arm, 1, seed=11)[0])]))
    assert answers.reached.tolist() == [False, True]
    assert answers.reasons[0].startswith("out of reach by ")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("ur5e", {"redundancy": 0.3}, "a value of the redundancy is for arms with seven joints"),
        ("franka_panda", {"redundancy": 9.0}, r"9.*panda_joint7|panda_joint7.*9"),
        ("franka_panda", {"redundancy": {"elbow": 0.3}}, "elbow"),
        ("franka_panda", {"redundancy": {"swivel": 0.3}}, "swivel"),
        ("franka_panda", {"samples": 0}, "samples must be a whole number of at least 1, got 0"),
    ],
)
def test_bad_values_of_the_redundancy_are_named(name, options, message):
    arm = chain(name)
    with pytest.raises(PieperError, match=message):
        solve(arm, np.array(arm.home), **options)
