"""Worlds and small helpers that the tests of collision, edges and planning share."""

from __future__ import annotations

import numpy as np

from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.motion.world import Item, World
from pieper.spatial import rotation


def at(x: float, y: float, z: float, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.from_rpy(rpy), (x, y, z)
    return T


def cluttered(reach: float = 1.0) -> World:
    """One obstacle of each shape around an arm of that reach [m]."""
    s = reach
    return World(
        (
            Item("floor", Box([4 * s, 4 * s, 0.02 * s]), at(0, 0, -0.08 * s)),
            Item("can", Cylinder(0.1 * s, 0.6 * s), at(0.5 * s, 0.2 * s, 0.3 * s, (0.4, 0.2, 0.0))),
            Item("ball", Sphere(0.15 * s), at(-0.4 * s, 0.3 * s, 0.6 * s)),
            Item("rod", Capsule(0.05 * s, 0.6 * s), at(0, -0.5 * s, 0.5 * s, (1.0, 0.0, 0.0))),
            Item("box", Box([0.3 * s, 0.2 * s, 0.8 * s]), at(0.4 * s, -0.4 * s, 0.4 * s, (0.1, 0.2, 0.6))),
        )
    )


def post() -> World:
    """What a UR5e has to go around when it turns its first joint."""
    return World((Item("post", Box([0.2, 0.1, 0.8]), at(0.55, 0.0, 0.4)),))


def states(chain, count: int, seed: int = 0) -> np.ndarray:
    """Joint vectors drawn evenly within the limits, a turn at most."""
    lower, upper = np.clip(chain.limits, -np.pi, np.pi).T
    return lower + (upper - lower) * np.random.default_rng(seed).random((count, chain.dof))
