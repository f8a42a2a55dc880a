"""Closed forms: every branch, on every arm that has one, at random, singular, aligned and unreachable poses."""

from __future__ import annotations

import gzip
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pieper._native import kernels
from pieper.errors import ArrayError
from pieper.ik.closed_form import ClosedFormSolutions, solve_closed_form
from pieper.ik.family import Family, find_family
from pieper.ik.numeric import solve_numeric
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain
from pieper.spatial.rotation import from_quaternion
from pieper.spatial.twist import exp
from tests.ik.test_family import FIVE_JOINTS, THREE_PARALLEL, WRIST, backwards, disturbed
from tests.robots import chain

GOLDEN = Path(__file__).parents[1] / "golden"
SIX_JOINTS = (*WRIST, *THREE_PARALLEL)
ARMS = (*SIX_JOINTS, *FIVE_JOINTS)
ACCURACY = 1e-9  # [m and rad], what is promised; rounding leaves 1e-14
SAME = 1e-6  # [rad] joint values of one answer; rounding of a random pose moves an answer by 1e-9 at most


@cache
def family(name: str, nominal: bool = False) -> Family:
    return find_family(chain(name, nominal))


def apart(a: Any, b: Any) -> np.ndarray:
    """The largest difference of joint angles, full turns aside."""
    return np.abs(np.remainder(np.asarray(a) - b + np.pi, 2 * np.pi) - np.pi).max(axis=-1)


def found(answers: ClosedFormSolutions, q: np.ndarray, within: float = SAME) -> np.ndarray:
    """(...) mask: whether joint values q are among the answers."""
    return np.any(answers.valid & (apart(answers.q, q[..., None, :]) < within), axis=-1)


def check_accuracy(answers: ClosedFormSolutions, arm: Chain, T: np.ndarray, limit: float = ACCURACY) -> None:
    """Every answer is as good as it says, measured here again."""
    q = answers.q[answers.valid]
    target = np.broadcast_to(T[..., None, :, :], (*answers.valid.shape, 4, 4))[answers.valid]
    if len(q):
        assert np.abs(fk(arm, q) - target).max() < limit
    assert np.isnan(answers.q[~answers.valid]).all()
    assert np.isnan(answers.position_error[~answers.valid]).all()
    assert (answers.position_error[answers.valid] <= limit).all()
    assert (answers.rotation_error[answers.valid] <= limit).all()
    assert (np.abs(q) <= np.pi).all()


# Random poses


@pytest.mark.parametrize("name", ARMS)
def test_recall_on_random_poses(name, instruction_set):
    arm = chain(name)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (5000, arm.dof))
    assert found(solve_closed_form(arm, family(name), fk(arm, q)), q).all()


@pytest.mark.parametrize("name", ARMS)
def test_accuracy_on_random_poses(name, instruction_set):
    arm = chain(name)
    T = fk(arm, np.random.default_rng(1).uniform(-np.pi, np.pi, (5000, arm.dof)))
    check_accuracy(solve_closed_form(arm, family(name), T), arm, T, 1e-13)


@pytest.mark.parametrize("name", SIX_JOINTS)
def test_answers_are_distinct(name):
    arm = chain(name)
    answers = solve_closed_form(arm, family(name), fk(arm, np.random.default_rng(2).uniform(-3, 3, (300, 6))))
    for q, valid in zip(answers.q, answers.valid, strict=True):
        several = q[valid]
        gaps = apart(several[:, None], several[None]) + 10 * np.eye(len(several))
        assert gaps.min(initial=10.0) > 1e-7


@pytest.mark.parametrize("name", ARMS)
def test_every_instruction_set_gives_the_same_answers(name):
    arm = chain(name)
    T = fk(arm, np.random.default_rng(3).uniform(-np.pi, np.pi, (500, arm.dof)))
    before = kernels.instruction_set()
    try:
        results = []
        for one in kernels.instruction_sets():
            kernels.use_instruction_set(one)
            results.append(solve_closed_form(arm, family(name), T))
    finally:
        kernels.use_instruction_set(before)
    for other in results[1:]:
        assert (other.valid == results[0].valid).all()  # branch by branch
        assert apart(other.q[other.valid], results[0].q[other.valid]).max() < 1e-8


