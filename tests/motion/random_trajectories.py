"""Trajectories for the laws."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from pieper.motion.trajectory import Trajectory

KINDS = ("linear", "cubic", "quintic")


def random_trajectory(seed: int, kind: str, *, joints: int = 2, points: int = 4) -> Trajectory:
    """Points of order 1, at most a second apart; what depends on the seed alone."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(-1.0, 1.0) + np.cumsum(rng.uniform(0.1, 1.0, points))
    q, dq, ddq = rng.normal(size=(3, points, joints))
    return Trajectory(t, q, None if kind == "linear" else dq, ddq if kind == "quintic" else None)


seeds = st.integers(0, 10_000)
kinds = st.sampled_from(KINDS)
