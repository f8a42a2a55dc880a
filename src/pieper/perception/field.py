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

from pieper._version import __version__
from pieper.errors import ArrayError, VisionError
from pieper.perception.calibration_file import save_view
from pieper.perception.field_lens import ASSUMED_FOCAL, Lens, is_vague, other_size, size_of, solve_points
from pieper.perception.field_lines import FieldLines, LinePoints, smoothed
from pieper.perception.field_search import FINE, NARROWEST, across_lines, automatic, follow_lines, line_fit, narrowing
from pieper.perception.opencv import opencv
from pieper.perception.tags import Tag, find_tags, load_tags
from pieper.spatial._checks import stack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.perception.camera import Camera
    from pieper.perception.field_view import FieldView
    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

__all__ = ["FieldCalibration", "Tag", "find_tags", "from_lines", "from_points", "from_tags", "load_tags"]

_FLAT = 0.01  # width over length of points: less is a line
_EXPLAINED = 0.4  # share of the lines that has to be seen, with a hint


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
    pixels, places, labels = _named_points(uv, p_field, names)
    _check_points(pixels, places)
    lens = Lens(camera, size_of(camera, image_size), camera_height, radial)
    if radial and len(pixels) < 6:
        raise VisionError(
            f"radial distortion needs six points or more, got {len(pixels)}; give the camera, or radial 0"
        )

    def miss(x: FloatArray, rows: Any = slice(None)) -> FloatArray:
        return np.asarray(np.nan_to_num(pixels[rows] - lens.project(x, places[rows]), nan=1e4)).reshape(-1)

    x = solve_points(lens, pixels, places, miss)
    error = _errors(lens.view(x), pixels, places)
    if not np.isfinite(error).all() or _rms(error) > 0.2 * _extent(places):
        raise VisionError(
            f"the points do not fit any view of the field: {_rms(error) * 1e3:.0f} mm RMS; is each pixel beside its own place, in metres?"
        )
    extent = size or (float(np.ptp(places[:, 0])), float(np.ptp(places[:, 1])))
    return FieldCalibration(
        lens.view(x),
        pixels,
        places,
        miss(x).reshape(-1, 2),
        error,
        _left_out_in_turn(lens, pixels, places, labels, x, miss),
        method,
        lens.assumed(),
        (_rectangle(extent, places, size),),
        extent,
    )


def _named_points(uv: Any, p_field: Any, names: Sequence[str] | None) -> tuple[FloatArray, FloatArray, list[str]]:
    """Pixels (n, 2), places (n, 3) [m], and what each point is called."""
    pixels, places = stack(uv, (2,), "uv"), _places(p_field)
    if pixels.ndim != 2 or len(pixels) != len(places):
        raise ArrayError(
            f"uv and p_field must have one row for each point, got shapes {pixels.shape} and {places.shape}"
        )
    labels = [f"point {i + 1}" for i in range(len(pixels))] if names is None else [str(n) for n in names]
    if len(labels) != len(pixels):
        raise ArrayError(f"names must name each of {len(pixels)} points, got {len(labels)}")
    return pixels, places, labels


def _left_out_in_turn(
    lens: Lens,
    pixels: FloatArray,
    places: FloatArray,
    labels: Sequence[str],
    x: FloatArray,
    miss: Callable[[FloatArray, Any], FloatArray],
) -> dict[str, float]:
    """RMS error [m] of the points of each name when the field is fitted without them; empty where the rest would not suffice."""
    found: dict[str, float] = {}
    for name in dict.fromkeys(labels):
        rows = np.array([label != name for label in labels])
        if 2 * rows.sum() <= len(x) or _flatness(places[rows, :2]) < _FLAT:
            return {}
        fit = least_squares(lambda x, rows=rows: miss(x, rows), x, x_scale="jac", method="trf")
        found[name] = _rms(_errors(lens.view(fit.x), pixels[~rows], places[~rows]))
    return found


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
    if size_of(camera, size) != size:
        raise VisionError(other_size(camera, size))
    wide = float(search or max(size) / 20)
    lens = Lens(camera, size, camera_height, radial)
    free, coefficients = lens.free_focal and camera_height is None, lens.radial
    if free:
        lens.focal = ASSUMED_FOCAL
    lens.radial = 0  # the pose first, or the lens would bend towards the wrong lines
    if start is not None:
        x, points = follow_lines(lens, gray, model, lens.parameters(start), narrowing(wide))
        if points.explained < _EXPLAINED:
            raise VisionError(
                f"only {points.explained:.0%} of the lines of {model.name} were seen near the corners that were given; "
                "are the corners right, and the lines lighter than the floor?"
            )
    else:
        x, points = automatic(lens, gray, model, wide)
    if coefficients and camera is None:
        lens.radial = coefficients
        x = np.concatenate([x, np.zeros(coefficients)])
        x, points = follow_lines(lens, gray, model, x, narrowing(wide / 4))
    if free:
        x = _with_focal(lens, points, x)
    x, points = follow_lines(lens, gray, model, x, [NARROWEST], most=FINE)
    across = across_lines(lens, x, points)
    left_out = {}
    for i in np.unique(points.line):
        rows = points.line != i
        fit = line_fit(lens, points, x, rows, most=10).x
        left_out[model.lines[i].name] = _rms((across_lines(lens, fit, points) * points.scale)[~rows])
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


def _with_focal(lens: Lens, points: LinePoints, x: FloatArray) -> FloatArray:
    """Find the focal length too, if the lines tell it; the shift grows with it."""
    lens.focal = None
    freed = np.concatenate([x[:6], [np.log(ASSUMED_FOCAL)], x[6:]])
    fit = line_fit(lens, points, freed, most=200)
    together = len(points.uv) / len(np.unique(points.line))  # a line that is painted askew is askew in all its points
    if not is_vague(fit, together):
        return np.asarray(fit.x)
    lens.focal = ASSUMED_FOCAL
    return x


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
    if size_of(camera, shape) != shape:
        raise VisionError(other_size(camera, shape))
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
        raise VisionError(
            "no view of a plane maps these places to these pixels; is each pixel beside its own place, in metres?"
        )
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
