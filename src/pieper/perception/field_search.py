"""Lines of a field in an image: followed from where they roughly are, or looked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares

from pieper.errors import ArrayError, VisionError
from pieper.perception.field_lines import FieldLines, LinePoints, find_lines
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.perception.field_lens import Lens
    from pieper.spatial._checks import FloatArray

_LOSS = 1.0  # px, where misses of lines begin to count less
_ROUND = 3  # fits at each width of search
_FIRST_LOOK, _COARSE, FINE = 150, 400, 1500  # points of lines
_FINALISTS = 3
NARROWEST = 5.0  # px: real lines lie a centimetre from where they should
_AUTOMATIC = 0.75  # share of the lines that has to be seen, without one
_AHEAD = 0.15  # and by how much more than with the field turned by a quarter


def line_fit(lens: Lens, points: LinePoints, x: FloatArray, rows: Any = slice(None), most: int = 30) -> Any:
    """Least squares over how far points are across their lines; large misses count less."""
    p, uv, normal = points.p_field[rows], points.uv[rows], points.normal[rows]

    def miss(x: FloatArray) -> FloatArray:
        away = ((uv - lens.project(x, p)) * normal).sum(axis=-1)
        return np.concatenate([np.nan_to_num(away, nan=1e3), lens.high(x)])

    return least_squares(miss, x, x_scale="jac", loss="soft_l1", f_scale=_LOSS, max_nfev=most)


def across_lines(lens: Lens, x: FloatArray, points: LinePoints) -> FloatArray:
    """How far points are from their lines, across them [px]."""
    away = points.uv - lens.project(x, points.p_field)
    return np.asarray((away * points.normal).sum(axis=-1))


def follow_lines(
    lens: Lens, gray: FloatArray, model: FieldLines, x: FloatArray, searches: Sequence[float], most: int = _COARSE
) -> tuple[FloatArray, LinePoints]:
    """Fit to the lines that are seen near where they should be, nearer and nearer."""
    for search in searches:
        for _ in range(_ROUND):
            points = find_lines(gray, model, lens.view(x), search, most=most)
            if len(points.uv) < 20 or len(np.unique(points.line)) < 2:
                return x, points
            new = np.asarray(line_fit(lens, points, x).x)
            moved = np.abs(lens.project(new, points.p_field) - lens.project(x, points.p_field))
            x = new
            if not np.nanmax(moved) > 0.02 * search:
                break
    return x, find_lines(gray, model, lens.view(x), NARROWEST, most=most)


def narrowing(wide: float) -> list[float]:
    """How far lines are looked for [px], from wide to narrow."""
    searches = [wide]
    while searches[-1] > NARROWEST:
        searches.append(max(searches[-1] / 1.8, NARROWEST))
    return searches


def automatic(lens: Lens, gray: FloatArray, model: FieldLines, wide: float) -> tuple[FloatArray, LinePoints]:
    """Try the outlines of what is light and thin and large; take the one that explains the lines, if no other does nearly as well."""
    tried: dict[int, list[tuple[float, FloatArray]]] = {0: [], 1: []}
    for quad in _outlines(gray):
        for turn, found in tried.items():
            for longer in (0.0, 0.2) if model.length < 3 else (0.0,):  # with the goals
                x, y = (model.length + longer) / 2, model.width / 2
                corners = np.array([[-x, y], [x, y], [x, -y], [-x, -y]])
                try:
                    start = lens.guess(np.roll(quad, turn, axis=0), np.pad(corners, ((0, 0), (0, 1))), None)
                    fit, points = follow_lines(lens, gray, model, start, [wide, wide / 2], most=_FIRST_LOOK)
                except (VisionError, ArrayError):
                    continue
                found.append((points.explained if len(points.uv) else 0.0, fit))
    shares = [0.0, 0.0]
    fits: list[Any] = [None, None]
    for turn, found in tried.items():
        for _, start in sorted(found, key=lambda one: -one[0])[:_FINALISTS]:
            fit, points = follow_lines(lens, gray, model, start, narrowing(wide))
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