@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond"])
def test_branches_keep_their_place_along_a_path(name):
    arm = chain(name)
    start, end = np.array([0.3, -0.9, 0.8, 0.5, 0.9, -0.4]), np.array([0.5, -0.7, 1.1, 0.7, 1.2, 0.1])
    q = start + np.linspace(0, 1, 400)[:, None] * (end - start)
    answers = solve_closed_form(arm, family(name), fk(arm, q))
    place = np.argmin(apart(answers.q, q[:, None]) + 10 * ~answers.valid, axis=-1)
    assert (place == place[0]).all()


# Aligned and singular poses


@pytest.mark.parametrize("step", [np.pi / 2, np.pi / 4, 0.5])
@pytest.mark.parametrize("name", ARMS)
def test_grid_poses(name, step, instruction_set):
    arm = chain(name)
    q = np.random.default_rng(5).integers(-8, 9, (1500, arm.dof)) * step
    T = fk(arm, q)
    answers = solve_closed_form(arm, family(name), T)
    assert answers.valid.any(axis=-1).all()
    check_accuracy(answers, arm, T)
    if arm.dof == 6:  # where the pose has isolated answers, the generating one is among them
        regular = np.linalg.svd(jacobian(arm, q), compute_uv=False)[:, -1] > 1e-4
        assert found(answers, q)[regular].all()
    else:
        assert found(answers, q).all()


def on_singularity(name: str, kind: str, count: int) -> tuple[np.ndarray, int]:
    """Joint values at a singularity, and the joint that leads away from it; found by bisection on the determinant."""
    arm = chain(name)
    rng = np.random.default_rng(6)
    if kind == "wrist":
        q = rng.uniform(-np.pi, np.pi, (count, 6))
        q[:, 4] = rng.choice([0.0, np.pi], count)
        return q, 4
    joint = {"elbow": 2, "shoulder": 1}[kind]
    q = rng.uniform(-np.pi, np.pi, (20 * count, 6))
    low, high = q.copy(), q.copy()
    high[:, joint] += 0.5

    def determinant(at: np.ndarray) -> np.ndarray:
        return np.linalg.det(jacobian(arm, at))

    crossing = np.flatnonzero(determinant(low) * determinant(high) < 0)[:count]
    low, high = low[crossing], high[crossing]
    sign = np.sign(determinant(low))
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = (np.sign(determinant(middle)) == sign)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    assert len(low) > 10
    return low, joint


@pytest.mark.parametrize("kind", ["wrist", "elbow", "shoulder"])
@pytest.mark.parametrize("name", SIX_JOINTS)
def test_near_singular_poses(name, kind):
    arm = chain(name)
    at, joint = on_singularity(name, kind, 60)
    exactly = solve_closed_form(arm, family(name), fk(arm, at))
    assert exactly.valid.any(axis=-1).all()
    for distance in 10.0 ** -np.arange(2, 13):
        q = at.copy()
        q[:, joint] += distance
        T = fk(arm, q)
        answers = solve_closed_form(arm, family(name), T)
        assert answers.valid.any(axis=-1).all(), distance
        check_accuracy(answers, arm, T)
        if distance >= 0.99e-8:  # nearer than that, rounding of the pose decides where on the curve an answer lies
            assert found(answers, q, within=1e-2).all(), distance


# Out of reach


@pytest.mark.parametrize("name", SIX_JOINTS)
def test_poses_far_away_have_no_answer(name):
    arm = chain(name)
    T = fk(arm, np.random.default_rng(7).uniform(-np.pi, np.pi, (200, 6)))
    T[:, :3, 3] += 10.0
    assert not solve_closed_form(arm, family(name), T).valid.any()


