"""The lines of a field: where they are in metres, and where they are in an image to a fraction of a pixel.

The origin is the middle of the field, x along its length, y to the left of x, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from pieper.errors import VisionError, unknown_name
from pieper.yaml_file import Section, read_yaml

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from pieper.perception.field_view import FieldView
    from pieper.spatial._checks import FloatArray

_STEP = 0.5  # px between samples across a line
_SMOOTHING = 0.7  # px
_CONTRAST = 0.35  # of the contrast that the clearest lines have
_EPSILON = 1e-4  # m, to either side of a line, for its direction in the image


@dataclass(frozen=True, eq=False)
class FieldLine:
    """A line that is painted on the field, or on a wall around it: points ``(n, 2)`` along its middle, its width, and its height [m]."""

    name: str
    points: FloatArray
    width: float
    height: float = 0.0

    def along(self, spacing: float) -> tuple[FloatArray, FloatArray]:
        """Return points about `spacing` apart [m] and the unit normals there, ``(m, 2)`` each; its ends, where others cross, are left out."""
        steps = np.diff(self.points, axis=0)
        lengths = np.hypot(*steps.T)
        total = float(lengths.sum())
        count = max(int(total / spacing), 2)
        at = (np.arange(count) + 0.5) / count * total
        segment = np.clip(np.searchsorted(np.cumsum(lengths), at), 0, len(lengths) - 1)
        rest = at - (np.cumsum(lengths) - lengths)[segment]
        tangent = steps[segment] / lengths[segment, None]
        p = self.points[segment] + rest[:, None] * tangent
        return p, np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)


@dataclass(frozen=True, eq=False)
class FieldLines:
    """All lines of a field, its length and its width [m].

    Examples
    --------
    >>> lines("vsss").length
    1.5
    """

    name: str
    length: float
    width: float
    lines: tuple[FieldLine, ...]

    def is_white(self, p_field: FloatArray) -> NDArray[np.bool_]:
        """Return whether points ``(..., 2)`` lie on a line."""
        p = np.asarray(p_field, dtype=np.float64)
        white = np.zeros(p.shape[:-1], dtype=bool)
        for line in self.lines:
            low, high = line.points.min(axis=0) - line.width, line.points.max(axis=0) + line.width
            near = ((p >= low) & (p <= high)).all(axis=-1)
            q = p[near]
            apart = np.full(len(q), np.inf)
            for a, b in zip(line.points[:-1], line.points[1:], strict=True):
                t = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
                apart = np.minimum(apart, np.hypot(*(q - a - t[:, None] * (b - a)).T))
            white[near] |= apart <= line.width / 2
        return white


def lines(name: str | Path) -> FieldLines:
    """Return the lines of a known field, or those in a YAML file.

    Parameters
    ----------
    name : str or Path
        ``vsss`` (1.5 x 1.3 m), ``ssl-a`` (12 x 9 m), ``ssl-b`` (9 x 6 m), or a ``.yaml`` file with ``length``, ``width``, ``line_width``, and lists
        ``lines`` of ``name, from, to`` and ``circles`` of ``name, centre, radius`` (and ``begin, end``, angles [rad], for an arc); each may have a
        ``height`` above the floor, as the top of a wall has, and a ``line_width`` of its own.

    Raises
    ------
    VisionError
        The file is malformed.
    UnknownNameError
        No such field.
    """
    known: dict[str, Callable[[], FieldLines]] = {
        "vsss": _vsss,
        "ssl-a": lambda: _ssl("ssl-a", 12.0, 9.0, 1.8, 3.6),
        "ssl-b": lambda: _ssl("ssl-b", 9.0, 6.0, 1.0, 2.0),
    }
    if str(name) in known:
        return known[str(name)]()
    if Path(name).suffix.lower() in (".yaml", ".yml"):
        return _from_file(Path(name))
    raise unknown_name("field", str(name), [*known, "or a .yaml file"])


def _segment(name: str, a: Any, b: Any, width: float) -> FieldLine:
    return FieldLine(name, np.array([a, b], dtype=np.float64), width)


def _arc(name: str, centre: Any, radius: float, width: float, begin: float = 0.0, end: float = 2 * np.pi) -> FieldLine:
    angle = np.linspace(begin, end, max(round(abs(end - begin) / np.radians(3)), 8) + 1)
    # The chords are as far outside the circle in the middle of the arc as they are inside at its ends.
    r = radius * 2 / (1 + np.cos((angle[1] - angle[0]) / 2))
    return FieldLine(name, np.asarray(centre) + r * np.stack([np.cos(angle), np.sin(angle)], axis=-1), width)


def _vsss() -> FieldLines:
    """IEEE Very Small Size Soccer, three against three: corners are cut by 70 mm; lines are 3 mm, in practice up to 10."""
    x, y, cut, w = 0.75, 0.65, 0.07, 0.006
    found = [
        _segment("centre line", (0, -y), (0, y), w),
        _arc("centre circle", (0, 0), 0.2, w),
    ]
    for side, word in ((-1, "left"), (1, "right")):
        inner = side * (x - 0.15)
        found += [
            _segment(f"{word} area, front", (inner, -0.35), (inner, 0.35), w),
            _segment(f"{word} area, lower", (inner, -0.35), (side * x, -0.35), w),
            _segment(f"{word} area, upper", (inner, 0.35), (side * x, 0.35), w),
            _segment(f"{word} border", (side * x, -y + cut), (side * x, y - cut), w),
        ]
    found += [
        _segment("lower border", (-x + cut, -y), (x - cut, -y), w),
        _segment("upper border", (-x + cut, y), (x - cut, y), w),
    ]
    return FieldLines("vsss", 2 * x, 2 * y, tuple(found))


def _ssl(name: str, length: float, width: float, depth: float, across: float) -> FieldLines:
    """RoboCup Small Size League: lines of 10 mm, a centre circle of 1 m, defence areas, and a line from goal to goal."""
    x, y, w = length / 2, width / 2, 0.01
    found = [
        _segment("centre line", (0, -y), (0, y), w),
        _segment("goal to goal", (-x, 0), (x, 0), w),
        _arc("centre circle", (0, 0), 0.5, w),
        _segment("lower border", (-x, -y), (x, -y), w),
        _segment("upper border", (-x, y), (x, y), w),
    ]
    for side, word in ((-1, "left"), (1, "right")):
        inner = side * (x - depth)
        found += [
            _segment(f"{word} border", (side * x, -y), (side * x, y), w),
            _segment(f"{word} area, front", (inner, -across / 2), (inner, across / 2), w),
            _segment(f"{word} area, lower", (inner, -across / 2), (side * x, -across / 2), w),
            _segment(f"{word} area, upper", (inner, across / 2), (side * x, across / 2), w),
        ]
    return FieldLines(name, length, width, tuple(found))


def _painted(row: Section, line: FieldLine) -> FieldLine:
    height = row.number("height", 0.0, least=0.0, most=10.0)
    return replace(line, width=row.number("line_width", line.width, least=1e-4, most=1.0), height=height)


def _from_file(path: Path) -> FieldLines:
    top = read_yaml(path)
    top.only("length", "width", "line_width", "lines", "circles")
    length, width = top.number("length", least=1e-3, most=1e3), top.number("width", least=1e-3, most=1e3)
    w = top.number("line_width", least=1e-4, most=1.0)
    found = []
    for i, row in enumerate(top.sections("lines", [])):
        row.only("name", "from", "to", "height", "line_width")
        a, b = row.array("from", (2,)), row.array("to", (2,))
        if np.hypot(*(b - a)) < w:
            raise row.error("to", "is where the line begins; a line has a length")
        found.append(_painted(row, _segment(row.text("name", f"line {i + 1}"), a, b, w)))
    for i, row in enumerate(top.sections("circles", [])):
        row.only("name", "centre", "radius", "begin", "end", "height", "line_width")
        begin, end = row.number("begin", 0.0), row.number("end", 2 * np.pi)
        if not 0 < end - begin <= 2 * np.pi + 1e-9:
            raise row.error("end", "must be after the beginning, by a full turn (6.2832) at most")
        centre, radius = row.array("centre", (2,)), row.number("radius", least=w)
        found.append(_painted(row, _arc(row.text("name", f"circle {i + 1}"), centre, radius, w, begin, end)))
    if len(found) < 2:
        raise top.error("lines", "a field needs two lines or circles at least")
    return FieldLines(path.stem, length, width, tuple(found))


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Points of lines as they were seen.

    Attributes
    ----------
    line : (n,) int array
        Rows of `FieldLines.lines`.
    p_field : (n, 3) array
        Where on the line the search began [m].
    normal : (n, 2) array
        Unit normals in the image.
    uv : (n, 2) array
        Where the middle of the line was seen [px].
    scale : (n,) array
        Metres of the field per pixel, across the line.
    looked : int
        Points that were looked for inside the image.
    """

    line: NDArray[np.int64]
    p_field: FloatArray
    normal: FloatArray
    uv: FloatArray
    scale: FloatArray
    looked: int

    @property
    def explained(self) -> float:
        """Share of the points that were found."""
        return len(self.uv) / max(self.looked, 1)


