"""The target that the command line describes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pieper.errors import ArrayError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.ik.target import Target


@dataclass(frozen=True)
class Wanted:
    """What was typed: a position, and at most one of three ways to speak of the orientation; angles in radians."""

    position: tuple[float, float, float]
    rpy: tuple[float, float, float] | None = None
    quaternion: tuple[float, float, float, float] | None = None
    axis: tuple[float, float, float] | None = None

    def target(self) -> Target:
        """The same for the solver."""
        import numpy as np

        from pieper.ik import target

        given = {"--rpy": self.rpy, "--quat": self.quaternion, "--axis": self.axis}
        names = [name for name, value in given.items() if value is not None]
        if len(names) > 1:
            raise ArrayError(f"{' and '.join(names)} both speak of the orientation; give one of them")
        if self.axis is not None:
            return target.position_and_axis(self.position, self.axis)
        if self.is_position_only:
            return target.ignore_orientation(self.position)
        return target.pose(self.pose_from(np.eye(3)))

    def pose_from(self, R_base_tip: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose (4, 4) asked for; what is not asked for stays as near as can be to the given orientation."""
        import numpy as np

        from pieper.spatial import rotation

        T = np.eye(4)
        T[:3, :3] = R_base_tip
        T[:3, 3] = self.position
        if self.rpy is not None:
            T[:3, :3] = rotation.from_rpy(self.rpy)
        elif self.quaternion is not None:
            T[:3, :3] = rotation.from_quaternion(self.quaternion)
        elif self.axis is not None:
            # the shortest turn from where the z axis of the tip points to where it should
            z, wanted_z = R_base_tip[:, 2], np.array(self.axis) / np.linalg.norm(self.axis)
            about = np.cross(z, wanted_z)
            sine = float(np.linalg.norm(about))
            about = about / sine if sine > 0.0 else R_base_tip[:, 0]
            T[:3, :3] = rotation.from_rotation_vector(about * np.arctan2(sine, z @ wanted_z)) @ R_base_tip
        return T

    @property
    def is_position_only(self) -> bool:
        """True when nothing is asked of the orientation."""
        return self.rpy is None and self.quaternion is None and self.axis is None

    @property
    def is_whole(self) -> bool:
        """True when position and orientation are asked for."""
        return self.rpy is not None or self.quaternion is not None

    def record(self) -> dict[str, Any]:
        """The same for JSON; what was not asked for is null."""
        return {"position": self.position, "rpy": self.rpy, "quaternion_xyzw": self.quaternion, "axis": self.axis}

    def words(self, *, degrees: bool) -> str:
        """What is asked of the orientation, in words."""
        import numpy as np

        if self.rpy is not None:
            unit, values = ("deg", np.degrees(self.rpy).tolist()) if degrees else ("rad", self.rpy)
            return f"roll pitch yaw {_listed(values)} {unit}"
        if self.quaternion is not None:
            return f"quaternion {_listed(self.quaternion)}"
        if self.axis is not None:
            return f"z axis along {_listed(self.axis)}"
        return "position only"


def wanted(
    x: float,
    y: float,
    z: float,
    *,
    rpy: tuple[float, float, float] | None,
    quaternion: tuple[float, float, float, float] | None,
    axis: tuple[float, float, float] | None,
    degrees: bool,
) -> Wanted:
    """What the arguments ask for; roll, pitch and yaw were typed in degrees where `degrees` is set."""
    from math import radians

    if rpy is not None and degrees:
        roll, pitch, yaw = rpy
        rpy = (radians(roll), radians(pitch), radians(yaw))
    return Wanted((x, y, z), rpy, quaternion, axis)


def start_values(arm: Arm, text: str | None, *, degrees: bool, option: str = "--from") -> Any:
    """(n,) joint values to start from; where none were typed, zero, or the limit nearest to zero."""
    import numpy as np

    from pieper.cli.arguments import joint_values

    if text is None:
        return np.clip(np.zeros(arm.dof), arm.limits[:, 0], arm.limits[:, 1])
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise ArrayError(f"{option} must be numbers separated by commas, got {text!r}") from None
    return joint_values(arm, values, degrees=degrees)


def _listed(values: Any) -> str:
    return " ".join(f"{value:.6g}" for value in values)
