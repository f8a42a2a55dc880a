"""The unknowns of a field before a camera: its pose, and of the lens what is not known of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pieper.errors import VisionError
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.spatial._checks import FloatArray

_FOCALS = (0.5, 0.7, 1.0, 1.4, 2.0, 3.0)  # of the width of the image, tried where it is not known
ASSUMED_FOCAL = 0.9  # of the width of the image: 58 deg, where nothing tells it
_PIXEL = 0.5  # px, how well a pixel is taken to be known where too few points tell
_VAGUE = 0.1  # relative deviation of the focal length above which it is not believed


class Lens:
    """The unknowns: the pose of the field, and of the lens what is not known of it.

    Parameters are a rotation vector and a shift [m]; then the logarithm of the focal length over the width of the image, unless it is known or follows
    from the height of the camera; then the radial coefficients.
    """

    def __init__(self, camera: Camera | None, size: tuple[int, int], height: float | None, radial: int) -> None:
        if camera is None and radial not in (0, 1, 2):
            raise VisionError(f"an assumed lens has 0, 1 or 2 radial coefficients, got {radial}")
        if height is not None and not 0 < height < 1e3:
            raise VisionError(f"the height of the camera must be positive [m], got {height:g}")
        self.camera, self.size, self.height, self.radial = camera, size, height, radial
        self.focal: float | None = None  # over the width; settled when it is not to be found

    @property
    def free_focal(self) -> bool:
        """Whether the focal length is to be found."""
        return self.camera is None and self.focal is None

    def view(self, x: FloatArray) -> FieldView:
        """The camera and the pose that parameters stand for."""
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix()
        T[:3, 3] = x[3:6]
        if self.camera is not None:
            return FieldView(self.camera, T)
        width, height = self.size
        focal = width * (float(np.exp(np.clip(x[6], -4, 4))) if self.focal is None else self.focal)
        k = x[6 + (self.focal is None) :]
        d = np.concatenate([k, np.zeros(4 - len(k))]) if len(k) else np.empty(0)
        K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        return FieldView(Camera(K, d, self.size), T)

    def project(self, x: FloatArray, p_field: FloatArray) -> FloatArray:
        """What ``view(x).to_image`` gives for points ``(n, 3)``, without the making of a view."""
        p = p_field @ Rotation.from_rotvec(x[:3]).as_matrix().T + x[3:6]
        if self.camera is not None:
            return self.camera.project(p)
        width, height = self.size
        focal = width * (float(np.exp(np.clip(x[6], -4, 4))) if self.focal is None else self.focal)
        k = x[6 + (self.focal is None) :]
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = np.where(p[:, 2:] > 0, p[:, :2] / p[:, 2:], np.nan)
        if len(k):
            r2 = (xy * xy).sum(axis=1, keepdims=True)
            xy = xy * (1 + r2 * (k[0] + (r2 * k[1] if len(k) > 1 else 0.0)))
        return np.asarray(xy * focal + ((width - 1) / 2, (height - 1) / 2))

    def parameters(self, view: FieldView) -> FloatArray:
        """Those nearest to a view."""
        T = view.T_camera_field
        x = [*Rotation.from_matrix(T[:3, :3]).as_rotvec(), *T[:3, 3]]
        if self.camera is None:
            if self.focal is None:
                x.append(float(np.log(view.camera.matrix[0, 0] / self.size[0])))
            k = view.camera.distortion[:2] if view.camera.distortion.size else np.zeros(2)
            x += k[: self.radial].tolist()
        return np.array(x)

    def guess(self, pixels: FloatArray, places: FloatArray, focal: float | None) -> FloatArray:
        """From points, with the focal length over the width if the lens is not known."""
        cv2 = opencv("the pose of a field")
        if self.camera is not None:
            rays = self.camera.directions(pixels)[:, :2]
            if not np.isfinite(rays).all():
                row = int(np.flatnonzero(~np.isfinite(rays).all(axis=1))[0])
                raise VisionError(
                    f"pixel {pixels[row].tolist()} is beyond the reach of the lens; does the camera belong to this image?"
                )
        else:
            rays = (pixels - (np.array(self.size) - 1) / 2) / (self.size[0] * (focal or ASSUMED_FOCAL))
        flat = places.copy()
        level = float(places[:, 2].mean())
        flat[:, 2] = 0.0
        best, least = None, np.inf
        _, rotations, shifts, _ = cv2.solvePnPGeneric(
            flat, np.ascontiguousarray(rays), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        poses = [(cv2.Rodrigues(r)[0], np.ravel(t)) for r, t in zip(rotations, shifts, strict=True)]
        for R, t in [
            *poses,
            *_of_homography(cv2, places, rays),
        ]:  # the former fail where the axis is square to the field
            if not np.isfinite(R).all() or not np.isfinite(t).all():
                continue
            t = t - R[:, 2] * level
            p = places @ R.T + t
            eye = -R.T @ t
            if (p[:, 2] <= 0).any() or eye[2] <= 0:
                continue
            miss = float(((p[:, :2] / p[:, 2:] - rays) ** 2).sum())
            if miss < least:
                best, least = (R, t), miss
        if best is None:
            raise VisionError("no camera above the field sees these points so; is each pixel beside its own place?")
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = best
        x = [*Rotation.from_matrix(best[0]).as_rotvec(), *best[1]]
        if self.camera is None:
            if self.focal is None:
                x.append(float(np.log(focal or ASSUMED_FOCAL)))
            x += [0.0] * self.radial
        return np.array(x)

    def high(self, x: FloatArray) -> FloatArray:
        """What the height of the camera misses, as a miss among those in pixels; empty if it is not given."""
        if self.height is None or self.camera is not None:
            return np.empty(0)
        T = self.view(x).T_camera_field
        return np.array([(-(T[:3, 2] @ T[:3, 3]) - self.height) / self.height * 1e4])

    def assumed(self) -> tuple[str, ...]:
        """What is not measured, in words."""
        if self.camera is not None:
            return ()
        words = ["a lens whose axis goes through the middle of the image, with square pixels"]
        found = f"{self.radial} radial coefficient{'s' * (self.radial > 1)}, found with the pose"
        words.append(found if self.radial else "no distortion")
        if self.height is not None:
            words.append(f"the focal length follows from the height of the camera, {self.height:g} m")
        elif self.focal is not None:
            words.append(
                f"a focal length of {self.focal:g} widths of the image, which these points do not tell: places on the floor do not depend on it, "
                "those of markers above it do; give the height of the camera"
            )
        return tuple(words)


def _of_homography(cv2: Any, places: FloatArray, rays: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Pose from ``H = (r1 r2 t)`` up to scale, with the nearest rotation."""
    H, _ = cv2.findHomography(places[:, :2], rays)
    if H is None:
        return []
    H = H * np.sign(H[2, 2]) / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
    U, _, Vt = np.linalg.svd(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    return [(U @ Vt, H[:, 2])] if np.linalg.det(U @ Vt) > 0 else []


def solve_points(
    lens: Lens, pixels: FloatArray, places: FloatArray, miss: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Parameters that bring places (n, 3) nearest to where they are seen, (n, 2); several focal lengths are tried where it is not known."""

    def all_misses(x: FloatArray) -> FloatArray:
        return np.concatenate([miss(x), lens.high(x)])

    starts = [lens.guess(pixels, places, f) for f in (_FOCALS if lens.free_focal else (None,))]
    fits = [
        least_squares(all_misses, x, x_scale="jac", method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14) for x in starts
    ]
    fit = min(fits, key=lambda fit: float(fit.cost))
    if lens.free_focal and lens.height is None and is_vague(fit):
        lens.focal = ASSUMED_FOCAL
        return solve_points(lens, pixels, places, miss)
    return np.asarray(fit.x)


def is_vague(fit: Any, together: float = 1.0) -> bool:
    """Whether the focal length could as well be quite another; `together` is how many points miss as one."""
    J = np.asarray(fit.jac)
    spare = max(len(J) - J.shape[1], 0)
    sigma = np.sqrt(2 * fit.cost / spare) if spare > 8 else max(_PIXEL, np.sqrt(2 * fit.cost / max(spare, 1)))
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    deviation = sigma * np.linalg.norm(Vt[:, 6] / np.maximum(s, 1e-9 * s[0])) * np.sqrt(together)
    return bool(deviation > _VAGUE) or not -1.6 < fit.x[6] < 2.3


def size_of(camera: Camera | None, size: tuple[int, int] | None) -> tuple[int, int]:
    """Width and height of the image [px]: those of the camera, where there is one."""
    if camera is not None:
        return camera.size
    if size is None:
        raise VisionError(
            "without a camera, the size of the image is needed: give image_size, its width and height in pixels"
        )
    return int(size[0]), int(size[1])


def other_size(camera: Camera | None, size: tuple[int, int]) -> str:
    """That an image is not as large as those of the camera, in words."""
    expected = camera.size if camera is not None else (0, 0)
    return (
        f"the image is {size[0]} x {size[1]} pixels and the camera is calibrated for {expected[0]} x {expected[1]}; "
        "calibrate it at the resolution that is used"
    )