def find_lines(gray: FloatArray, model: FieldLines, view: FieldView, search: float, *, most: int = 1500) -> LinePoints:
    """Find the lines of a field near where a view says that they are.

    Across each line the brightness is compared with a bar of the line's width between two dark flanks, and the place where the lesser of the two
    steps is greatest is refined by a parabola.

    Parameters
    ----------
    gray : (height, width) array
        Smoothed brightness, see `smoothed`.
    model : FieldLines
    view : FieldView
        Roughly where the field is.
    search : float
        How far to look to either side [px].
    most : int
        Points that are looked for at most; without that, every 2.5 px.
    """
    height, width = gray.shape
    centre = np.array([[width / 2, height / 2]])
    middle = view.to_field(centre)[0]
    per_pixel = float(np.abs(view.jacobian(centre)).max()) if np.isfinite(middle).all() else model.length / width
    total = sum(float(np.hypot(*np.diff(line.points, axis=0).T).sum()) for line in model.lines)
    index, points, normals, widths = [], [], [], []
    for i, line in enumerate(model.lines):
        p, n = line.along(max(2.5 * per_pixel, total / most))
        index.append(np.full(len(p), i))
        points.append(p)
        normals.append(n)
        widths.append(np.full((len(p), 2), (line.width, line.height)))
    which, p, n, w_h = (np.concatenate(part) for part in (index, points, normals, widths))
    w, h = w_h.T
    uv = view.to_image(p, height=h)
    across = (view.to_image(p + _EPSILON * n, height=h) - view.to_image(p - _EPSILON * n, height=h)) / (2 * _EPSILON)
    p = np.concatenate([p, h[:, None]], axis=1)
    size = np.hypot(*across.T)
    inside = np.isfinite(uv).all(axis=-1) & np.isfinite(size) & (size > 0)
    inside &= (uv > 3).all(axis=-1) & (uv < (width - 4, height - 4)).all(axis=-1)
    which, p, uv, across, size, w = (part[inside] for part in (which, p, uv, across, size, w))
    normal = across / size[:, None]
    offsets = np.arange(-np.ceil(search / _STEP), np.ceil(search / _STEP) + 1) * _STEP
    half = np.maximum(w * size / 2, 1.0)  # px
    flank = half + np.maximum(half, 2.0)

    def brightness(shift: FloatArray) -> FloatArray:
        at = uv[:, None] + (offsets + shift[:, None])[..., None] * normal[:, None]
        return np.asarray(map_coordinates(gray, [at[..., 1], at[..., 0]], order=1, mode="nearest"))

    zero = np.zeros(len(uv))
    inner = (brightness(zero) + brightness(half / 2) + brightness(-half / 2)) / 3
    response = inner - np.maximum(brightness(flank), brightness(-flank))
    if not len(uv):
        return LinePoints(which, p, normal, uv, size, 0)
    best = response.argmax(axis=1)
    top = response[np.arange(len(uv)), best]
    clear = _CONTRAST * np.quantile(top, 0.8)
    kept = (top > max(clear, 1.0)) & (best > 0) & (best < len(offsets) - 1)
    row, column = np.flatnonzero(kept), best[kept]
    before, at, after = (response[row, column + k] for k in (-1, 0, 1))
    bend = before - 2 * at + after
    peak = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    moved = (offsets[column] + np.clip(peak, -1, 1) * _STEP)[:, None] * normal[kept]
    return LinePoints(which[kept], p[kept], normal[kept], uv[kept] + moved, 1 / size[kept], len(uv))


def smoothed(image: NDArray[np.uint8]) -> FloatArray:
    """Brightness of an image, ``(height, width)``, a little smoothed."""
    if image.ndim not in (2, 3):
        raise VisionError(f"an image has shape (height, width, 3) or (height, width), got {image.shape}")
    gray = image.astype(np.float64) if image.ndim == 2 else image[..., :3].astype(np.float64).mean(axis=-1)
    return np.asarray(gaussian_filter(gray, _SMOOTHING))
