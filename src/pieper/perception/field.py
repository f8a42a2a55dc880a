"""Where the field lies before the camera: from corners, from field lines, or from AprilTags.

With a calibrated lens the pose of the field is what is looked for, with the least squares of the misses in pixels (Levenberg-Marquardt). Without one, a
lens is assumed whose axis goes through the middle of the image and whose pixels are square; its focal length, and if asked for one or two radial
coefficients, are found with the pose where the images tell them. What was assumed is written into the file. A camera that looks straight down does
not tell its focal length: on the floor nothing depends on it, but the parallax of a marker at height h does, as h / H. Give the height H then.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pieper._version import __version__
from pieper.errors import ArrayError, VisionError
from pieper.perception.calibration_file import save_view
from pieper.perception.camera import Camera
from pieper.perception.field_lines import FieldLines, LinePoints, find_lines, smoothed
from pieper.perception.field_view import FieldView
from pieper.perception.opencv import opencv
from pieper.spatial._checks import stack
from pieper.yaml_file import Section, read_yaml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

_FLAT = 0.01  # width over length of points: less is a line
_FOCALS = (0.5, 0.7, 1.0, 1.4, 2.0, 3.0)  # of the width of the image, tried where it is not known
_ASSUMED_FOCAL = 0.9  # of the width of the image: 58 deg, where nothing tells it
_PIXEL = 0.5  # px, how well a pixel is taken to be known where too few points tell
_VAGUE = 0.1  # relative deviation of the focal length above which it is not believed
_LOSS = 1.0  # px, where misses of lines begin to count less
_ROUND = 3  # fits at each width of search
_FIRST_LOOK, _COARSE, _FINE = 150, 400, 1500  # points of lines
_FINALISTS = 3
_NARROWEST = 5.0  # px: real lines lie a centimetre from where they should
_EXPLAINED, _AUTOMATIC = 0.4, 0.75  # share of the lines that has to be seen: with a hint, and without
_AHEAD = 0.15  # and by how much more than with the field turned by a quarter


@dataclass(frozen=True, eq=False)
class FieldCalibration:
    """Where the field lies, and the evidence for it.

    Attributes
    ----------
    view : FieldView
    uv : (n, 2) array
        Points as seen [px].
    p_field : (n, 3) array
        Where they are [m].
    residual : (n, 2) array
        Seen minus projected [px]; of lines, the part across the line.
    error : (n,) array
        The same on the field, at the height of the point [m].
    left_out_error : dict of str to float
        Of each point, tag or line (by name): its RMS error [m] when the field is fitted without it. Empty where the rest would not suffice.
    method : str
        ``corners``, ``tags`` or ``lines``.
    assumed : tuple of str
        What was not measured, in words.
    outlines : tuple of (m, 3) arrays
        Lines of the field to be drawn [m].
    size : (float, float) or None
        Length and width of the field [m].
    """

    view: FieldView
    uv: FloatArray
    p_field: FloatArray
    residual: FloatArray
    error: FloatArray
    left_out_error: dict[str, float]
    method: str
    assumed: tuple[str, ...] = ()
    outlines: tuple[FloatArray, ...] = ()
    size: tuple[float, float] | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def rms_px(self) -> float:
        """RMS miss [px]."""
        return float(np.sqrt((self.residual**2).sum(axis=-1).mean()))

    @property
    def rms(self) -> float:
        """RMS error on the field [m]."""
        return float(np.sqrt((self.error**2).mean()))

    @property
    def worst(self) -> float:
        """Largest error on the field [m]."""
        return float(self.error.max())

    @property
    def camera_height(self) -> float:
        """Of the camera above the field [m]."""
        T = self.view.T_camera_field
        return float(-(T[:3, 2] @ T[:3, 3]))

    def report(self) -> str:
        """Return the figures in lines for people."""
        words = f"residual  RMS {self.rms * 1e3:.2f} mm, worst {self.worst * 1e3:.2f} mm, over {len(self.uv)} points ({self.rms_px:.2f} px RMS)"
        camera = f"camera  {self.camera_height:.3f} m above the field"
        lines = [words, camera]
        if self.left_out_error:
            lines.append("left out in turn:")
            lines += [f"{value * 1e3:7.2f} mm  {name}" for name, value in self.left_out_error.items()]
        return "\n".join([*lines, *(f"assumed  {words}" for words in self.assumed), *self.notes])

    def save(self, path: str | Path, *, sources: Iterable[str] = (), camera_file: str | Path | None = None) -> None:
        """Write ``field.yaml``, with residuals in millimetres and provenance."""
        residual: dict[str, Any] = {
            "method": self.method,
            "points": len(self.uv),
            "rms_mm": round(self.rms * 1e3, 4),
            "max_mm": round(self.worst * 1e3, 4),
            "rms_px": round(self.rms_px, 4),
        }
        if self.left_out_error:
            residual["left_out_mm"] = {name: round(value * 1e3, 4) for name, value in self.left_out_error.items()}
        provenance = {
            "sources": [str(s) for s in sources],
            "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "by": f"pieper {__version__}",
        }
        told: dict[str, Any] = {"assumed": list(self.assumed)} if self.assumed else {}
        save_view(
            path, self.view, field=self.size, camera_file=camera_file, **told, residual=residual, provenance=provenance
        )

    def picture(self, image: Image) -> Image:
        """Draw the field and the misses over an image, ``(height, width, 3)`` and taller for the words."""
        from pieper.perception.calibration_picture import field_picture

        head = f"{self.method}: RMS {self.rms * 1e3:.2f} mm, worst {self.worst * 1e3:.2f} mm over {len(self.uv)} points"
        drawn = [self.view.to_image(line[:, :2], height=line[:, 2]) for line in self.outlines]
        return field_picture(
            image, drawn, self.uv, self.residual, [head, f"camera {self.camera_height:.2f} m above the field"]
        )


def from_points(
    uv: Any,
    p_field: Any,
    *,
    camera: Camera | None = None,
    image_size: tuple[int, int] | None = None,
    camera_height: float | None = None,
    radial: int = 0,
    size: tuple[float, float] | None = None,
    names: Sequence[str] | None = None,
    method: str = "corners",
) -> FieldCalibration:
    """Find the field from points whose places are known.

    Parameters
    ----------
    uv : (n, 2) array
        Pixels, four or more.
    p_field : (n, 2) or (n, 3) array
        Where they are on the field [m]; the third is the height above it.
    camera : Camera, optional
        The lens; one is assumed if it is not given.
    image_size : (int, int), optional
        Width and height of the image [px]; needed without `camera`.
    camera_height : float, optional
        Height of the camera above the field [m]; without `camera`, this settles the focal length.
    radial : int
        Without `camera`: how many radial coefficients of distortion to find, 0 to 2; needs six points or more.
    size : (float, float), optional
        Length and width of the field [m]; the extent of the points if not given.
    names : list of str, optional
        Of the points; points with one name are left out together.
    method : str
        How the points were found, for the report.

    Returns
    -------
    FieldCalibration
        The view of the field, and how far each point is off.

    Raises
    ------
    ArrayError
        Shapes or numbers are wrong.
    VisionError
        The points are too few, on one line, in mirrored or crossed order, or do not fit.
    """
    pixels, places = stack(uv, (2,), "uv"), _places(p_field)
    if pixels.ndim != 2 or len(pixels) != len(places):
        raise ArrayError(
            f"uv and p_field must have one row for each point, got shapes {pixels.shape} and {places.shape}"
        )
    labels = [f"point {i + 1}" for i in range(len(pixels))] if names is None else [str(n) for n in names]
    if len(labels) != len(pixels):
        raise ArrayError(f"names must name each of {len(pixels)} points, got {len(labels)}")
    _check_points(pixels, places)
    lens = _Lens(camera, _size_of(camera, image_size), camera_height, radial)
    if radial and len(pixels) < 6:
        raise VisionError(
            f"radial distortion needs six points or more, got {len(pixels)}; give the camera, or radial 0"
        )

    def miss(x: FloatArray, rows: Any) -> FloatArray:
        return np.asarray(np.nan_to_num(pixels[rows] - lens.project(x, places[rows]), nan=1e4)).reshape(-1)

    everything = np.arange(len(pixels))
    x = _solve_points(lens, pixels, places, lambda x: miss(x, everything))
    view = lens.view(x)
    residual = miss(x, everything).reshape(-1, 2)
    error = _errors(view, pixels, places)
    if not np.isfinite(error).all() or _rms(error) > 0.2 * _extent(places):
        raise VisionError(
            f"the points do not fit any view of the field: {_rms(error) * 1e3:.0f} mm RMS; is each pixel beside its own place, in metres?"
        )
    left_out: dict[str, float] = {}
    for name in dict.fromkeys(labels):
        rows = np.array([label != name for label in labels])
        if 2 * rows.sum() <= len(x) or _flatness(places[rows, :2]) < _FLAT:
            left_out = {}
            break
        fit = least_squares(lambda x, rows=rows: miss(x, rows), x, x_scale="jac", method="trf")
        left_out[name] = _rms(_errors(lens.view(fit.x), pixels[~rows], places[~rows]))
    extent = size or (float(np.ptp(places[:, 0])), float(np.ptp(places[:, 1])))
    return FieldCalibration(
        view,
        pixels,
        places,
        residual,
        error,
        left_out,
        method,
        lens.assumed(),
        (_rectangle(extent, places, size),),
        extent,
    )


def from_lines(
    image: NDArray[np.uint8],
    model: FieldLines,
    *,
    camera: Camera | None = None,
    start: FieldView | None = None,
    camera_height: float | None = None,
    radial: int = 1,
    search: float | None = None,
) -> FieldCalibration:
    """Find the field from its lines.

    Parameters
    ----------
    image : (height, width, 3) or (height, width) uint8 array
        Lines are lighter than the floor.
    model : FieldLines
        Where the lines are.
    camera : Camera, optional
        The lens; one with `radial` coefficients is found with the pose if it is not given.
    start : FieldView, optional
        Roughly where the field is, from `from_points` with four rough corners. If not given, it is looked for, taken only if the lines leave no
        doubt, and x of the field is then what goes more to the right of the image than to the left.
    camera_height, radial
        As in `from_points`.
    search : float, optional
        How far from the start lines are looked for [px]; a twentieth of the image by default.

    Returns
    -------
    FieldCalibration
        The view of the field, and how far each point is off.

    Raises
    ------
    VisionError
        The lines were not found, or leave a doubt.
    """
    gray = smoothed(image)
    size = (gray.shape[1], gray.shape[0])
    if _size_of(camera, size) != size:
        raise VisionError(_other_size(camera, size))
    wide = float(search or max(size) / 20)
    lens = _Lens(camera, size, camera_height, radial)
    free, coefficients = lens.free_focal and camera_height is None, lens.radial
    if free:
        lens.focal = _ASSUMED_FOCAL
    lens.radial = 0  # the pose first, or the lens would bend towards the wrong lines
    if start is not None:
        x, points = _follow(lens, gray, model, lens.parameters(start), _narrowing(wide))
        if points.explained < _EXPLAINED:
            raise VisionError(
                f"only {points.explained:.0%} of the lines of {model.name} were seen near the corners that were given; "
                "are the corners right, and the lines lighter than the floor?"
            )
    else:
        x, points = _automatic(lens, gray, model, wide)
    if coefficients and camera is None:
        lens.radial = coefficients
        x = np.concatenate([x, np.zeros(coefficients)])
        x, points = _follow(lens, gray, model, x, _narrowing(wide / 4))
    if free:
        x = _with_focal(lens, points, x)
    x, points = _follow(lens, gray, model, x, [_NARROWEST], most=_FINE)
    across = _across(lens, x, points)
    left_out = {}
    for i in np.unique(points.line):
        rows = points.line != i
        fit = _line_fit(lens, points, x, rows, most=10).x
        left_out[model.lines[i].name] = _rms((_across(lens, fit, points) * points.scale)[~rows])
    return FieldCalibration(
        lens.view(x),
        points.uv,
        points.p_field,
        across[:, None] * points.normal,
        np.abs(across) * points.scale,
        left_out,
        "lines",
        lens.assumed(),
        tuple(np.pad(_dense(line.points), ((0, 0), (0, 1)), constant_values=line.height) for line in model.lines),
        (model.length, model.width),
        (f"lines  {points.explained:.0%} of {points.looked} points of {model.name} seen",),
    )


def _with_focal(lens: _Lens, points: LinePoints, x: FloatArray) -> FloatArray:
    """Find the focal length too, if the lines tell it; the shift grows with it."""
    lens.focal = None
    freed = np.concatenate([x[:6], [np.log(_ASSUMED_FOCAL)], x[6:]])
    fit = _line_fit(lens, points, freed, most=200)
    together = len(points.uv) / len(np.unique(points.line))  # a line that is painted askew is askew in all its points
    if not _is_vague(fit, together):
        return np.asarray(fit.x)
    lens.focal = _ASSUMED_FOCAL
    return x


@dataclass(frozen=True)
class Tag:
    """An AprilTag on the field: its number, the middle of it and its height [m], the turn of its upper edge [rad], and its side [m]."""

    number: int
    x: float
    y: float
    z: float
    yaw: float
    side: float

    @property
    def corners(self) -> FloatArray:
        """Upper left, upper right, lower right, lower left of its print, ``(4, 3)``."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        square = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * self.side / 2
        return np.pad(square @ np.array([[c, s], [-s, c]]) + (self.x, self.y), ((0, 0), (0, 1)), constant_values=self.z)


