"""Laws of inverse kinematics by iteration, over every built-in robot. Recall and accuracy are reported apart.

The judge is the textbook product of exponentials and a measure of its own, so that solver and judge share no code.
"""

from __future__ import annotations

import numpy as np
import pytest

from pieper.ik import select
from pieper.ik.numeric import solve_numeric
from pieper.ik.solutions import Status
from pieper.model.chain import Chain
from tests.judge import MEASURED, inside, joints, left, poses
from tests.reference import product_of_exponentials as textbook
from tests.robots import NAMES, chain

POSES = 60


def targets(arm, count, seed):
    return poses(arm, joints(arm, count, seed))


@pytest.mark.parametrize("name", NAMES)
def test_recall_every_reachable_pose_is_reached(name, instruction_set):
    arm = chain(name)
    answers = solve_numeric(arm, targets(arm, POSES, seed=1))
    assert answers.reached.all(), f"{(~answers.reached).sum()} of {POSES} missed with {instruction_set}"
    assert (answers.status == Status.reached).all()


@pytest.mark.parametrize("name", NAMES)
def test_recall_at_right_angles(name):
    """Joints at multiples of 45 degrees: most of these poses are singular, some in several ways."""
    arm = chain(name, nominal=True)
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    q = np.clip(np.round(joints(arm, POSES, seed=2) / (np.pi / 4)) * (np.pi / 4), lower, upper)
    assert solve_numeric(arm, np.stack([textbook.fk(arm, x) for x in q])).reached.all()


@pytest.mark.parametrize("name", NAMES)
def test_recall_with_joints_at_their_limits(name):
    arm = chain(name)
    q = joints(arm, POSES, seed=3)
    side = np.random.default_rng(4).integers(0, 3, q.shape)
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    q = np.where(side == 0, lower, np.where(side == 1, upper, q))
    assert solve_numeric(arm, np.stack([textbook.fk(arm, x) for x in q])).reached.all()


@pytest.mark.parametrize("name", NAMES)
def test_accuracy_every_valid_answer_gives_the_target_back(name):
    arm = chain(name)
    wanted = targets(arm, 20, seed=5)
    answers = solve_numeric(arm, wanted, count=3)
    for k in range(len(wanted)):
        for s in np.flatnonzero(answers.valid[k]):
            distance, angle = left(textbook.fk(arm, answers.q[k, s]), wanted[k])
            assert distance <= MEASURED
            assert angle <= MEASURED
            assert abs(distance - answers.position_error[k, s]) < 1e-13  # and it says so itself
            assert abs(angle - answers.rotation_error[k, s]) < 1e-13
    assert np.isnan(answers.q[~answers.valid]).all()


@pytest.mark.parametrize("name", NAMES)
def test_most_answers_are_exact(name):
    """The last step is taken on purpose: away from singular poses nothing but rounding is left."""
    arm = chain(name)
    answers = solve_numeric(arm, targets(arm, POSES, seed=1))
    assert np.median(answers.position_error) < 1e-11
    assert answers.exact.mean() > 0.9


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_within_limits(name):
    arm = chain(name)
    answers = solve_numeric(arm, targets(arm, POSES, seed=6), count=2)
    for q in answers.q[answers.within_limits]:
        assert inside(arm, q)
    assert answers.within_limits[answers.valid].all()
    np.testing.assert_array_equal(select.within_limits(answers, arm).q, answers.q)


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_equals_its_parts_in_any_order(name):
    arm = chain(name)
    wanted = targets(arm, 40, seed=7)
    wanted[::9, :3, 3] *= 5.0  # out of reach
    seeds = joints(arm, 40, seed=8)
    whole = solve_numeric(arm, wanted, seed=seeds)
    order = np.random.default_rng(9).permutation(40)
    shuffled = solve_numeric(arm, wanted[order], seed=seeds[order])
    for field in ("q", "valid", "position_error", "rotation_error", "status"):
        np.testing.assert_array_equal(getattr(shuffled, field), getattr(whole, field)[order])
    np.testing.assert_array_equal(shuffled.nearest.q, whole.nearest.q[order])
    for k in (0, 1, 39):
        np.testing.assert_array_equal(solve_numeric(arm, wanted[k], seed=seeds[k]).q, whole.q[k])
    cold = solve_numeric(arm, wanted[:8])
    np.testing.assert_array_equal(cold.q.reshape(2, 4, 1, -1), solve_numeric(arm, wanted[:8].reshape(2, 4, 4, 4)).q)


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_that_works_is_not_overtaken(name):
    """With all other starts allowed the answer is the one that the seed alone gives, even where others are quicker."""
    arm = chain(name)
    wanted = targets(arm, 40, seed=14)
    away = np.random.default_rng(15).normal(scale=0.4, size=(40, arm.dof))
    seeds = np.clip(joints(arm, 40, seed=14) + away, *arm.limits.T)
    alone = solve_numeric(arm, wanted, seed=seeds, restarts=1)
    every = solve_numeric(arm, wanted, seed=seeds)
    same = (every.q == alone.q).all(axis=(1, 2))[alone.reached]
    assert same.mean() >= 0.95  # alone, a few are reached only by coming to rest, which the others make unnecessary


