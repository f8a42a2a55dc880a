"""The kernels' sine and cosine against mpmath, in units of the last place."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from pieper._native import kernels

# Measured worst case over 12 million angles: 0.80 (baseline), 0.90 (fused); correct rounding would be 0.5.
CLAIMED_ULP = 1.0

RNG = np.random.default_rng(20)
ANGLES = {
    "a quarter turn": RNG.uniform(-0.8, 0.8, 600),
    "a few turns": RNG.uniform(-20, 20, 600),
    "thousands": RNG.uniform(-1e4, 1e4, 600),
    "up to the limit of the fast reduction": RNG.uniform(-1.6e6, 1.6e6, 600),
    "beyond it": np.concatenate([RNG.uniform(-1e15, 1e15, 100), 10.0 ** RNG.uniform(7, 300, 100)]),
    "nearest doubles to multiples of pi/2": np.arange(-300, 300) * (np.pi / 2),
    "their neighbours": np.nextafter(np.arange(1, 300) * (np.pi / 2), 0),
    "tiny": 10.0 ** RNG.uniform(-300, -3, 200),
    "zeros": np.array([0.0, -0.0]),
    # the double below 1.6e6 that lies nearest to a multiple of pi/2 decides whether the reduction keeps enough digits
    "worst case for the reduction": np.array([52174.0, 573204.0, 1146408.0, 1.0 / 3.0]) * np.pi / 2,
}


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("kind", ANGLES)
def test_error_in_units_of_the_last_place(kind, instruction_set):
    before = kernels.instruction_set()
    kernels.use_instruction_set(instruction_set)
    try:
        sine, cosine = kernels.sincos(ANGLES[kind])
    finally:
        kernels.use_instruction_set(before)
    with mp.workprec(1200):
        for angle, s, c in zip(ANGLES[kind], sine, cosine, strict=True):
            for got, exact in ((s, mp.sin(mp.mpf(float(angle)))), (c, mp.cos(mp.mpf(float(angle))))):
                ulp = mp.mpf(float(np.spacing(abs(float(exact)))))
                assert abs(mp.mpf(float(got)) - exact) / ulp < CLAIMED_ULP, (angle, got, exact)


def test_one_instruction_set_is_always_there():
    assert kernels.instruction_sets()[0] in ("baseline", "portable")
    assert kernels.instruction_set() in kernels.instruction_sets()
    with pytest.raises(ValueError, match="not among instruction_sets"):
        kernels.use_instruction_set("mmx")