def stretched(arm: Chain) -> tuple[float, float]:
    """The joint 3 at which the wrist centre is farthest from axis 2, and how far [rad, m]; its square is a sine wave."""
    square = [
        float(np.sum(wrist_distance(arm, np.array([0, 0, q3, 0, 0, 0.0])) ** 2)) for q3 in (0.0, np.pi / 2, np.pi)
    ]
    mean, cosine = (square[0] + square[2]) / 2, (square[0] - square[2]) / 2
    sine = square[1] - mean
    return float(np.arctan2(sine, cosine)), float(np.sqrt(mean + np.hypot(sine, cosine)))


@pytest.mark.parametrize(("beyond", "reached"), [(-1e-6, True), (-1e-3, True), (1e-6, False), (1e-3, False)])
@pytest.mark.parametrize("name", ["kuka_kr210_robond", "yaskawa_mh12", "puma560", "abb_irb120"])
def test_the_boundary_of_the_workspace_is_sharp(name, beyond, reached):
    arm = chain(name)
    q3, _ = stretched(arm)
    q = np.random.default_rng(19).uniform(-2, 2, (30, 6))
    q[:, 2] = q3
    T = fk(arm, q)
    for k in range(len(q)):  # outwards, along the stretched arm
        out = wrist_distance(arm, q[k])
        T[k, :3, 3] += beyond * out / np.linalg.norm(out)
    answers = solve_closed_form(arm, family(name), T)
    as_it_stands = answers.valid & (apart(answers.q[..., :1], q[:, None, :1]) < 1e-2)
    assert (as_it_stands.any(axis=-1) == reached).all()


def exp_product(screws: np.ndarray, q: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    for screw, angle in zip(screws, q, strict=True):
        T = T @ exp(screw * angle)
    return T


def wrist_centre(screws: np.ndarray) -> np.ndarray:
    w, p = screws[3:, 3:], np.cross(screws[3:, 3:], screws[3:, :3])
    across = np.eye(3) - w[:, :, None] * w[:, None, :]
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, p))


# Rounded, calibrated and mirrored arms


@pytest.mark.parametrize("size", [1e-8, 1e-7, 1e-6])
@pytest.mark.parametrize("name", ["ur5e", "kuka_kr210_robond", "puma560", "so101"])
def test_rounded_arms_are_solved_as_they_are(name, size):
    arm = disturbed(chain(name), size, size)
    rounded = find_family(arm)
    assert rounded.level == "rounded"
    q = np.random.default_rng(8).uniform(-np.pi, np.pi, (3000, arm.dof))
    T = fk(arm, q)
    answers = solve_closed_form(arm, rounded, T)
    check_accuracy(answers, arm, T)
    # beside folds of the ideal arm answers may be lost; such poses are called doubtful, and no others lose any
    assert (found(answers, q, within=1e-5) | answers.doubtful).all()
    assert answers.doubtful.mean() < 300 * np.sqrt(size)
    assert found(answers, q, within=1e-5).mean() > 0.985


def test_hardly_anything_is_doubtful_at_the_exact_level():
    arm = chain("ur5e")
    q = np.random.default_rng(20).uniform(-np.pi, np.pi, (100000, 6))
    assert solve_closed_form(arm, family("ur5e"), fk(arm, q)).doubtful.mean() < 2e-4  # 4e-5 measured
    grid = np.random.default_rng(20).integers(-1, 3, (500, 6)) * (np.pi / 2)  # most of them singular
    assert solve_closed_form(arm, family("ur5e"), fk(arm, grid)).doubtful.mean() < 0.2


@pytest.mark.parametrize("name", ARMS)
def test_mirrored_arms(name):
    arm = backwards(chain(name))
    q = np.random.default_rng(9).uniform(-np.pi, np.pi, (1000, arm.dof))
    T = fk(arm, q)
    answers = solve_closed_form(arm, find_family(arm), T)
    assert found(answers, q).all()
    check_accuracy(answers, arm, T, 1e-13)


