"""Laws of the one call for inverse kinematics, over every built-in robot whose answers can all be listed.

The judge is the textbook product of exponentials with a measure of its own, so that solver and judge share no code.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pieper.errors import PieperError
from pieper.ik import select
from pieper.ik.solutions import Status
from pieper.ik.solve import solve, solver
from pieper.kinematics.jacobian import jacobian
from pieper.kinematics.joints import periodic_joints
from pieper.model.chain import Chain
from tests.judge import MEASURED, apart, inside, joints, left, poses
from tests.reference import product_of_exponentials as textbook
from tests.robots import ROBOTS, chain

SAME = 1e-6  # [rad] well-conditioned answers are found to about 1e-12, those near folds to the root of rounding
AWAY = 0.03  # least singular value of the Jacobian; a step changes it by less
POSES = 40
TURN = 2.0 * np.pi
NAMES = tuple(robot.name for robot in ROBOTS if robot.dof < 7)
CLOSED = tuple(name for name in NAMES if solver(chain(name)).method == "closed form")
NAMED = tuple(name for name in CLOSED if not solver(chain(name)).family.quartic)


@pytest.mark.parametrize("name", NAMES)
def test_recall_the_joints_that_made_a_pose_are_among_its_answers(name, instruction_set):
    arm = chain(name)
    q = joints(arm, POSES, seed=1)
    answers = solve(arm, poses(arm, q))
    assert (answers.status == Status.reached).all()
    assert answers.complete.all()
    assert (np.nanmin(apart(answers.q, q[:, None]), axis=1) < SAME).all(), instruction_set


@pytest.mark.parametrize("name", NAMES)
def test_accuracy_every_answer_gives_its_pose_back(name):
    arm = chain(name)
    wanted = poses(arm, joints(arm, POSES, seed=2))
    answers = solve(arm, wanted)
    for k, s in zip(*np.nonzero(answers.valid), strict=True):
        distance, angle = left(textbook.fk(arm, answers.q[k, s]), wanted[k])
        assert max(distance, angle) <= MEASURED
        assert abs(distance - answers.position_error[k, s]) < 1e-13
        assert abs(angle - answers.rotation_error[k, s]) < 1e-13
    for values in (answers.q, answers.position_error, answers.rotation_error, answers.limit_margin):
        assert np.isnan(values[~answers.valid]).all()
    assert np.median(answers.position_error[answers.valid]) < 1e-13
    for found in np.split(answers.q, POSES):
        listed = found[0][~np.isnan(found[0]).any(axis=1)]
        for a, b in itertools.combinations(listed, 2):
            assert apart(a, b) > SAME, "each answer is listed once"


@pytest.mark.parametrize("name", NAMES)
def test_answers_inside_limits_come_first_and_say_so(name):
    arm = chain(name)
    lower, upper = arm.limits.T
    bounded = np.isfinite(arm.limits).all(axis=1)
    middle = np.where(bounded, np.where(bounded[:, None], arm.limits, 0.0).mean(axis=1), 0.0)
    q = middle + np.clip(upper - lower, 0.0, TURN) * np.random.default_rng(3).uniform(-0.7, 0.7, (POSES, arm.dof))
    answers = solve(arm, poses(arm, q))
    assert answers.valid.any(axis=1).all()
    np.testing.assert_array_equal(answers.within_limits[answers.valid], inside(arm, answers.q)[answers.valid])
    np.testing.assert_array_equal(answers.limit_margin[answers.valid] >= 0.0, answers.within_limits[answers.valid])
    assert (np.diff(answers.within_limits.astype(int), axis=1) <= 0).all()
    assert (np.diff(answers.valid.astype(int), axis=1) <= 0).all()
    # an answer is called outside only when no copy of it is inside
    for a in answers.q[answers.valid & ~answers.within_limits]:
        bounded = periodic_joints(arm) & np.isfinite(lower)
        lowest = np.where(bounded, a - TURN * np.floor((a - np.where(bounded, lower, 0.0)) / TURN), a)
        assert not inside(arm, lowest)
    for k in range(POSES):
        if not answers.within_limits[k].any():
            assert answers.status[k] == Status.outside_limits
            assert answers.reasons[k].startswith("reachable, but every solution violates ")


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_sorts_answers_and_chooses_copies(name):
    arm = chain(name)
    q = joints(arm, POSES, seed=4)
    seeds = joints(arm, POSES, seed=5)
    wanted = poses(arm, q)
    answers = solve(arm, wanted, seed=seeds)
    distance = np.linalg.norm(answers.q - seeds[:, None], axis=-1)
    for k in range(POSES):
        for mask in (answers.within_limits[k], answers.valid[k] & ~answers.within_limits[k]):
            assert (np.diff(distance[k, mask]) >= 0.0).all()
    within = select.within_limits(solve(arm, wanted))
    np.testing.assert_allclose(answers.q[:, 0], select.nearest(within, seeds), atol=1e-12)
    again = solve(arm, wanted, seed=q)  # where the arm is already
    assert (np.abs(again.q[:, 0] - q).max(axis=1) < SAME).all()


@pytest.mark.parametrize("name", NAMES)
def test_joints_at_their_limits_are_inside(name):
    arm = chain(name)
    q = joints(arm, POSES, seed=6)
    side = np.random.default_rng(7).integers(0, 3, q.shape)
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    q = np.where(side == 0, lower, np.where(side == 1, upper, q))
    answers = solve(arm, poses(arm, q), seed=q)
    assert answers.reached.all()
    assert inside(arm, answers.q[:, 0]).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_equals_its_parts_in_any_order_and_on_any_thread(name):
    arm = chain(name)
    wanted = poses(arm, joints(arm, 24, seed=8))
    wanted[::9, :3, 3] *= 5.0  # out of reach
    seeds = joints(arm, 24, seed=9)
    whole = solve(arm, wanted, seed=seeds)
    order = np.random.default_rng(10).permutation(24)
    shuffled = solve(arm, wanted[order], seed=seeds[order])
    threaded = solve(arm, np.tile(wanted, (400, 1, 1)), seed=np.tile(seeds, (400, 1)), threads=3)
    for field in ("q", "valid", "position_error", "rotation_error", "status", "branch", "within_limits", "complete"):
        np.testing.assert_array_equal(getattr(shuffled, field), getattr(whole, field)[order])
        np.testing.assert_array_equal(getattr(threaded, field)[-24:], getattr(whole, field))
    for k in (0, 1, 23):
        np.testing.assert_array_equal(solve(arm, wanted[k], seed=seeds[k]).q, whole.q[k])
    folded = solve(arm, wanted.reshape(2, 3, 4, 4, 4), seed=seeds.reshape(2, 3, 4, -1))
    np.testing.assert_array_equal(folded.q.reshape(whole.q.shape), whole.q)
    assert folded.status.shape == (2, 3, 4)
    assert solve(arm, np.empty((0, 4, 4))).q.shape[0] == 0


@pytest.mark.parametrize("name", NAMES)
def test_out_of_reach_is_a_result_with_the_nearest_pose(name):
    arm = chain(name)
    wanted = poses(arm, joints(arm, 6, seed=11))
    wanted[::2, :3, 3] *= 10.0 / np.linalg.norm(wanted[::2, :3, 3], axis=1, keepdims=True)  # no arm is that long
    answers = solve(arm, wanted)
    assert (answers.status[::2] == Status.unreachable).all()
    assert not answers.valid[::2].any()
    assert answers.reached[1::2].all()
    near = answers.nearest
    np.testing.assert_array_equal(np.isnan(near.q).all(axis=1), answers.reached)
    for k in range(0, 6, 2):
        assert inside(arm, near.q[k])
        distance, angle = left(textbook.fk(arm, near.q[k]), wanted[k])
        assert abs(distance - near.position_error[k]) < 1e-12
        assert abs(angle - near.rotation_error[k]) < 1e-12
        assert answers.reasons[k].startswith(f"out of reach by {near.out_of_reach[k]:.3g} m")
    assert answers.nearest is near


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia", "kuka_youbot", "franka_panda"])
def test_a_row_that_is_no_pose_is_marked_and_the_others_are_solved(name):
    arm = chain(name)
    good = poses(arm, joints(arm, 6, seed=12))
    bad = good.copy()
    bad[1, 0, 0] = np.nan
    bad[3, :3, :3] *= 1.001
    bad[4, 3, 3] = 2.0
    seeds = joints(arm, 6, seed=13)
    answers, wanted = solve(arm, bad, seed=seeds), solve(arm, good, seed=seeds)
    assert answers.status.tolist() == [Status.malformed if k in (1, 3, 4) else Status.reached for k in range(6)]
    for k in (0, 2, 5):
        np.testing.assert_array_equal(answers.q[k], wanted.q[k])
    for k, words in ((1, "row 1 of the batch is no pose: T_base_tip must be finite"), (3, "deviates"), (4, "last row")):
        assert words in answers.reasons[k]
        assert np.isnan(answers.q[k]).all()
        assert not answers.valid[k].any()
        assert not answers.complete[k]
    assert np.isnan(answers.nearest.q[[1, 3, 4]]).all()
    assert str(answers) == "3 of 6 targets reached"


@pytest.mark.parametrize("name", NAMED)
def test_branches_of_a_pose_differ_and_stay_along_a_path(name):
    """Joints move a little; an answer that moves with them keeps its label while it keeps away from singular poses."""
    arm = chain(name)
    rng = np.random.default_rng(14)
    moved = 0
    wrist = np.eye(4)  # a point on axis 4, and on axis 5 where they meet
    wrist[:3, 3] = np.cross(arm.screws[4, 3:], arm.screws[4, :3])
    wrist[:3, 3] += arm.screws[4, 3:] * (
        arm.screws[4, 3:] @ (np.cross(arm.screws[3, 3:], arm.screws[3, :3]) - wrist[:3, 3])
    )
    shoulder = Chain("wrist", arm.screws[:3], wrist, arm.limits[:3], arm.joint_names[:3])
    for q in joints(arm, 12, seed=14):
        step = rng.normal(size=arm.dof)
        path = q + np.linspace(0.0, 0.3, 31)[:, None] * step / np.linalg.norm(step)
        answers = solve(arm, poses(arm, path))
        for k in range(len(path)):
            labels = answers.labels[k][answers.valid[k]]
            assert len(set(labels)) == len(labels)
            assert "" not in labels
        for k in range(len(path) - 1):
            now, then = answers.q[k][answers.valid[k]], answers.q[k + 1][answers.valid[k + 1]]
            if len(now) != len(then):
                continue  # a branch appears or ends between them
            distance = apart(now[:, None], then[None])
            partner = distance.argmin(axis=1)
            # sure of who is who: everybody moves far less than they are apart, and none passes a singular pose
            others = np.array([np.delete(row, p).min(initial=np.inf) for row, p in zip(distance, partner, strict=True)])
            regular = np.linalg.svd(jacobian(arm, now), compute_uv=False)[:, -1] > AWAY
            if arm.dof == 5:  # from front to back above axis 1, which is no singular pose of five joints
                over = jacobian(shoulder, now[:, :3])[:, :3]
                regular &= np.linalg.svd(over, compute_uv=False)[:, -1] > AWAY
            sure = (distance.min(axis=1) < 0.2 * others) & regular
            same = answers.labels[k][answers.valid[k]] == answers.labels[k + 1][answers.valid[k + 1]][partner]
            assert same[sure].all()
            moved += sure.sum()
    assert moved > 300


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "so101"])
def test_copies_are_all_copies_nearest_first(name):
    arm = chain(name)
    rng = np.random.default_rng(15)
    lower, upper = arm.limits.T
    for q in joints(arm, 3, seed=15):
        answers = solve(arm, textbook.fk(arm, q))
        seed = rng.uniform(lower, upper)
        copies = np.array(list(answers.copies(seed=seed)))
        expected = []
        for a in answers.q[answers.valid]:
            values = [
                [x + TURN * k for k in range(-3, 4) if lower[i] <= x + TURN * k <= upper[i]] for i, x in enumerate(a)
            ]
            expected += list(itertools.product(*values))
        assert len(copies) == len(expected)
        distance = np.linalg.norm(copies - seed, axis=1)
        assert (np.diff(distance) >= -1e-12).all()
        order = np.lexsort(np.round(copies, 9).T)
        wanted = np.array(expected)
        np.testing.assert_allclose(copies[order], wanted[np.lexsort(np.round(wanted, 9).T)], atol=1e-9)


def test_copies_of_continuous_joints_are_not_multiplied():
    arm = chain("franka_panda")
    free = Chain(arm.name, arm.screws, arm.home, [[-np.inf, np.inf]] * 7, arm.joint_names)
    q = joints(arm, 1, seed=16)[0]
    answers = solve(free, textbook.fk(arm, q), seed=q, method="numeric")
    (only,) = answers.copies(seed=q + TURN)
    np.testing.assert_allclose(only, answers.q[0] + TURN)


@pytest.mark.parametrize("name", NAMES)
def test_limits_decide_what_is_said(name):
    """One joint is allowed only where no answer has it."""
    arm = chain(name)
    q = joints(arm, 1, seed=17)[0]
    T = textbook.fk(arm, q)
    found = solve(arm, T)
    values = np.sort(np.remainder(found.q[found.valid][:, 0], TURN))
    gaps = np.diff(np.append(values, values[0] + TURN))
    widest = int(np.argmax(gaps))
    middle = values[widest] + 0.5 * gaps[widest]
    limits = np.array(arm.limits)
    limits[0] = np.remainder(middle + np.pi, TURN) - np.pi + np.array([-0.1, 0.1]) * gaps[widest]
    limits[1:] = [-np.inf, np.inf]
    held = Chain(arm.name, arm.screws, arm.home, limits, arm.joint_names)
    answers = solve(held, T)
    assert answers.status == Status.outside_limits
    assert answers.count == found.count
    assert not answers.reached
    away = np.degrees(0.4 * gaps[widest])
    assert answers.reason == (
        f"reachable, but every solution violates {arm.joint_names[0]}: nearest limit {away:.3g} deg away"
    )
    assert answers.nearest.position_error + answers.nearest.rotation_error > 0.0


@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia"])
def test_options(name):
    arm = chain(name)
    q = joints(arm, 1, seed=18)[0]
    T = textbook.fk(arm, q)
    every = solve(arm, T)
    first = solve(arm, T, count=2)
    np.testing.assert_array_equal(first.q, every.q[:2])
    general = solve(arm, T, method="general")
    numeric = solve(arm, T, method="numeric", seed=q)
    assert general.count == every.count
    assert apart(numeric.q[0], q) < SAME
    assert not numeric.complete
    assert solve(arm, T.tolist()).count == every.count
    from pieper.ik.target import pose

    np.testing.assert_array_equal(solve(arm, pose(T)).q, every.q)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "no method 'magic'"),
        ({"mode": "slow"}, "no mode 'slow'"),
        ({"count": 0}, "count must be a whole number of at least 1, got 0"),
        ({"threads": 0}, "threads must be a whole number of at least 1, got 0"),
        ({"position_tolerance": -1.0}, "tolerances must be positive numbers"),
        ({"seed": [0.0] * 5}, r"seed must have shape \(..., 6\), got \(5,\)"),
        ({"seed": [np.nan] * 6}, "seed must be finite"),
    ],
)
@pytest.mark.parametrize("name", ["ur5e", "fanuc_crx10ia"])
def test_bad_options_are_named(name, options, message):
    arm = chain(name)
    with pytest.raises(PieperError, match=message):
        solve(arm, np.array(arm.home), **options)


def test_a_method_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"has no closed form: no three axes meet"):
        solve(chain("fanuc_crx10ia"), np.array(chain("fanuc_crx10ia").home), method="closed form")
    with pytest.raises(ValueError, match=r"the general solver takes six joints"):
        solve(chain("kuka_youbot"), np.array(chain("kuka_youbot").home), method="general")


def test_a_loose_tolerance_reaches_what_is_just_out_of_reach():
    arm = chain("ur5e")
    T = textbook.fk(arm, [0.3, -0.2, 0.1, 0.4, 0.5, 0.6])
    outward = np.array([*T[:2, 3], 0.0]) / np.hypot(*T[:2, 3])
    near, far = 0.0, 2.0
    while far - near > 1e-6:
        middle = 0.5 * (near + far)
        there = T.copy()
        there[:3, 3] += middle * outward
        near, far = (middle, far) if solve(arm, there).reached else (near, middle)
    T[:3, 3] += (near + 1e-4) * outward
    tight = solve(arm, T)
    assert tight.status == Status.unreachable
    assert tight.complete
    loose = solve(arm, T, position_tolerance=1e-3, rotation_tolerance=1e-2)
    assert loose.reached
    assert left(textbook.fk(arm, loose.q[0]), T)[0] <= 1e-3
