"""The general solver: proved solution sets, random, right-angle and near-singular targets, modes, batches, bad input."""

from __future__ import annotations

import gzip
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pieper.errors import ArrayError, UnknownNameError
from pieper.ik.general_6r import MODES, MOST_SOLUTIONS, Flag, prepare, solve_general_6r
from pieper.ik.numeric import solve_numeric
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain
from tests.reference import determinant_polynomial as reference
from tests.robots import ROBOTS, chain

GOLDEN = Path(__file__).parents[1] / "golden"
ACCURACY = 1e-9  # [m, rad] of every answer
SAME = 1e-6  # rad: a random pose is far enough from singular ones for its joints to come back that well
SAME_SINGULAR = 1e-5  # rad: what rounding leaves of the joints where the Jacobian's least singular value is 1e-3
REGULAR = 1e-3  # least singular value of the Jacobian
SIX_JOINTS = tuple(robot.name for robot in ROBOTS if robot.dof == 6)


def arm_of(links, base=None, name="arm"):
    """The chain ``base Rz(q1) L1 ... Rz(q6) L6``."""
    T = np.eye(4) if base is None else np.array(base)
    screws = []
    for link in links:
        z, p = T[:3, 2], T[:3, 3]
        screws.append(np.concatenate([np.cross(p, z), z]))
        T = T @ np.asarray(link)
    return Chain(name, screws, T, [[-np.pi, np.pi]] * 6, [f"j{i}" for i in range(6)])


@cache
def random_arm(seed):
    rng = np.random.default_rng(seed)
    links = []
    for _ in range(6):
        twist, a, d = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)
        c, s = np.cos(twist), np.sin(twist)
        links.append([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1]])
    return arm_of(links, name=f"random {seed}")


@cache
def oracle():
    with gzip.open(GOLDEN / "ik_oracle.json.gz") as file:
        return json.load(file)


@cache
def oracle_arm(key):
    arm = oracle()["arms"][key]
    return arm_of(arm["links"], arm["base"], arm["name"])


def apart(q, wanted):
    """Largest difference of a joint, modulo whole turns; infinite for rows of NaN."""
    distance = np.abs((q - wanted + np.pi) % (2.0 * np.pi) - np.pi).max(axis=-1)
    return np.where(np.isnan(distance), np.inf, distance)


def unmatched(case, answers):
    """Solutions of a case that are not among the answers, and answers that are none of them."""
    q = answers.q[answers.valid]
    left = list(range(len(q)))
    missing = 0
    for solution in case["solutions"]:
        near = [k for k in left if apart(q[k], solution["q"]) <= 1e-9 + 100.0 * solution["bound"]]
        if near:
            left.remove(near[0])
        else:
            missing += 1
    return missing, len(left)


@pytest.mark.parametrize("mode", MODES)
def test_every_proved_solution_and_no_other(mode, instruction_set):
    wrong = {}
    for case in oracle()["cases"]:
        answers = solve_general_6r(oracle_arm(case["arm"]), case["pose"], mode=mode)
        assert np.nanmax(answers.position_error, initial=0.0) < ACCURACY, case["id"]
        assert np.nanmax(answers.rotation_error, initial=0.0) < ACCURACY, case["id"]
        missing, surplus = unmatched(case, answers)
        if not case["ill_conditioned"] and (missing or surplus):
            wrong[case["id"]] = (missing, surplus, Flag(int(answers.flags)))
    assert not wrong


def test_ill_conditioned_solutions_are_found_where_the_mode_looks_twice():
    for case in oracle()["cases"]:
        if case["ill_conditioned"]:
            missing, _ = unmatched(case, solve_general_6r(oracle_arm(case["arm"]), case["pose"], mode="checked"))
            assert missing == 0, case["id"]