@pytest.mark.parametrize("locked", ["joint7", "joint1"])
def test_locked_seven_joint_arms(locked):
    arm = chain("kuka_iiwa14")
    arm = arm.lock(**{arm.joint_names[6 if locked == "joint7" else 0]: 0.3})
    here = find_family(arm)
    assert here.has_closed_form
    assert here.level == "exact"
    q = np.random.default_rng(10).uniform(-np.pi, np.pi, (1000, 6))
    assert found(solve_closed_form(arm, here, fk(arm, q)), q).all()


# Truth from elsewhere


@cache
def oracle() -> dict[str, Any]:
    with gzip.open(GOLDEN / "ik_oracle.json.gz", "rt", encoding="utf-8") as file:
        data: dict[str, Any] = json.load(file)
    return data


def oracle_chain(arm: dict[str, Any]) -> Chain:
    """``base Rz(q1) L1 Rz(q2) L2 ...`` as screws."""
    T, screws = np.array(arm["base"]), []
    for link in arm["links"]:
        z = T[:3, 2] / np.linalg.norm(T[:3, 2])
        screws.append(np.concatenate([np.cross(T[:3, 3], z), z]))
        T = T @ np.array(link)
    u, _, v = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ v
    return Chain(arm["name"], np.array(screws), T, np.tile([-np.pi, np.pi], (6, 1)), tuple(f"q{i}" for i in range(6)))


def test_certified_counts_and_solutions():
    """Every proved solution, and no other, of every arm in the fixture that has a closed form."""
    data = oracle()
    chains = {key: oracle_chain(arm) for key, arm in data["arms"].items()}
    families = {key: find_family(arm) for key, arm in chains.items()}
    cases = [c for c in data["cases"] if families[c["arm"]].has_closed_form]
    assert len(cases) >= 126
    assert len({c["arm"] for c in cases}) >= 10
    for case in cases:
        answers = solve_closed_form(chains[case["arm"]], families[case["arm"]], np.array(case["pose"]))
        got = answers.q[answers.valid]
        for solution in case["solutions"]:
            close = apart(got, np.array(solution["q"])) < 1e-9 + 100 * solution["bound"] if len(got) else np.zeros(0)
            assert close.any(), case["id"]
        if not case["ill_conditioned"]:
            assert len(got) == case["count"], case["id"]


def rows(file: str) -> Any:
    return yaml.safe_load((GOLDEN / file).read_text(encoding="utf-8"))


PUBLISHED = (
    *("kuka_kr210_robond", "puma560", "abb_irb120", "abb_irb2400", "yaskawa_mh12"),
    *("ur5e", "ur10e", "kuka_youbot", "so101"),
)


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_solution_sets(name):
    mine = [row for row in rows("ik_sets.yaml") if row["robot"] == name]
    assert len(mine) == 6
    arm, closed = chain(name, True), family(name, True)
    for row in mine:
        answers = solve_closed_form(arm, closed, np.array(row["T"]))
        listed = np.array(row["solutions"])
        assert found(ClosedFormSolutions(*(a[None] for a in answers)), listed).all()
        check_accuracy(answers, arm, np.array(row["T"]))


def gripper_pose(position: Any, rotation: Any = None) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = position
    if rotation is not None:
        T[:3, :3] = rotation
    return T


def all_listed(q: Any, T: np.ndarray, within: float) -> bool:
    answers = solve_closed_form(chain("kuka_kr210_robond"), family("kuka_kr210_robond"), T)
    return bool(found(ClosedFormSolutions(*(a[None] for a in answers)), np.atleast_2d(q), within).all())


def test_kr210_random_rows():
    for row in rows("kr210_ik.yaml")["random"]:
        assert all_listed([s["q"] for s in row["solutions"]], np.array(row["T"]), 1e-9)


