"""Arms with coincident, parallel, meeting and nearly equal axes: nothing crashes, nothing is false, nothing comes back empty."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from pieper.ik.solve import solver
from tests.degenerate_arms import degenerate_arm
from tests.judge import MEASURED, left
from tests.reference import product_of_exponentials as textbook


@pytest.mark.parametrize("block", range(6))
def test_degenerate_arms(block):
    solved = 0
    for seed in range(60 * block, 60 * (block + 1)):
        rng = np.random.default_rng(seed)
        arm = degenerate_arm(
            lambda k, rng=rng: int(rng.integers(k)),
            lambda rng=rng: float(rng.uniform(-1.0, 1.0)),
            int(rng.integers(2, 7)),
            slides=bool(rng.integers(2)),
        )
        prepared = solver(arm)
        q = rng.uniform(-np.pi, np.pi, (6, arm.dof))
        q[3:] = np.round(q[3:] / (np.pi / 4)) * (np.pi / 4)
        q = np.clip(q, *arm.limits.T)
        wanted = np.stack([textbook.fk(arm, x) for x in q])
        answers = prepared.solve(wanted)
        assert answers.valid.any(axis=1).all(), (
            f"arm {seed}, {prepared.method}: poses of the arm itself without an answer"
        )
        for k, s in zip(*np.nonzero(answers.valid), strict=True):
            assert max(left(textbook.fk(arm, answers.q[k, s]), wanted[k])) <= MEASURED, f"arm {seed}"
        solved += prepared.method != "numeric"
    assert solved > 5


def test_a_solver_goes_with_its_chain():
    rng = np.random.default_rng(1)
    arm = degenerate_arm(lambda k: int(rng.integers(k)), lambda: float(rng.uniform(-1.0, 1.0)), 6, slides=False)
    solver(arm).solve(np.array(arm.home))
    assert solver(arm) is solver(arm)
    gone = weakref.ref(arm)
    del arm
    gc.collect()
    assert gone() is None
