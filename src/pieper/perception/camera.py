"""A camera as numbers, how points become pixels, and where pixels look.

The model is OpenCV's: a pinhole, with radial and tangential distortion (Brown 1966, in the form of OpenCV's ``calib3d``)::

    u = fx x'' + cx,    v = fy y'' + cy,    (x'', y'') = distort(X / Z, Y / Z; k1, k2, p1, p2, k3, ...)

Axes are OpenCV's: x right, y down, z forward. The centre of the top left pixel is at (0, 0).

A polynomial that fits a lens inside the image folds somewhere outside: from there on two directions have one pixel. `Camera.reach` tells
where; beyond it there are no pixels and no directions, NaN instead, since the polynomial says nothing of the lens there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_COEFFICIENTS = (0, 4, 5, 8, 12)
_ITERATIONS = 30  # of Newton, which needs three to six
_STEP = 1e-8  # where it ends, relative to 1 + the square of the tangent: what is left then is the square of that
_PATIENCE = 5  # turns after which a pixel beyond the edge is given up
_RESIDUAL = 1e-11  # what may remain in normalised coordinates, relative likewise: 1e-8 px
_WIDEST = 600.0  # tangent of 89.9 deg, where a pinhole ends
_SHORT = 1 - 1e-9  # of the way to a fold or to a pole
_RAYS, _RADII = 64, 400  # directions and steps in which the fold is looked for


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
            raise ArrayError(f"matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {K.tolist()}")
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
            Points in the camera's frame [m].

        Returns
        -------
        (..., 2) array
            Pixels; NaN for a point that is not before the camera, or farther from its axis than `reach`.
        """
        p = stack(p_camera, (3,), "p_camera")
        flat = p.reshape(-1, 3)
        uv = np.full((len(flat), 2), np.nan)
        front = np.flatnonzero(flat[:, 2] > 0)
        xy = flat[front, :2] / flat[front, 2:]
        inside = np.hypot(xy[:, 0], xy[:, 1]) <= self.reach
        uv[front[inside]] = self._distorted(xy[inside]) * self._focal + self.matrix[:2, 2]
        return uv.reshape(*p.shape[:-1], 2)

    def directions(self, uv: ArrayLike) -> FloatArray:
        """Return where pixels look.

        Parameters
        ----------
        uv : (..., 2) array
            Pixels, as the lens makes them.

        Returns
        -------
        (..., 3) array
            ``X / Z, Y / Z, 1`` in the camera's frame, without distortion. NaN for a pixel that no direction within `reach` has.

        Notes
        -----
        Newton's iteration, from the inverse of the radial part. Within `reach` there is one answer, and it is found to rounding; what
        does not give the pixel back is NaN, never a near miss.
        """
        pixels = stack(uv, (2,), "uv")
        xy = (pixels - self.matrix[:2, 2]) / self._focal
        if self.distortion.any() and pixels.size:
            xy = self._undistorted(xy.reshape(-1, 2)).reshape(xy.shape)
        return np.concatenate([xy, np.where(np.isfinite(xy[..., :1]), 1.0, np.nan)], axis=-1)

    def jacobian(self, xy: ArrayLike) -> FloatArray:
        """Return how pixels move with directions.

        Parameters
        ----------
        xy : (..., 2) array
            ``X / Z, Y / Z`` of directions.

        Returns
        -------
        (..., 2, 2) array
            ``d (u, v) / d (X / Z, Y / Z)`` [px].
        """
        at = stack(xy, (2,), "xy")
        slopes = self._slopes(at.reshape(-1, 2)).reshape(*at.shape, 2)
        return np.asarray(slopes * self._focal[:, None])

    @cached_property
    def reach(self) -> float:
        """Tangent of the angle to the axis up to which no two directions share a pixel; infinite without distortion.

        The largest radius about the axis within which the symmetric part of the derivative of the distortion is positive definite: on a
        disc, which is convex, that makes the map one to one. For a lens with radial distortion alone this is exactly where
        ``r (1 + k1 r^2 + ...)`` stops growing.
        """
        if not self.distortion.any():
            return np.inf
        radial = self._radial_reach()
        if not self._bent:
            return radial
        angles = np.arange(_RAYS) * (2 * np.pi / _RAYS)
        radii = np.geomspace(1e-3, min(radial, _WIDEST), _RADII)
        rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        J = self._slopes((radii[:, None, None] * rays).reshape(-1, 2)).reshape(_RADII, _RAYS, 2, 2)
        mean, half = (J[..., 0, 0] + J[..., 1, 1]) / 2, (J[..., 0, 0] - J[..., 1, 1]) / 2
        least = (mean - np.hypot(half, (J[..., 0, 1] + J[..., 1, 0]) / 2)).min(axis=1)
        folded = np.flatnonzero(least <= 0)
        if not folded.size:
            return radial
        return float(radii[max(folded[0] - 1, 0)])

    def _radial_reach(self) -> float:
        """Smallest radius at which ``r N(r^2) / D(r^2)`` stops growing, or D vanishes."""
        k1, k2, _, _, k3, k4, k5, k6, *_ = self._coefficients
        N, D = np.polynomial.Polynomial([1, k1, k2, k3]), np.polynomial.Polynomial([1, k4, k5, k6])
        t = np.polynomial.Polynomial([0, 1])
        # Both begin with 1, so the polynomials of 1 / r^2 are those that need no division.
        of_inverse = [np.roots(p.coef) for p in (N * D + 2 * t * (N.deriv() * D - N * D.deriv()), D)]
        inverse = np.concatenate(of_inverse)
        real = inverse.real[(np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)) & (inverse.real > _WIDEST**-2)]
        return float(np.sqrt(1 / real.max())) * _SHORT if real.size else np.inf

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        return tuple(np.pad(self.distortion, (0, 12 - self.distortion.size)).tolist())

    @property
    def _focal(self) -> FloatArray:
        return np.asarray(self.matrix[[0, 1], [0, 1]])

    @property
    def _bent(self) -> bool:
        """Whether there is more than radial distortion."""
        return any(self._coefficients[i] != 0 for i in (2, 3, 8, 9, 10, 11))

    @cached_property
    def _radial_table(self) -> tuple[FloatArray, FloatArray]:
        """Radii with and without distortion, both growing."""
        widest = np.arctan(min(self.reach, _WIDEST))
        radii = np.tan(np.linspace(0.0, widest, 2048))
        k1, k2, _, _, k3, k4, k5, k6, *_ = self._coefficients
        r2 = radii * radii
        return radii * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))), radii

    def _distorted(self, xy: FloatArray) -> FloatArray:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        out = xy * radial[:, None]
        if self._bent:
            out[:, 0] += 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
            out[:, 1] += p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
        return out

    def _slopes(self, xy: FloatArray) -> FloatArray:
        """``d distort / d (x, y)``, ``(n, 2, 2)``."""
        _, _, a, b, c, d = self._with_slopes(xy[:, 0], xy[:, 1])
        return np.stack([a, b, c, d], axis=-1).reshape(-1, 2, 2)

    def _with_slopes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
        """``distort(x, y)``, and its derivatives ``a b; c d``."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        xx, yy, xy = x * x, y * y, x * y
        r2 = xx + yy
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * k1 + r2 * (4 * k2 + r2 * (6 * k3))
        if k4 or k5 or k6:
            D = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
            radial = radial / D
            slope = (slope - radial * (2 * k4 + r2 * (4 * k5 + r2 * (6 * k6)))) / D
        u, v, b = x * radial, y * radial, xy * slope
        a, c, d = radial + xx * slope, b, radial + yy * slope
        if self._bent:
            both = 2 * (p1 * x + p2 * y)
            u, v = u + 2 * p1 * xy + p2 * (r2 + 2 * xx), v + p1 * (r2 + 2 * yy) + 2 * p2 * xy
            a, b, d = a + 2 * p1 * y + 6 * p2 * x, b + both, d + 6 * p1 * y + 2 * p2 * x
            c = b
            if s1 or s2 or s3 or s4:
                prism_x, prism_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
                u, v = u + r2 * (s1 + r2 * s2), v + r2 * (s3 + r2 * s4)
                a, b, c, d = a + prism_x * x, b + prism_x * y, c + prism_y * x, d + prism_y * y
        return u, v, a, b, c, d

    def _undistorted(self, bent: FloatArray) -> FloatArray:
        """Newton's iteration for ``distort(x, y) = bent``; NaN where it has no answer within reach."""
        radius = np.hypot(bent[:, 0], bent[:, 1])
        share = np.interp(radius, *self._radial_table) / np.maximum(radius, 1e-300)
        U, V = bent[:, 0], bent[:, 1]
        x, y = U * share, V * share
        limit = min(self.reach, _WIDEST)
        out = np.full(bent.shape, np.nan)
        rows = np.arange(len(bent))
        for turn in range(_ITERATIONS):
            u, v, a, b, c, d = self._with_slopes(x, y)
            miss_u, miss_v = u - U, v - V
            det = a * d - b * c
            det[np.abs(det) < 1e-12] = 1e-12
            step_x, step_y = (d * miss_u - b * miss_v) / det, (a * miss_v - c * miss_u) / det
            x, y = x - step_x, y - step_y
            r = np.hypot(x, y)
            beyond = r > limit
            if beyond.any():
                x, y = (np.where(beyond, part * (limit / np.maximum(r, limit)), part) for part in (x, y))
            done = np.maximum(np.abs(step_x), np.abs(step_y)) <= _STEP * (1 + r * r)
            if turn > _PATIENCE:
                done |= beyond  # sent back to the edge so often that nothing is inside
            if done.all():
                out[rows, 0], out[rows, 1] = x, y
                break
            if done.any():
                out[rows[done], 0], out[rows[done], 1] = x[done], y[done]
                rows = rows[~done]
                x, y, U, V = (part[~done] for part in (x, y, U, V))
        known = np.isfinite(out[:, 0])
        at = out if known.all() else np.where(known[:, None], out, 0.0)
        miss = np.abs(self._distorted(at) - bent).max(axis=1)
        found = known & (miss <= _RESIDUAL * (1 + radius * radius))
        return out if found.all() else np.where(found[:, None], out, np.nan)
