"""The compiled scores of groups of answers against the same written out in NumPy, on every robot and every instruction set."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain
from pieper.workspace.measure import ALIKE
from tests.reference import scores
from tests.robots import NAMES, chain

# Of singular values some 1e-15 of the largest of them is rounding, in both; of their product as much for each factor, times the others.
ROUNDING = 1e-13

QUANTITIES = ("reached", "solutions", "most", "manipulability", "singularity", "margin")
GROUPS, POSES, SLOTS = 5, 7, 3


def answers(arm: Chain, *, seed: int = 0, groups: int = GROUPS, slots: int = SLOTS) -> tuple[np.ndarray, np.ndarray]:
    """Joints (groups * POSES, slots, n) all over the limits, and which of them count: a half, none of group 1, all of group 2."""
    random = np.random.default_rng(seed)
    lower, upper = np.clip(arm.limits, -4.0, 4.0).T
    q = random.uniform(lower, upper, (groups * POSES, slots, arm.dof))
    counted = random.random(q.shape[:2]) < 0.5
    counted[POSES : 2 * POSES] = False
    counted[2 * POSES : 3 * POSES] = True
    q[~counted] = np.nan  # what does not count is not looked at
    return q, counted


def compiled(arm: Chain, q: np.ndarray, counted: np.ndarray, rows: int = 6, threads: int = 1) -> dict[str, np.ndarray]:
    found = arm.native.score_answers(q, counted, POSES, rows, ALIKE, True, threads)
    return dict(zip(QUANTITIES, found, strict=True))


def compare(arm: Chain, q: np.ndarray, counted: np.ndarray, rows: int) -> None:
    found, expected = compiled(arm, q, counted, rows), scores.score_answers(arm, q, counted, POSES, rows, ALIKE)
    for name in ("reached", "solutions", "most"):
        assert found[name].tolist() == expected[name].tolist(), name
    largest = float(np.linalg.norm(jacobian(arm, q[counted])[:, :rows], axis=(1, 2)).max())
    factors = min(rows, arm.dof)
    scale = {"manipulability": factors * max(1.0, largest) ** factors, "singularity": max(1.0, largest), "margin": 10.0}
    for name, size in scale.items():
        np.testing.assert_allclose(found[name], expected[name], rtol=0.0, atol=ROUNDING * size, err_msg=name)


@pytest.mark.parametrize("rows", [6, 3])
@pytest.mark.parametrize("name", NAMES)
def test_groups_are_scored_as_numpy_does(name: str, rows: int, instruction_set: str) -> None:
    compare(chain(name), *answers(chain(name)), rows)


@pytest.mark.parametrize("name", NAMES)
def test_near_a_singularity_the_best_is_still_told(name: str, instruction_set: str) -> None:
    """Groups of answers within 1e-5 of one in which the arm is as nearly singular as it gets among some."""
    arm = chain(name)
    q, counted = answers(arm)
    q, counted = q[2 * POSES :], counted[2 * POSES :]
    some = q[counted]
    worst = some[np.linalg.svd(jacobian(arm, some), compute_uv=False)[:, -1].argmin()]
    for joint in range(arm.dof):  # at zero many an arm is stretched out
        folded = worst.copy()
        folded[joint] = np.clip(0.0, *arm.limits[joint])
        near = folded + np.random.default_rng(joint).uniform(-1e-5, 1e-5, q.shape)
        compare(arm, np.clip(near, *arm.limits.T), counted, 6)


@pytest.mark.parametrize("name", NAMES)
def test_any_number_of_threads_and_any_part_score_alike(name: str, instruction_set: str) -> None:
    arm = chain(name)
    q, counted = answers(arm, seed=1, groups=600, slots=2)
    whole = compiled(arm, q, counted)
    for threads in (2, 3, 5):
        for quantity, values in compiled(arm, q, counted, threads=threads).items():
            assert values.tobytes() == whole[quantity].tobytes()
    one = slice(4 * POSES, 5 * POSES)
    for quantity, values in compiled(arm, q[one], counted[one]).items():
        assert values.tobytes() == whole[quantity][4:5].tobytes()


def test_of_answers_that_are_alike_the_farthest_from_a_singularity_is_told(instruction_set: str) -> None:
    """All answers to a pose: mirror images have the same manipulability but for rounding, and other singular values."""
    arm = pieper.load("ur5e")
    T = arm.fk(np.random.default_rng(2).uniform(-2.5, 2.5, (GROUPS * POSES, 6)))
    found = arm.ik(T)
    q, counted = found.q, found.within_limits
    compare(arm.chain, q, counted, 6)
    values = np.linalg.svd(jacobian(arm.chain, np.where(counted[..., None], q, 0.0)), compute_uv=False)
    product = np.where(counted, values.prod(axis=-1), -1.0)
    alike = product >= product.max(axis=1, keepdims=True) * (1.0 - ALIKE)
    least = np.where(alike, values[..., -1], np.nan)
    assert np.nanmax(np.nanmax(least, axis=1) - np.nanmin(least, axis=1)) > 1e-3  # the choice makes a difference


def test_more_answers_of_a_pose_than_a_block_holds() -> None:
    arm = chain("ur5e")
    q, counted = answers(arm, slots=300)
    compare(arm, q, counted, 6)
    compare(arm, q, counted, 3)


def test_joints_without_limits_are_infinitely_far_from_them() -> None:
    arm = pieper.load("ur5e").chain
    endless = Chain(arm.name, arm.screws, arm.home, [[-np.inf, np.inf]] * 6, arm.joint_names)
    q, counted = answers(arm)
    assert compiled(endless, q, counted)["margin"][2] == np.inf
    one_sided = Chain(arm.name, arm.screws, arm.home, [[-9.0, np.inf]] * 6, arm.joint_names)
    np.testing.assert_allclose(
        compiled(one_sided, q, counted)["margin"][2], (q[2 * POSES : 3 * POSES] + 9.0).min(-1).max()
    )


def test_counts_alone_and_what_is_malformed() -> None:
    arm = chain("ur5e")
    q, counted = answers(arm)
    found = arm.native.score_answers(q, counted, POSES, 6, ALIKE, False, 1)
    assert found[1].tolist() == compiled(arm, q, counted)["solutions"].tolist()
    assert [len(each) for each in found] == [GROUPS] * 3 + [0] * 3
    q[2 * POSES, 1, 3] = np.inf
    for bad in (
        (q, counted, POSES, 6, ALIKE, True, 1),
        (q[0], counted[0], POSES, 6, ALIKE, True, 1),
        (q, counted.astype(float), POSES, 6, ALIKE, True, 1),
        (q, counted[1:].copy(), POSES, 6, ALIKE, True, 1),
        (q, counted, POSES + 1, 6, ALIKE, True, 1),
        (q, counted, 0, 6, ALIKE, True, 1),
        (q, counted, POSES, 4, ALIKE, True, 1),
        (q, counted, POSES, 6, ALIKE, True, 0),
    ):
        with pytest.raises(TypeError):
            arm.native.score_answers(*bad)
