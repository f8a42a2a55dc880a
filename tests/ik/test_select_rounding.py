"""Copies by whole turns beside a limit: rounding must not put them outside."""

import numpy as np

import pieper
from pieper.ik import select


def test_a_copy_that_ends_on_a_limit_is_inside_it():
    arm = pieper.load("kuka_kr210_robond")
    lower, upper = arm.limits.T
    q = (lower + upper) / 2
    q[0] = lower[0]  # -185 deg, whose copy within half a turn is 175 deg
    answers = arm.ik(arm.fk(np.array([q])))
    for chosen in (select.along(answers, q)[0], select.nearest(answers, q)[0]):
        assert chosen[0] == lower[0]
        np.testing.assert_allclose(arm.fk(chosen), arm.fk(q), atol=1e-9)
        assert ((lower <= chosen) & (chosen <= upper)).all()