def load_tags(path: str | Path) -> tuple[Tag, ...]:
    """Read where tags lie: ``family: 36h11``, a ``size`` for all or for each, and ``tags`` with ``id, x, y, z, yaw``.

    Lengths are metres, or millimetres where the key ends in ``_mm``; `yaw` is in radians, `yaw_deg` in degrees.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is malformed: the message names file, line and field.
    """
    top = read_yaml(path)
    top.only("family", "size", "size_mm", "tags")
    family = top.text("family", "36h11").lower().removeprefix("tag").replace("_", "")
    if family not in ("36h11", "apriltag36h11"):
        raise top.error("family", f"must be 36h11, got {family!r}")
    common = _length(top, "size", None)
    tags: dict[int, Tag] = {}
    for row in top.sections("tags"):
        row.only("id", "x", "x_mm", "y", "y_mm", "z", "z_mm", "yaw", "yaw_deg", "size", "size_mm")
        number = row.integer("id", least=0, most=586)
        if number in tags:
            raise row.error("id", f"tag {number} is there twice")
        side = _length(row, "size", common)
        if side is None:
            raise row.error("size", "is missing, here or for all tags: the side of the black square [m]")
        if side <= 0:
            raise row.error("size", f"must be positive, got {side:g}")
        if "yaw" in row and "yaw_deg" in row:
            raise row.error("yaw", "is given in radians and in degrees; give one")
        yaw = np.radians(row.number("yaw_deg")) if "yaw_deg" in row else row.number("yaw", 0.0)
        x, y, z = (_length(row, "x"), _length(row, "y"), _length(row, "z", 0.0))
        tags[number] = Tag(number, x or 0.0, y or 0.0, z or 0.0, float(yaw), side)
    if not tags:
        raise top.error("tags", "is empty; one tag at least")
    return tuple(tags.values())