def test_poses_with_multiple_roots_are_answered():
    for case in oracle()["multiple"]:
        answers = solve_general_6r(oracle_arm(case["arm"]), case["pose"])
        assert answers.count > 0, case["id"]
        assert np.nanmax(answers.position_error) < ACCURACY


@pytest.mark.parametrize("name", [*SIX_JOINTS, *(f"random {seed}" for seed in range(4))])
def test_generating_joints_are_among_the_answers(name, instruction_set):
    arm = random_arm(int(name.split()[1])) if name.startswith("random") else chain(name)
    q = np.random.default_rng(11).uniform(-np.pi, np.pi, (500, 6))
    answers = solve_general_6r(arm, fk(arm, q), mode="fast")
    assert (apart(answers.q, q[:, None]).min(axis=1) < SAME).all()
    assert np.nanmax(answers.position_error) < ACCURACY
    assert np.nanmax(answers.rotation_error) < ACCURACY


@pytest.mark.parametrize("name", SIX_JOINTS)
@pytest.mark.parametrize("step", [np.pi / 2, np.pi / 4, 0.5])
def test_targets_of_right_angles(name, step):
    arm = chain(name)
    rng = np.random.default_rng(9)
    for disturbance in (0.0, 1e-10, 1e-6):
        q = rng.integers(-6, 7, (60, 6)) * step + disturbance * rng.normal(size=(60, 6))
        answers = solve_general_6r(arm, fk(arm, q), mode="fast")
        assert answers.valid.any(axis=1).all()
        assert np.nanmax(answers.position_error) < ACCURACY
        regular = np.linalg.svd(jacobian(arm, q), compute_uv=False)[:, -1] > REGULAR
        assert (apart(answers.q, q[:, None]).min(axis=1)[regular] < SAME_SINGULAR).all()


@pytest.mark.parametrize("name", ["puma560", "kuka_kr210_robond", "ur5e", "fanuc_crx10ia"])
@pytest.mark.parametrize("joint", [2, 4])
@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8, 1e-12])
def test_answers_near_wrist_and_elbow_singularities(name, joint, distance):
    arm = chain(name)
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (50, 6))
    q[:, joint] = distance
    answers = solve_general_6r(arm, fk(arm, q), mode="fast")
    assert answers.valid.any(axis=1).all()
    assert np.nanmax(answers.position_error) < ACCURACY


@pytest.mark.parametrize("name", ["ur5e", "puma560", "fanuc_crx10ia"])
def test_nothing_is_found_out_of_reach(name):
    arm = chain(name)
    T = fk(arm, np.random.default_rng(4).uniform(-np.pi, np.pi, (100, 6)))
    T[:, :3, 3] *= 20.0 / np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True)
    assert not solve_general_6r(arm, T).valid.any()