def test_kr210_edge_rows():
    arm = chain("kuka_kr210_robond")
    for row in rows("kr210_ik.yaml")["edge"]:
        T = np.array(row["T"])
        answers = solve_closed_form(arm, family(arm.name), T)
        assert answers.valid.any(), row["case"]
        check_accuracy(answers, arm, T, 1e-13)
        # joints 1 to 3 of every listed branch; at a singular wrist joints 4 and 6 are free against each other
        listed = np.array([s["q"] for s in row["solutions"]])
        gaps = apart(answers.q[answers.valid][None, :, :3], listed[:, None, :3])
        shoulder_free = "shoulder" in row["case"] or "axis" in row["case"]
        assert shoulder_free or gaps.min(axis=1).max() < 1e-7, row["case"]


def in_limits(arm: Chain, answers: ClosedFormSolutions) -> np.ndarray:
    """(..., 8): answers with a copy, full turns away, inside the limits."""
    lower, upper = arm.limits.T
    lowest = answers.q + 2 * np.pi * np.ceil((lower - answers.q) / (2 * np.pi))
    return np.asarray(answers.valid & (lowest <= upper).all(axis=-1))


def test_unreachable_points():
    arm = chain("kuka_kr210_robond")
    points = np.array(rows("kr210_ik.yaml")["unreachable_positions"])
    for offset in (0.0, 0.303):  # of the gripper, or of the wrist centre
        T = np.array([gripper_pose(p + np.array([offset, 0.0, 0.0])) for p in points])
        answers = solve_closed_form(arm, family(arm.name), T)
        far = np.linalg.norm(points, axis=-1) > 1.0
        assert not answers.valid[far].any()
        if offset:  # beside axis 2: only from behind, and beyond the limits
            assert not in_limits(arm, answers).any()


# Rows of the course reports


def test_C4_wrist_centre():
    for row in rows("kr210_ik.yaml")["random"]:
        T = np.array(row["T"])
        # the tool axis is x of the gripper frame of the URDF
        assert T[:3, 3] - 0.303 * T[:3, 0] == pytest.approx(row["wrist_centre"], abs=1e-12)
        screws = family("kuka_kr210_robond").screws
        assert screws is not None
        G = T @ np.linalg.inv(chain("kuka_kr210_robond").home)
        assert G[:3, :3] @ wrist_centre(screws) + G[:3, 3] == pytest.approx(row["wrist_centre"], abs=1e-12)


def test_C5_first_three_joints_by_the_cosine_law():
    """The textbook triangle, front and elbow up, against the branch of that name."""
    for row in rows("kr210_ik.yaml")["random"]:
        x, y, z = row["wrist_centre"]
        theta1 = np.arctan2(y, x)
        r, s = np.hypot(x, y) - 0.35, z - 0.75
        a, c, b = np.hypot(0.96 + 0.54, 0.054), 1.25, np.hypot(r, s)
        angle_a = np.arccos(np.clip((b * b + c * c - a * a) / (2 * b * c), -1, 1))
        angle_b = np.arccos(np.clip((a * a + c * c - b * b) / (2 * a * c), -1, 1))
        theta2 = np.pi / 2 - angle_a - np.arctan2(s, r)
        theta3 = np.pi / 2 - (angle_b + np.arctan2(0.054, 1.5))
        front_up = next((s["q"] for s in row["solutions"] if s["branch"][:2] == [1, 1]), None)
        if front_up is not None:
            assert apart([theta1, theta2, theta3], front_up[:3]) < 1e-9
            assert found(
                solve_closed_form(chain("kuka_kr210_robond"), family("kuka_kr210_robond"), np.array(row["T"])),
                np.array(front_up),
            )


def test_C6_wrist_joints_and_their_flip():
    arm = chain("kuka_kr210_robond")
    rng = np.random.default_rng(11)
    for q in rng.uniform(-2.5, 2.5, (50, 6)):
        flip = q + np.array([0, 0, 0, np.pi, 0, np.pi])
        flip[4] = -q[4]
        answers = solve_closed_form(arm, family(arm.name), fk(arm, q))
        assert found(answers, q)
        assert found(answers, flip)


