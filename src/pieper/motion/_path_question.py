"""What is asked of an arm along a path: the poses, what of them counts, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import target as _target
from pieper.ik.solve import solver
from pieper.kinematics.joints import periodic_joints
from pieper.motion.path import METRES_PER_RADIAN, CartesianPath
from pieper.spatial import pose
from pieper.spatial._checks import FloatArray, poses

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from pieper.ik.solver import Solver
    from pieper.model.chain import Chain

TURN = 2.0 * np.pi


@dataclass(eq=False)
class GivenPoses:
    """The poses of a path, and those between them."""

    s: FloatArray
    T: FloatArray
    between: Callable[[float], FloatArray]
    corners: FloatArray

    @classmethod
    def of(cls, path: CartesianPath | ArrayLike, count: int | None, step: float | None) -> GivenPoses:
        if isinstance(path, CartesianPath):
            s, T = path.sample(count=count, step=step)
            return cls(s, T, path.at, path.corners)
        if count is not None or step is not None:
            raise ArrayError("count and step sample a CartesianPath; poses are taken as they are: leave both out")
        Ts = np.ascontiguousarray(poses(path, "path"))
        if Ts.ndim != 3 or not len(Ts):
            raise ArrayError(f"path must be a CartesianPath or poses of shape (m, 4, 4), got {Ts.shape}")
        metres = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1)
        # the angle from the chord of the rotation matrices: |R - S| = 2 sqrt(2) sin(angle / 2)
        chord = np.linalg.norm(np.diff(Ts[:, :3, :3], axis=0), axis=(1, 2))
        radians = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(metres, METRES_PER_RADIAN * radians))])

        def between(s: float) -> FloatArray:
            k = int(np.clip(np.searchsorted(lengths, s, side="right") - 1, 0, max(len(Ts) - 2, 0)))
            if len(Ts) == 1 or lengths[k + 1] == lengths[k]:
                return np.asarray(Ts[k])
            share = (s - lengths[k]) / (lengths[k + 1] - lengths[k])
            return pose.interpolate(Ts[k], Ts[k + 1], fraction=share, motion="straight")

        return cls(lengths, Ts, between, np.empty(0))


@dataclass(frozen=True, eq=False)
class PathQuestion:
    """An arm, what counts of a pose, the joint values or the words to begin with, the precision of a break [m], and speed limits."""

    chain: Chain
    target: str
    seed: FloatArray | None
    words: str | None
    precision: float
    speeds: FloatArray

    @cached_property
    def solver(self) -> Solver:
        return solver(self.chain)

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """(n,): which joints can be written in several ways."""
        return periodic_joints(self.chain)

    @property
    def lower(self) -> FloatArray:
        return self.chain.limits[:, 0]

    @property
    def upper(self) -> FloatArray:
        return self.chain.limits[:, 1]

    def wanted(self, T: FloatArray) -> Any:
        """What the solver is asked for at poses."""
        if self.target == "pose":
            return T
        if self.target == "axis":
            return _target.position_and_axis(T[..., :3, 3], T[..., :3, 2])
        return _target.ignore_orientation(T[..., :3, 3])

    def unturned(self, q: FloatArray, near: FloatArray) -> FloatArray:
        """Joint values with the whole turns that bring them nearest to others."""
        turns = np.where(self.turning, np.rint((near - q) / TURN), 0.0)
        return np.asarray(q + TURN * turns)
