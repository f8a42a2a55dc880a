"""What is picked, by which arm, and where it goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError
from pieper.sim.scene import Scene, at, pose

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.sim.gripper import ParallelGripper

FloatArray = NDArray[np.float64]
_FARTHEST = 100.0  # [m] of distances of a task: what is more is no room


@dataclass(frozen=True, eq=False)
class PickTask:
    """What is picked, by which arm, and where it goes.

    Attributes
    ----------
    name : str
    arm : Arm
        Its tip carries the gripper.
    gripper : ParallelGripper
    scene : Scene
        With every target in it, in its slot.
    targets : tuple of str
        Names of the things to pick, in order.
    T_object_grasp : (4, 4) array
        Where the middle of the pads goes, in the frame of a target: z ahead, y from finger to finger.
    T_world_drop : (4, 4) array
        Tip of the arm when it lets go.
    bin_region : (2, 3) array
        Corners of the space where a thing counts as placed [m].
    q_home : (n,) array
        Where the arm begins [rad or m].
    approach : float
        How far before the grasp the straight way begins [m].
    clearance : float
        How much farther back the arm goes before it swings away [m].
    lift : float
        How far up before it draws back [m].
    drop_step : float
        Distance of the nine places, in a square around `T_world_drop`, where things are let go in turn [m]; what stands well on another
        thing would make a tower.
    spin_free : bool
        Whether the turn about the direction of approach does not matter, as with a can from above; arms with five joints need that.
    position_noise, yaw_noise : float
        Greatest shift along x and along y [m], and turn [rad], of the things in their slots.
    attempts : int
        Grasps of a thing before it is left.
    postures : tuple of (n,) arrays
        Safe ones to go by way of, besides `q_home`.
    speed : float
        Fraction of the arm's velocity limits.

    Raises
    ------
    ArrayError
        A pose, a size or a number that makes no task; a target that is not in the scene or does not move.
    """

    name: str
    arm: Arm
    gripper: ParallelGripper
    scene: Scene
    targets: tuple[str, ...]
    T_object_grasp: FloatArray
    T_world_drop: FloatArray
    bin_region: FloatArray
    q_home: FloatArray
    approach: float = 0.2
    clearance: float = 0.3
    lift: float = 0.03
    drop_step: float = 0.0
    spin_free: bool = False
    position_noise: float = 0.005
    yaw_noise: float = float(np.radians(5.0))
    attempts: int = 3
    postures: tuple[FloatArray, ...] = ()
    speed: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "targets", tuple(self.targets))
        for name in ("T_object_grasp", "T_world_drop"):
            object.__setattr__(self, name, pose(getattr(self, name), name))
        for name in ("approach", "clearance", "lift", "drop_step", "position_noise", "yaw_noise"):
            if not 0.0 <= getattr(self, name) <= _FARTHEST:
                raise ArrayError(f"{name} must be from 0 to {_FARTHEST:g}, got {getattr(self, name):.6g}")
        if not 0.0 < self.speed <= 1.0:
            raise ArrayError(f"speed must be above 0 and at most 1, got {self.speed}")
        if self.attempts < 1:
            raise ArrayError(f"attempts must be 1 or more, got {self.attempts}")
        if not self.targets:
            raise ArrayError("targets must name at least one thing of the scene")
        for target in self.targets:
            if self.targets.count(target) > 1:
                raise ArrayError(f"target {target!r} is named twice; once it is in the bin it is not picked again")
            if not self.scene.object(target).moves:
                raise ArrayError(f"target {target!r} is fixed; give it a mass")

    def grasp_at(self, T_world_object: FloatArray) -> FloatArray:
        """(4, 4) pose of the tip that grips a thing which is there."""
        return np.asarray(T_world_object @ self.T_object_grasp @ np.linalg.inv(self.gripper.T_tip_grasp))

    def drop_of(self, target: str) -> FloatArray:
        """(4, 4) pose of the tip where it lets go of a target."""
        number = self.targets.index(target)
        shift = [number % 3 - 1, number // 3 % 3 - 1]
        return np.asarray(at(self.drop_step * shift[0], self.drop_step * shift[1], 0.0) @ self.T_world_drop)

    def back(self, T_world_tip: FloatArray, distance: float) -> FloatArray:
        """The pose of the tip, (4, 4), drawn back by `distance` [m] against the direction of approach: (4, 4)."""
        T = np.array(T_world_tip)
        T[:3, 3] -= distance * (T[:3, :3] @ self.gripper.T_tip_grasp[:3, 2])
        return T