@pytest.mark.parametrize("case", [1, 2, 3])
def test_C8_debug_cases(case):
    row = rows("kr210_debug_cases.yaml")["cases"][case]
    quaternion = np.array(row["quaternion_xyzw"])
    T = gripper_pose(row["position"], from_quaternion(quaternion / np.linalg.norm(quaternion)))
    assert all_listed([s["q"] for s in row["solutions"]], T, 1e-9)
    # the angles as the exercise prints them, for the branch that they stand for
    listed = next(s for s in row["solutions"] if s["is_listed"])
    assert apart(row["listed_angles_2_decimals"], np.array(listed["q"])) < 2e-2


def test_C9_shelf_and_drop_poses():
    reached = 0
    for row in rows("kr210_pick_place.yaml"):
        reached += all_listed([s["q"] for s in row["in_limit_solutions"]], gripper_pose(row["gripper_position"]), 1e-9)
    assert reached == 19  # nine slots, before the grasp and at it, and the drop


def test_C12_many_poses_at_once():
    arm = chain("kuka_kr210_robond")
    T = fk(arm, np.random.default_rng(12).uniform(-2, 2, (20000, 6)))
    answers = solve_closed_form(arm, family(arm.name), T)
    assert answers.valid.any(axis=-1).all()


def test_C13_iteration_and_closed_form_agree():
    arm = chain("kuka_kr210_robond")
    q = np.random.default_rng(13).uniform(arm.limits[:, 0], arm.limits[:, 1], (40, 6))
    T = fk(arm, q)
    by_iteration = solve_numeric(arm, T)
    answers = solve_closed_form(arm, family(arm.name), T)
    assert by_iteration.valid.all()
    assert found(answers, by_iteration.q[:, 0], within=1e-5).all()


def test_K5_several_answers_lie_within_limits():
    arm = chain("kuka_kr210_robond")
    q = np.random.default_rng(14).uniform(arm.limits[:, 0], arm.limits[:, 1], (5000, 6))
    inside = in_limits(arm, solve_closed_form(arm, family(arm.name), fk(arm, q))).sum(axis=-1)
    assert inside.min() >= 2
    assert inside.max() == 8


def test_K6_a_flip_turns_joints_4_and_6_too():
    arm = chain("kuka_kr210_robond")
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    only_joint_5 = q * [1, 1, 1, 1, -1, 1]
    assert np.abs(fk(arm, only_joint_5) - fk(arm, q)).max() > 0.1
    assert np.abs(fk(arm, q + np.array([0, 0, 0, np.pi, -1.0, np.pi])) - fk(arm, q)).max() < 1e-12


def test_K7_the_generating_branch_is_always_found():
    arm = chain("kuka_kr210_robond")
    q = np.random.default_rng(15).uniform(arm.limits[:, 0], arm.limits[:, 1], (20000, 6))
    answers = solve_closed_form(arm, family(arm.name), fk(arm, q))
    assert found(answers, q).all()
    behind = answers.valid[:, 4:].any(axis=-1) & ~answers.valid[:, :4].any(axis=-1)
    assert behind.any() or answers.valid[:, 4:].any()


def test_K8_full_stretch_is_clamped():
    arm = chain("kuka_kr210_robond")
    q3, longest = stretched(arm)
    assert longest == pytest.approx(1.25 + np.hypot(0.054, 1.5), abs=1e-12)
    q = np.random.default_rng(16).uniform(-2, 2, (2000, 6))
    q[:, 2] = q3  # the wrist centre in line with axes 2 and 3
    T = fk(arm, q)
    answers = solve_closed_form(arm, family(arm.name), T)
    assert answers.valid.any(axis=-1).all()
    check_accuracy(answers, arm, T, 1e-13)
    # joint 3 comes as its principal value; its copy a turn lower is the one within limits
    high = np.array([0.1, 0.3, 2.705, 0.2, 0.5, 0.1])
    answers = solve_closed_form(arm, family(arm.name), fk(arm, high - [0, 0, 2 * np.pi, 0, 0, 0]))
    assert found(answers, high)
    assert arm.limits[2, 0] <= 2.705 - 2 * np.pi <= arm.limits[2, 1]