def find_tags(image: NDArray[np.uint8]) -> dict[int, FloatArray]:
    """Find AprilTags of the family 36h11: corners ``(4, 2)`` of each by its number [px], upper left first and clockwise.

    Raises
    ------
    VisionError
        A number is in the image twice.
    """
    cv2 = opencv("finding AprilTags")
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family, settings).detectMarkers(gray)
    found: dict[int, FloatArray] = {}
    for number, uv in zip([] if ids is None else np.ravel(ids), corners, strict=True):
        if int(number) in found:
            raise VisionError(f"tag {number} is in the image twice; each number must be there once")
        found[int(number)] = np.asarray(uv, dtype=np.float64).reshape(4, 2)
    return found


def from_tags(
    image: NDArray[np.uint8],
    tags: Sequence[Tag],
    *,
    camera: Camera | None = None,
    camera_height: float | None = None,
    radial: int = 0,
    size: tuple[float, float] | None = None,
) -> FieldCalibration:
    """Find the field from AprilTags of known places in an image (height, width) or (height, width, 3); the arguments are those of `from_points`.

    Raises
    ------
    VisionError
        No tag was found, one is there twice, or their places do not fit.
    """
    shape = (int(image.shape[1]), int(image.shape[0]))
    if _size_of(camera, shape) != shape:
        raise VisionError(_other_size(camera, shape))
    seen = find_tags(image)
    known = [tag for tag in tags if tag.number in seen]
    if not known:
        others = f"; the image has {sorted(seen)}" if seen else ""
        raise VisionError(f"none of the tags {sorted(tag.number for tag in tags)} was found in the image{others}")
    result = from_points(
        np.concatenate([seen[tag.number] for tag in known]),
        np.concatenate([tag.corners for tag in known]),
        camera=camera,
        image_size=shape,
        camera_height=camera_height,
        radial=radial,
        size=size,
        names=[f"tag {tag.number}" for tag in known for _ in range(4)],
        method="tags",
    )
    missing = sorted(tag.number for tag in tags if tag.number not in seen)
    notes = (f"tags  {len(known)} of {len(tags)} seen" + (f"; not seen: {missing}" if missing else ""),)
    outlines = (*result.outlines, *(np.concatenate([tag.corners, tag.corners[:1]]) for tag in known))
    return replace(result, outlines=outlines, notes=notes)


