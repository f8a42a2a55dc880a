"""The light in a simulated scene: where it comes from, how strong it is, and of which colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.sim.physics import MujocoSimulator

FloatArray = NDArray[np.float64]

_MIDDLE, _FAR = np.array([0.8, 0.3, 0.5]), 6.0  # [m]
_STEEPEST = float(np.radians(50.0))  # of random light, from the vertical


@dataclass(frozen=True, eq=False)
class SceneLight:
    """A lamp far away, and light from everywhere.

    Attributes
    ----------
    direction : (3,) array
        In which the lamp shines, in the world [-]; its length does not matter.
    strength : float
        Of the lamp, as a share of white [-].
    ambient : float
        Light from everywhere [-].
    tint : (3,) array
        What of red, green and blue both have [-].
    shadows : bool

    Raises
    ------
    ArrayError
        A direction that is none, or a number below 0.

    Examples
    --------
    >>> SceneLight(strength=0.7).direction.round(2)
    array([ 0.4 , -0.26, -0.88])
    """

    direction: FloatArray = (0.45, -0.3, -1.0)  # type: ignore[assignment]
    strength: float = 0.5
    ambient: float = 0.58
    tint: FloatArray = (1.0, 1.0, 1.0)  # type: ignore[assignment]
    shadows: bool = True

    def __post_init__(self) -> None:
        direction, tint = (np.array(getattr(self, name), dtype=np.float64) for name in ("direction", "tint"))
        if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
            raise ArrayError(f"direction must be three numbers that are not all 0, got {direction.tolist()}")
        if tint.shape != (3,) or not (np.isfinite(tint) & (tint >= 0.0)).all():
            raise ArrayError(f"tint must be three numbers of 0 or more, got {tint.tolist()}")
        for name in ("strength", "ambient"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ArrayError(f"{name} must be 0 or more and finite, got {getattr(self, name)}")
        direction = direction / np.linalg.norm(direction)
        for name, array in (("direction", direction), ("tint", tint)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def random(cls, rng: np.random.Generator) -> SceneLight:
        """Some light: from up to 50 deg off the vertical, 0.25 to 0.8 strong, 0.25 to 0.6 from everywhere, each channel +-15 %, shadows four times of five."""
        lean, around = _STEEPEST * np.sqrt(rng.uniform()), rng.uniform(0.0, 2.0 * np.pi)
        direction = np.array([np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around), -np.cos(lean)])
        strength, ambient = rng.uniform(0.25, 0.8), rng.uniform(0.25, 0.6)
        return cls(direction, strength, ambient, rng.uniform(0.85, 1.15, 3), bool(rng.uniform() < 0.8))

    def shine(self, robot: MujocoSimulator) -> None:
        """Light the scene of a simulator like this from now on; the motion is not disturbed."""
        model = robot.model
        model.light_dir[0] = self.direction
        model.light_pos[0] = _MIDDLE - _FAR * self.direction  # where the map of shadows is drawn from
        model.light_diffuse[0] = self.strength * self.tint
        model.light_castshadow[0] = self.shadows
        model.vis.headlight.ambient[:] = self.ambient * self.tint
        model.vis.headlight.diffuse[:] = 0.15 * self.tint  # from where the camera is: little
        model.vis.headlight.specular[:] = 0.0
