"""A camera as numbers, and how points become pixels.

The model is OpenCV's: a pinhole, with radial and tangential distortion (Brown 1966, in the form of OpenCV's ``calib3d``)::

    u = fx x'' + cx,    v = fy y'' + cy,    (x'', y'') = distort(X / Z, Y / Z; k1, k2, p1, p2, k3, ...)

Axes are OpenCV's: x right, y down, z forward. The centre of the top left pixel is at (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.perception.opencv import opencv
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_COEFFICIENTS = (0, 4, 5, 8, 12)
_ITERATIONS = 100
_STEP = 1e-12  # where undistortion ends, in normalised coordinates


@dataclass(frozen=True, eq=False)
class Camera:
    """Matrix, distortion and image size of a camera.

    Attributes
    ----------
    matrix : (3, 3) array
        ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` [px].
    distortion : (0,), (4,), (5,), (8,) or (12,) array
        ``k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4``, in OpenCV's order.
    size : (int, int)
        Width and height of the image [px].

    Raises
    ------
    ArrayError
        A shape is wrong, a number is not finite, or a focal length is not positive.

    Examples
    --------
    >>> camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [], (640, 480))
    >>> camera.project([0.1, 0.0, 2.0])
    array([360., 240.])
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]

    def __post_init__(self) -> None:
        K = stack(self.matrix, (3, 3), "matrix").copy()
        if K.ndim != 2:
            raise ArrayError(f"matrix must have shape (3, 3), got {K.shape}")
        if K[0, 0] <= 0 or K[1, 1] <= 0:
            raise ArrayError(f"focal lengths must be positive, got fx = {K[0, 0]:g}, fy = {K[1, 1]:g}")
        if K[1, 0] != 0 or K[0, 1] != 0 or tuple(K[2]) != (0, 0, 1):
            raise ArrayError("matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        d = np.array(self.distortion, dtype=np.float64).reshape(-1)
        if d.size not in _COEFFICIENTS or not np.isfinite(d).all():
            raise ArrayError(f"distortion must be 0, 4, 5, 8 or 12 finite numbers, got {d.size}: {d}")
        width, height = (int(n) for n in self.size)
        if width < 1 or height < 1:
            raise ArrayError(f"size must be a positive width and height, got {width} x {height}")
        K.flags.writeable = d.flags.writeable = False
        object.__setattr__(self, "matrix", K)
        object.__setattr__(self, "distortion", d)
        object.__setattr__(self, "size", (width, height))

    def project(self, p_camera: ArrayLike) -> FloatArray:
        """Return the pixels of points.

        Parameters
        ----------
        p_camera : (..., 3) array
            Points in the camera's frame [m], before the camera.

        Returns
        -------
        (..., 2) array
            Pixels; NaN for a point that is not before the camera.
        """
        p = stack(p_camera, (3,), "p_camera")
        flat = p.reshape(-1, 3)
        uv = np.full((len(flat), 2), np.nan)
        front = flat[:, 2] > 0
        if front.any():
            uv[front] = self._distorted(flat[front, :2] / flat[front, 2:])
        return uv.reshape(*p.shape[:-1], 2)

    def _distorted(self, xy: FloatArray) -> FloatArray:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.pad(self.distortion, (0, 12 - self.distortion.size))
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
        out = np.stack([x * radial + dx, y * radial + dy], axis=-1)
        return np.asarray(out * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2])

    def directions(self, uv: ArrayLike) -> FloatArray:
        """Return where pixels look.

        Parameters
        ----------
        uv : (..., 2) array
            Pixels, as the lens makes them.

        Returns
        -------
        (..., 3) array
            ``X / Z, Y / Z, 1`` in the camera's frame, without distortion.
        """
        pixels = stack(uv, (2,), "uv")
        xy = (pixels - self.matrix[:2, 2]) / self.matrix[[0, 1], [0, 1]]
        if self.distortion.any() and pixels.size:
            cv2 = opencv("a lens with distortion")
            until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, _ITERATIONS, _STEP)
            points = pixels.reshape(-1, 1, 2)
            xy = cv2.undistortPoints(points, self.matrix, self.distortion, criteria=until).reshape(xy.shape)
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