class _Lens:
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
        return self.camera is None and self.focal is None

    def view(self, x: FloatArray) -> FieldView:
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
            rays = (pixels - (np.array(self.size) - 1) / 2) / (self.size[0] * (focal or _ASSUMED_FOCAL))
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
                x.append(float(np.log(focal or _ASSUMED_FOCAL)))
            x += [0.0] * self.radial
        return np.array(x)

    def high(self, x: FloatArray) -> FloatArray:
        """What the height of the camera misses, as a miss among those in pixels; empty if it is not given."""
        if self.height is None or self.camera is not None:
            return np.empty(0)
        T = self.view(x).T_camera_field
        return np.array([(-(T[:3, 2] @ T[:3, 3]) - self.height) / self.height * 1e4])

    def assumed(self) -> tuple[str, ...]:
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


def _solve_points(
    lens: _Lens, pixels: FloatArray, places: FloatArray, miss: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    def all_misses(x: FloatArray) -> FloatArray:
        return np.concatenate([miss(x), lens.high(x)])

    starts = [lens.guess(pixels, places, f) for f in (_FOCALS if lens.free_focal else (None,))]
    fits = [
        least_squares(all_misses, x, x_scale="jac", method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14) for x in starts
    ]
    fit = min(fits, key=lambda fit: float(fit.cost))
    if lens.free_focal and lens.height is None and _is_vague(fit):
        lens.focal = _ASSUMED_FOCAL
        return _solve_points(lens, pixels, places, miss)
    return np.asarray(fit.x)


def _is_vague(fit: Any, together: float = 1.0) -> bool:
    """Whether the focal length could as well be quite another; `together` is how many points miss as one."""
    J = np.asarray(fit.jac)
    spare = max(len(J) - J.shape[1], 0)
    sigma = np.sqrt(2 * fit.cost / spare) if spare > 8 else max(_PIXEL, np.sqrt(2 * fit.cost / max(spare, 1)))
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    deviation = sigma * np.linalg.norm(Vt[:, 6] / np.maximum(s, 1e-9 * s[0])) * np.sqrt(together)
    return bool(deviation > _VAGUE) or not -1.6 < fit.x[6] < 2.3


def _line_fit(lens: _Lens, points: LinePoints, x: FloatArray, rows: Any = slice(None), most: int = 30) -> Any:
    p, uv, normal = points.p_field[rows], points.uv[rows], points.normal[rows]

    def miss(x: FloatArray) -> FloatArray:
        away = ((uv - lens.project(x, p)) * normal).sum(axis=-1)
        return np.concatenate([np.nan_to_num(away, nan=1e3), lens.high(x)])

    return least_squares(miss, x, x_scale="jac", loss="soft_l1", f_scale=_LOSS, max_nfev=most)


def _across(lens: _Lens, x: FloatArray, points: LinePoints) -> FloatArray:
    """How far points are from their lines, across them [px]."""
    away = points.uv - lens.project(x, points.p_field)
    return np.asarray((away * points.normal).sum(axis=-1))


def _follow(
    lens: _Lens, gray: FloatArray, model: FieldLines, x: FloatArray, searches: Sequence[float], most: int = _COARSE
) -> tuple[FloatArray, LinePoints]:
    """Fit to the lines that are seen near where they should be, nearer and nearer."""
    for search in searches:
        for _ in range(_ROUND):
            points = find_lines(gray, model, lens.view(x), search, most=most)
            if len(points.uv) < 20 or len(np.unique(points.line)) < 2:
                return x, points
            new = np.asarray(_line_fit(lens, points, x).x)
            moved = np.abs(lens.project(new, points.p_field) - lens.project(x, points.p_field))
            x = new
            if not np.nanmax(moved) > 0.02 * search:
                break
    return x, find_lines(gray, model, lens.view(x), _NARROWEST, most=most)


def _narrowing(wide: float) -> list[float]:
    searches = [wide]
    while searches[-1] > _NARROWEST:
        searches.append(max(searches[-1] / 1.8, _NARROWEST))
    return searches


def _automatic(lens: _Lens, gray: FloatArray, model: FieldLines, wide: float) -> tuple[FloatArray, LinePoints]:
    """Try the outlines of what is light and thin and large; take the one that explains the lines, if no other does nearly as well."""
    tried: dict[int, list[tuple[float, FloatArray]]] = {0: [], 1: []}
    for quad in _outlines(gray):
        for turn, found in tried.items():
            for longer in (0.0, 0.2) if model.length < 3 else (0.0,):  # with the goals
                x, y = (model.length + longer) / 2, model.width / 2
                corners = np.array([[-x, y], [x, y], [x, -y], [-x, -y]])
                try:
                    start = lens.guess(np.roll(quad, turn, axis=0), np.pad(corners, ((0, 0), (0, 1))), None)
                    fit, points = _follow(lens, gray, model, start, [wide, wide / 2], most=_FIRST_LOOK)
                except (VisionError, ArrayError):
                    continue
                found.append((points.explained if len(points.uv) else 0.0, fit))
    shares = [0.0, 0.0]
    fits: list[Any] = [None, None]
    for turn, found in tried.items():
        for _, start in sorted(found, key=lambda one: -one[0])[:_FINALISTS]:
            fit, points = _follow(lens, gray, model, start, _narrowing(wide))
            if points.explained > shares[turn]:
                shares[turn], fits[turn] = points.explained, (fit, points)
    best = int(shares[1] > shares[0])
    if shares[best] < _AUTOMATIC or shares[best] - shares[1 - best] < _AHEAD:
        raise VisionError(
            f"the lines of {model.name} leave a doubt: {shares[best]:.0%} are explained, and {shares[1 - best]:.0%} with the field turned by a "
            "quarter; give four rough corners, as in --corner u,v=x,y"
        )
    fit, points = fits[best]
    return fit, points


def _outlines(gray: FloatArray) -> list[FloatArray]:
    """Quadrilaterals around large light thin things: upper left, upper right, lower right, lower left [px]."""
    cv2 = opencv("looking for a field")
    low = np.clip(gray, 0, 255).astype(np.uint8)
    side = max(9, (low.shape[1] // 60) | 1)
    thin = cv2.morphologyEx(low, cv2.MORPH_TOPHAT, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    _, mask = cv2.threshold(thin, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    spans = stats[1:, cv2.CC_STAT_WIDTH].astype(float) * stats[1:, cv2.CC_STAT_HEIGHT]
    found = []
    for number in np.argsort(-spans)[:3]:
        if spans[number] < 0.1 * low.size:
            continue
        points = np.argwhere(labels == number + 1)[:, ::-1].astype(np.float32)
        hull = cv2.convexHull(points)
        found.append(cv2.boxPoints(cv2.minAreaRect(hull)))
        for share in np.arange(0.02, 0.2, 0.02):
            quad = cv2.approxPolyDP(hull, share * cv2.arcLength(hull, True), True)
            if len(quad) == 4:
                found.append(quad.reshape(4, 2))
                break
    return [_clockwise(np.asarray(quad, dtype=np.float64)) for quad in found]


def _clockwise(quad: FloatArray) -> FloatArray:
    """As the eye goes round, from the upper left."""
    away = quad - quad.mean(axis=0)
    quad = quad[np.argsort(np.arctan2(away[:, 1], away[:, 0]))]
    return np.roll(quad, -int((quad @ (1.0, 1.0)).argmin()), axis=0)


def _check_points(pixels: FloatArray, places: FloatArray) -> None:
    if len(pixels) < 4:
        raise VisionError(f"four points are needed, got {len(pixels)}")
    for what, points, unit in (("pixels", pixels, "px"), ("places", places[:, :2], "m")):
        if _flatness(points) < _FLAT:
            raise VisionError(
                f"the {what} lie on one line (within {100 * _flatness(points):.2g} % of its length): {_shown(points, unit)}"
            )
        if len(points) == 4:
            for i in range(4):
                if _flatness(np.delete(points, i, axis=0)) < _FLAT:
                    raise VisionError(
                        f"three of the four {what} lie on one line: {_shown(np.delete(points, i, axis=0), unit)}; a field needs four corners"
                    )
    cv2 = opencv("the pose of a field")
    H, _ = cv2.findHomography(places[:, :2], pixels)
    if H is None:
        raise VisionError("no view of a plane maps these places to these pixels")
    w = places[:, :2] @ H[2, :2] + H[2, 2]
    if (w > 0).all() != (w > 0).any():
        raise VisionError(
            "the corners are in crossed order: two of them seem to be exchanged; give each pixel the place of the corner that is seen there"
        )
    if np.linalg.det(H) * np.sign(w[0]) ** 3 > 0:
        raise VisionError(
            "the corners are in mirrored order: the field would be seen from below; seen from above, y is a quarter turn against the clock from x"
        )


def _shown(points: FloatArray, unit: str) -> str:
    return ", ".join(f"({x:g}, {y:g})" for x, y in points) + f" {unit}"


def _flatness(points: FloatArray) -> float:
    s = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(s[1] / s[0]) if len(s) > 1 and s[0] > 0 else 0.0


def _places(p_field: Any) -> FloatArray:
    p = np.asarray(p_field)
    if p.ndim == 2 and p.shape[1] == 2:
        return np.pad(stack(p_field, (2,), "p_field"), ((0, 0), (0, 1)))
    places = stack(p_field, (3,), "p_field")
    if places.ndim != 2:
        raise ArrayError(f"p_field must have shape (n, 2) or (n, 3), got {places.shape}")
    return places


def _size_of(camera: Camera | None, size: tuple[int, int] | None) -> tuple[int, int]:
    if camera is not None:
        return camera.size
    if size is None:
        raise VisionError("without a camera, the size of the image is needed")
    return int(size[0]), int(size[1])


def _other_size(camera: Camera | None, size: tuple[int, int]) -> str:
    expected = camera.size if camera is not None else (0, 0)
    return (
        f"the image is {size[0]} x {size[1]} pixels and the camera is calibrated for {expected[0]} x {expected[1]}; "
        "calibrate it at the resolution that is used"
    )


def _errors(view: FieldView, pixels: FloatArray, places: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*(view.to_field(pixels, height=places[:, 2]) - places[:, :2]).T))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((np.asarray(values) ** 2).mean()))


def _extent(places: FloatArray) -> float:
    return float(np.ptp(places[:, :2], axis=0).max())


def _rectangle(extent: tuple[float, float], places: FloatArray, size: tuple[float, float] | None) -> FloatArray:
    """Outline of the field: about the origin if its size is known, else about the points."""
    middle = np.zeros(2) if size is not None else (places[:, :2].min(axis=0) + places[:, :2].max(axis=0)) / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * np.array(extent) / 2 + middle
    p = _dense(corners)
    return np.pad(p, ((0, 0), (0, 1)))


def _dense(corners: FloatArray, pieces: int = 24) -> FloatArray:
    """A polyline in short pieces, so that distortion shows."""
    t = np.arange(pieces)[:, None] / pieces
    parts = [a + t * (b - a) for a, b in pairwise(corners)]
    return np.concatenate([*parts, corners[-1:]])


def _length(row: Section, key: str, default: Any = ...) -> float | None:
    """A length in metres, from ``key`` or, in millimetres, from ``key_mm``."""
    millimetres = f"{key}_mm"
    if key in row and millimetres in row:
        raise row.error(key, "is given in metres and in millimetres; give one")
    if millimetres in row:
        return row.number(millimetres, least=-1e6, most=1e6) / 1e3
    if default is not ... and key not in row:
        return default  # type: ignore[no-any-return]
    return row.number(key, least=-1e3, most=1e3)
