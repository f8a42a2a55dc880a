"""Where on the field a pixel looks, for things at a known height above it.

A pixel is a ray; a marker at height h is where the ray meets the plane z = h of the field. To take that point for one on the floor
displaces it by h / H of its distance from the point below a camera at height H: the parallax.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from pieper.spatial._checks import FloatArray, poses, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.perception.camera import Camera


class View(Protocol):
    """From pixels to places, and back."""

    unit: ClassVar[str]
    """Of places: ``"m"`` or ``"px"``."""

    def to_field(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return the places ``(..., 2)`` of pixels ``(..., 2)`` of things at a height [m] above the field."""
        ...

    def to_image(self, p_field: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return the pixels ``(..., 2)`` of places ``(..., 2)``."""
        ...

    def jacobian(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return ``d place / d pixel``, ``(..., 2, 2)``, which carries the covariance of a pixel to the field."""
        ...


@dataclass(frozen=True, eq=False)
class PixelView:
    """No calibration: places are pixels."""

    unit: ClassVar[str] = "px"

    def to_field(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return the pixels themselves: (..., 2) -> (..., 2) [px]."""
        return stack(uv, (2,), "uv")

    def to_image(self, p_field: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return the places themselves: (..., 2) -> (..., 2) [px]."""
        return stack(p_field, (2,), "p_field")

    def jacobian(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return identities: (..., 2) -> (..., 2, 2)."""
        return np.broadcast_to(np.eye(2), (*stack(uv, (2,), "uv").shape, 2)).copy()


@dataclass(frozen=True, eq=False)
class FieldView:
    """A calibrated camera over a field.

    Attributes
    ----------
    camera : Camera
        Its lens.
    T_camera_field : (4, 4) array
        Pose of the field in the camera's frame [m]: x and y span the field, z points up, out of it.

    Examples
    --------
    A camera 2 m above the origin that looks straight down, with x of the field to the right:

    >>> from pieper.perception.camera import Camera
    >>> camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [], (640, 480))
    >>> down = FieldView(camera, [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    >>> down.to_field([720, 240])
    array([1., 0.])
    >>> down.to_field([720, 240], height=0.2)  # the same pixel, seen on top of a robot
    array([0.9, 0. ])
    """

    camera: Camera
    T_camera_field: FloatArray
    unit: ClassVar[str] = "m"

    def __post_init__(self) -> None:
        T = poses(self.T_camera_field, "T_camera_field").reshape(4, 4).copy()
        T.flags.writeable = False
        object.__setattr__(self, "T_camera_field", T)

    def to_field(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return where the rays of pixels meet the plane at a height.

        Parameters
        ----------
        uv : (..., 2) array
            Pixels.
        height : float or (...) array
            Of the things seen, above the field [m].

        Returns
        -------
        (..., 2) array
            Places on the field [m]; NaN where the ray does not meet the plane before the camera.
        """
        seen = self.camera.directions(uv)
        T = self.T_camera_field
        p = self._along(seen, height)[..., None] * seen - T[:3, 3]
        return np.asarray((p @ T[:3, :3])[..., :2])

    def to_image(self, p_field: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return the pixels of places.

        Parameters
        ----------
        p_field : (..., 2) array
            Places on the field [m].
        height : float or (...) array
            Above the field [m].

        Returns
        -------
        (..., 2) array
            Pixels; NaN for what is not before the camera.
        """
        xy = stack(p_field, (2,), "p_field")
        h = np.broadcast_to(np.asarray(height, dtype=np.float64), xy.shape[:-1])
        p = np.concatenate([xy, h[..., None]], axis=-1)
        return self.camera.project(p @ self.T_camera_field[:3, :3].T + self.T_camera_field[:3, 3])

    def jacobian(self, uv: ArrayLike, *, height: ArrayLike = 0.0) -> FloatArray:
        """Return how places move with pixels.

        Returns
        -------
        (..., 2, 2) array
            ``d place / d pixel`` [m/px]; NaN where `to_field` is.
        """
        seen = self.camera.directions(uv)
        along = self._along(seen, height)
        directions = seen @ self.T_camera_field[:3, :3]
        per_direction = self.T_camera_field[:2, :3].T  # d directions / d (X / Z, Y / Z)
        turned = per_direction[:2] - directions[..., :2, None] / directions[..., 2:, None] * per_direction[2]
        known = np.isfinite(seen).all(axis=-1, keepdims=True)
        per_pixel = np.linalg.inv(self.camera.jacobian(np.where(known, seen, 0.0)[..., :2]))
        return np.asarray(along[..., None, None] * turned @ per_pixel)

    def _along(self, seen: FloatArray, height: ArrayLike) -> FloatArray:
        """How far along each direction the plane at a height is, NaN if not before the camera."""
        T = self.T_camera_field
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (np.asarray(height, dtype=np.float64) + T[:3, 2] @ T[:3, 3]) / (seen @ T[:3, 2])
        return np.asarray(np.where((along > 0) & np.isfinite(along), along, np.nan))