@pytest.mark.parametrize("name", ["fanuc_crx10ia", "ufactory_xarm6", "kinova_gen3_6dof"])
def test_numeric_answers_are_among_them(name):
    arm = chain(name)
    T = fk(arm, np.random.default_rng(5).uniform(-2.0, 2.0, (10, 6)))
    all_of_them = solve_general_6r(arm, T).q
    numeric = solve_numeric(arm, T, count=4, restarts=64)
    for some, every in zip(numeric.q, all_of_them, strict=True):
        for q in some[~np.isnan(some[:, 0])]:
            assert apart(every, q).min() < SAME


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_determinant_is_a_trigonometric_polynomial_of_degree_8(seed):
    arm = random_arm(seed)
    T = fk(arm, [0.4, -0.9, 1.3, 0.2, -0.7, 2.1])
    answers = solve_general_6r(arm, T)
    for joint in range(6):
        beyond = np.abs(reference.spectrum(arm, T, joint))
        beyond[reference.SAMPLES // 2 - 8 : reference.SAMPLES // 2 + 9] = 0.0
        assert beyond.max() < 1e-11  # rounding of 12x12 determinants
        expected = np.sort(answers.q[answers.valid][:, joint])
        found = reference.roots(arm, T, joint)
        assert len(found) == len(expected)
        assert np.abs((found - expected + np.pi) % (2 * np.pi) - np.pi).max() < 1e-7  # companion matrix


def test_harmonics_are_measured():
    first = {
        name: next(r for r in prepare(chain(name)).native.reports if r.rank == 0)
        for name in ("kuka_kr210_robond", "ur5e")
    }
    assert first["kuka_kr210_robond"].remaining_joint == 5
    assert first["kuka_kr210_robond"].even
    assert first["kuka_kr210_robond"].harmonics == 2
    assert first["ur5e"].remaining_joint == 1
    assert first["ur5e"].harmonics == 4


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_batch_shapes(shape):
    arm = chain("ufactory_xarm6")
    T = np.broadcast_to(fk(arm, [0.1, -0.5, -0.7, 0.4, 0.9, 0.3]), (*shape, 4, 4))
    answers = solve_general_6r(arm, T)
    assert answers.q.shape == (*shape, MOST_SOLUTIONS, 6)
    assert answers.valid.shape == answers.position_error.shape == answers.rotation_error.shape == (*shape, 16)
    assert answers.flags.shape == answers.count.shape == shape
    assert answers.valid.any(axis=-1).all()
    assert np.isnan(answers.q[~answers.valid]).all()


def test_answers_do_not_depend_on_order_or_threads():
    arm = chain("fanuc_crx10ia")
    rng = np.random.default_rng(6)
    T = fk(arm, rng.uniform(-np.pi, np.pi, (300, 6)))
    together = solve_general_6r(arm, T)
    order = rng.permutation(300)
    np.testing.assert_array_equal(solve_general_6r(arm, T[order], threads=3).q, together.q[order])
    np.testing.assert_array_equal(solve_general_6r(arm, T[17]).q, together.q[17])


def test_list_input_and_rotations_typed_to_ten_digits():
    arm = chain("ufactory_xarm6")
    T = fk(arm, [0.1, -0.5, -0.7, 0.4, 0.9, 0.3])
    exact = solve_general_6r(arm, T)
    rounded = solve_general_6r(arm, np.round(T, 11).tolist())
    assert rounded.count == exact.count
    assert np.nanmax(np.abs(rounded.q - exact.q)) < 1e-7


def test_bad_input():
    arm = chain("ur5e")
    T = np.eye(4)
    with pytest.raises(ArrayError, match=r"T_base_tip must have shape \(..., 4, 4\), got \(3, 4\)"):
        solve_general_6r(arm, T[:3])
    with pytest.raises(ArrayError, match="T_base_tip"):
        solve_general_6r(arm, np.full((4, 4), np.nan))
    with pytest.raises(ArrayError, match="rotation"):
        solve_general_6r(arm, np.diag([2.0, 2.0, 2.0, 1.0]))
    with pytest.raises(ArrayError, match="threads must be a whole number of at least 1, got 0"):
        solve_general_6r(arm, T, threads=0)
    with pytest.raises(UnknownNameError, match="did you mean 'fast'"):
        solve_general_6r(arm, T, mode="fasst")
    with pytest.raises(
        ArrayError, match=r"takes six joints, all revolute or one of them prismatic, .* has 7 axes, 7 of them revolute"
    ):
        solve_general_6r(chain("franka_panda"), T)


def test_hostile_arms_give_no_false_answer():
    line = np.eye(4)
    shifted = np.eye(4)
    shifted[0, 3] = 0.3
    for links in ([line] * 6, [shifted] * 6, [line, shifted] * 3):
        arm = arm_of(links)
        q = np.random.default_rng(8).uniform(-np.pi, np.pi, (5, 6))
        answers = solve_general_6r(arm, fk(arm, q))
        assert np.nanmax(answers.position_error, initial=0.0) < ACCURACY
        assert np.nanmax(answers.rotation_error, initial=0.0) < ACCURACY
