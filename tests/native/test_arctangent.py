"""The kernels' arc tangent against the C library's."""

import numpy as np
import pytest

from pieper._native import kernels

# Measured worst case over a million points: 3 units in the last place; it enters nothing that is not measured again.
CLAIMED_ULP = 4.0

RNG = np.random.default_rng(4)
ANGLES = np.concatenate(
    [RNG.uniform(-np.pi, np.pi, 3000), 10.0 ** RNG.uniform(-15, 0, 1000), np.arange(-8, 9) * (np.pi / 8)]
)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_error_in_units_of_the_last_place(instruction_set):
    size = 10.0 ** RNG.uniform(-12, 12, ANGLES.shape)
    y, x = size * np.sin(ANGLES), size * np.cos(ANGLES)
    before = kernels.instruction_set()
    kernels.use_instruction_set(instruction_set)
    try:
        got = kernels.arctangent(y, x)
    finally:
        kernels.use_instruction_set(before)
    exact = np.arctan2(y, x)
    assert (np.abs(got - exact) / np.spacing(np.abs(exact))).max() < CLAIMED_ULP


def test_axes_and_origin():
    y, x = np.array([0.0, 0.0, 1.0, -1.0, 0.0]), np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    assert kernels.arctangent(y, x).tolist() == [0.0, np.pi, np.pi / 2, -np.pi / 2, 0.0]