def wrist_distance(arm: Chain, q: np.ndarray) -> np.ndarray:
    """From axis 2 to the wrist centre, across the axis."""
    screws = arm.screws
    G = exp_product(screws[:3], q[:3])
    centre = (G @ [*wrist_centre(screws), 1.0])[:3]
    first = exp_product(screws[:1], q[:1])
    shoulder = (first @ [*np.cross(screws[1, 3:], screws[1, :3]), 1.0])[:3]
    axis = first[:3, :3] @ screws[1, 3:]
    out = centre - shoulder
    return np.asarray(out - axis * (axis @ out))


# Input


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_any_leading_axes(shape):
    arm = chain("ur5e")
    T = np.broadcast_to(fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]), (*shape, 4, 4))
    answers = solve_closed_form(arm, family("ur5e"), T)
    assert answers.q.shape == (*shape, 8, 6)
    assert answers.valid.shape == (*shape, 8)
    assert answers.position_error.shape == answers.rotation_error.shape == (*shape, 8)
    assert answers.valid.any(axis=-1).all()


def test_a_batch_equals_its_parts_in_any_order_on_any_number_of_threads():
    arm = chain("ur5e")
    T = fk(arm, np.random.default_rng(17).uniform(-3, 3, (9001, 6)))
    whole = solve_closed_form(arm, family("ur5e"), T, threads=4)
    order = np.random.default_rng(18).permutation(len(T))
    shuffled = solve_closed_form(arm, family("ur5e"), T[order])
    assert np.array_equal(whole.q[order], shuffled.q, equal_nan=True)
    for k in (0, 17, 9000):
        assert np.array_equal(solve_closed_form(arm, family("ur5e"), T[k]).q, whole.q[k], equal_nan=True)


def test_what_cannot_be_solved_says_so():
    arm, general = chain("ur5e"), chain("ufactory_xarm6")
    with pytest.raises(ArrayError, match="has no closed form: no three axes meet"):
        solve_closed_form(general, find_family(general), np.eye(4))
    with pytest.raises(ArrayError, match=r"T_base_tip must have shape \(..., 4, 4\)"):
        solve_closed_form(arm, family("ur5e"), np.eye(3))
    with pytest.raises(ArrayError, match="rotation"):
        solve_closed_form(arm, family("ur5e"), np.diag([1.0, 1.0, 2.0, 1.0]))
    with pytest.raises(ArrayError):
        solve_closed_form(arm, family("ur5e"), np.full((4, 4), np.nan))
    nowhere = np.eye(4)
    nowhere[0, 3] = np.nan
    with pytest.raises(ArrayError, match="finite"):
        solve_closed_form(arm, family("ur5e"), nowhere)
    nowhere[0, 3] = 1e200
    assert not solve_closed_form(arm, family("ur5e"), nowhere).valid.any()
    assert solve_closed_form(arm, family("ur5e"), np.eye(4).tolist()).q.shape == (8, 6)


def test_one_seed_for_a_batch_at_singular_poses():
    arm = chain("kuka_kr210_robond")
    q = np.array([[0.1, 0.2, 0.3, 0.4, 0.0, 0.6], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])  # a straight wrist, and a bent one
    T, seed = fk(arm, q), np.array([0.1, 0.2, 0.3, 0.3, 0.1, 0.5])
    one, each = solve(arm, T, seed=seed), solve(arm, T, seed=np.tile(seed, (2, 1)))
    np.testing.assert_array_equal(one.q, each.q)
    assert one.within_limits.any(axis=-1).all()
