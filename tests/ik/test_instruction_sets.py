"""Every set of vector instructions gives the same answers, on every built-in arm, by closed form and by the general solver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pieper._native import kernels
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import find_family
from pieper.ik.general_6r import solve_general_6r
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from tests.robots import ROBOTS, chain

SETS = kernels.instruction_sets()
SAME = 1e-8  # rad, where the pose decides the joints to that many digits
ACCURACY = 1e-9  # [m, rad] of every answer
REGULAR = 1e-4  # least singular value at all answers: above it rounding moves no answer by SAME, and none comes or goes
ARMS = tuple(robot.name for robot in ROBOTS if robot.dof in (5, 6))
CLOSED = tuple(name for name in ARMS if find_family(chain(name)).has_closed_form)
GENERAL = tuple(robot.name for robot in ROBOTS if robot.dof == 6)


def targets(name: str, count: int) -> np.ndarray:
    """Random poses, and as many with joints at multiples of 90 and 45 degrees and of 0.5 rad."""
    rng, n = np.random.default_rng(31), chain(name).dof
    grid = [rng.integers(-6, 7, (count // 3, n)) * step for step in (np.pi / 2, np.pi / 4, 0.5)]
    return fk(chain(name), np.concatenate([rng.uniform(-np.pi, np.pi, (count, n)), *grid]))


def with_each(solve: Callable[[], object]) -> dict[str, object]:
    before = kernels.instruction_set()
    answers = {}
    try:
        for one in SETS:
            kernels.use_instruction_set(one)
            answers[one] = solve()
    finally:
        kernels.use_instruction_set(before)
    return answers


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(len(a), len(b)) largest differences of a joint, full turns aside."""
    return np.abs(np.remainder(a[:, None] - b + np.pi, 2 * np.pi) - np.pi).max(axis=-1)


def compare(name: str, answers: dict, *, least_regular: int) -> None:
    """Equal sets where all answers are regular; elsewhere, where answers may form curves, only that there are valid ones."""
    arm = chain(name)
    reference = answers[SETS[0]]
    least = np.full(reference.valid.shape, np.inf)
    least[reference.valid] = np.linalg.svd(jacobian(arm, reference.q[reference.valid]), compute_uv=False)[:, -1]
    regular = least.min(axis=1) > REGULAR
    assert regular.sum() >= least_regular
    for which, other in answers.items():
        assert (other.valid.any(axis=1) == reference.valid.any(axis=1)).all(), which
        assert np.nanmax(other.position_error) < ACCURACY, which
        assert np.nanmax(other.rotation_error) < ACCURACY, which
        for k in np.flatnonzero(regular):
            mine, theirs = reference.q[k][reference.valid[k]], other.q[k][other.valid[k]]
            assert len(mine) == len(theirs), (which, k)
            gaps = apart(mine, theirs)
            assert (gaps.min(axis=1) < SAME).all(), (which, k)
            assert (gaps.min(axis=0) < SAME).all(), (which, k)


def test_there_is_more_than_one():
    assert len(SETS) >= 1
    assert kernels.instruction_set() in SETS


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms(name):
    arm, family = chain(name), find_family(chain(name))
    T = targets(name, 300)
    compare(name, with_each(lambda: solve_closed_form(arm, family, T)), least_regular=280)


@pytest.mark.parametrize("name", GENERAL)
def test_general_solver(name):
    arm, T = chain(name), targets(name, 48)
    compare(name, with_each(lambda: solve_general_6r(arm, T)), least_regular=42)