@pytest.mark.parametrize("name", ["ur5e", "franka_panda", "kuka_youbot"])
@pytest.mark.parametrize("threads", [2, 4])
def test_threads_change_nothing(name, threads):
    arm = chain(name)
    wanted = targets(arm, 200, seed=10)
    wanted[::7, :3, 3] *= 5.0
    alone, together = solve_numeric(arm, wanted), solve_numeric(arm, wanted, threads=threads)
    np.testing.assert_array_equal(together.q, alone.q)
    np.testing.assert_array_equal(together.nearest.q, alone.nearest.q)
    np.testing.assert_array_equal(together.nearest.out_of_reach, alone.nearest.out_of_reach)


@pytest.mark.parametrize("name", NAMES)
def test_out_of_reach_gives_the_nearest_pose_and_says_so(name, instruction_set):
    arm = chain(name)
    wanted = targets(arm, 12, seed=11)
    direction = wanted[:, :3, 3] / np.linalg.norm(wanted[:, :3, 3], axis=1, keepdims=True)
    wanted[:, :3, 3] = 10.0 * direction  # no built-in arm is that long
    answers = solve_numeric(arm, wanted)
    assert not answers.valid.any()
    assert (answers.status == Status.unreachable).mean() > 0.9, (
        instruction_set
    )  # the rest still creeps nearer, and says so
    assert (answers.status != Status.reached).all()
    near = answers.nearest
    for k in range(len(wanted)):
        assert inside(arm, near.q[k])
        distance, angle = left(textbook.fk(arm, near.q[k]), wanted[k])
        assert abs(distance - near.position_error[k]) < 1e-12
        assert abs(angle - near.rotation_error[k]) < 1e-12
        assert 0.0 < near.out_of_reach[k] <= near.position_error[k] + 1e-6
        if answers.status[k] == Status.unreachable:
            assert answers.reasons[k].startswith("out of reach by ")


@pytest.mark.parametrize("name", NAMES)
def test_the_nearest_pose_cannot_be_bettered_nearby(name):
    arm = chain(name)
    wanted = targets(arm, 4, seed=12)
    wanted[:, :3, 3] *= 3.0
    answers = solve_numeric(arm, wanted)
    rng = np.random.default_rng(13)
    for k in np.flatnonzero(~answers.reached):
        cost = np.hypot(answers.nearest.position_error[k], answers.nearest.rotation_error[k])
        for size in (1e-2, 1e-3):
            for _ in range(20):
                q = np.clip(answers.nearest.q[k] + size * rng.normal(size=arm.dof), *arm.limits.T)
                assert np.hypot(*left(textbook.fk(arm, q), wanted[k])) > cost - 1e-7


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7, 12])
def test_recall_on_arms_that_nobody_built(n):
    """Axes in any direction through any point, a few slides among them, tight and wide limits."""
    rng = np.random.default_rng(n)
    for _ in range(8):
        axes = rng.normal(size=(n, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        turning = np.hstack([np.cross(rng.uniform(-0.6, 0.6, (n, 3)), axes), axes])
        sliding = np.hstack([axes, np.zeros((n, 3))])
        screws = np.where(rng.random((n, 1)) < 0.2, sliding, turning)
        home = np.eye(4)
        home[:3, :3], _ = np.linalg.qr(rng.normal(size=(3, 3)))
        home[:3, 0] *= np.linalg.det(home[:3, :3])
        limits = np.column_stack([-rng.uniform(0.5, 3.2, n), rng.uniform(0.5, 3.2, n)])
        arm = Chain("random", screws, home, limits, [f"j{i}" for i in range(n)])
        wanted = np.stack([textbook.fk(arm, q) for q in rng.uniform(*limits.T, (20, n))])
        answers = solve_numeric(arm, wanted)
        assert answers.reached.all()
        for T, q in zip(wanted, answers.q[:, 0], strict=True):
            assert max(left(textbook.fk(arm, q), T)) <= MEASURED
            assert inside(arm, q)
