"""Finding the robots and the ball of `Patterns` among the blobs of a frame.

Patterns that differ in their colours alone share a shape, so that sixteen robots of a league cost one search:

1. two blobs at the distance of two places of a shape give a pose; the other places then either have a blob near them or do not;
2. poses that were made of the same blobs are one; each pattern of the shape is scored on it by the colours that are right, wrong and missing;
3. the best is taken first, and its blobs are gone for the others, so a blob belongs to one robot at most;
4. its pose is the least-squares fit to the blobs, each with its own covariance, and has the covariance that follows.

Two patterns that explain the blobs equally well leave the name open and the pose as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from pieper.errors import VisionError
from pieper.perception.blob_places import SIZES, Levels, surest
from pieper.perception.pattern_shape import Shape, shapes_of
from pieper.perception.sighting import Sighting

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from pieper.perception.blobs import Blobs
    from pieper.perception.field_view import View
    from pieper.perception.pattern import Patterns
    from pieper.spatial._checks import FloatArray

_BALL_ROUND = 0.6  # circularity of a ball that is partly hidden
_BALL_AREA = (0.25, 3.0)  # of what a ball of its size would cover
_AREA_NOISE = 0.03  # of the share of its usual area that a marker has, to begin with; learnt as the area is
_MISFIT = 1e-3  # probability of a misfit that is put down to what the covariances do not know
_AREA_PACE = 0.05  # of what is learnt of the area of a marker, from one sight of it
_UNIT_PACE = 0.05  # of what is learnt of the covariances, from one frame
_UNITS = (0.1, 10.0)  # how far they may be off
_CUT = 0.9  # radii by which the centroid of a disc moves that lost a half of its area and more, per share lost over share left
_ROUNDS = 3  # of the search, the later ones among the blobs that are left


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Robots that a frame may show: of one shape, each made of other blobs."""

    shape: int
    rows: NDArray[np.int64]
    """Blob at each place, -1 for none, ``(u, n)``."""
    pattern: NDArray[np.int64]
    """Which pattern, -1 if that is open."""
    score: FloatArray
    centre: NDArray[np.complex128]
    turn: NDArray[np.complex128]
    scale: FloatArray


class PatternFinder:
    """Finds the robots and the ball of `Patterns` in the blobs of a frame.

    Parameters
    ----------
    patterns : Patterns
    view : View
        On the field, markers are put at their own heights. In pixels the layouts have a scale that is found by itself, and whatever
        height a marker has is not corrected.
    mm_per_px : float, optional
        In pixels: the scale, if it is known.

    Notes
    -----
    From frame to frame it keeps where the robots were, the usual areas of the markers, the scale in pixels, and how well covariances and misfits
    agree; `forget` drops that. Frames should come in order, but need not.

    Attributes
    ----------
    scale : float or None
        Units of the view to a metre of the layout; 1 on the field, None in pixels until it is found.

    Examples
    --------
    >>> from pieper.perception.blobs import Blobs
    >>> from pieper.perception.field_view import PixelView
    >>> from pieper.perception.pattern import load_patterns
    >>> league = load_patterns("report")
    >>> seen = np.array([[100, 100], [130, 100], [115, 79], [115, 121]]) + 0.0  # 3 mm to a pixel
    >>> blobs = Blobs(("red", "green", "blue"), np.array([0, 2, 1, 1]), seen, np.tile(np.eye(2) * 1e-3, (4, 1, 1)),
    ...               np.full(4, 380.0), np.zeros((4, 4), np.int64), np.ones(4))
    >>> robot, = PatternFinder(league, PixelView(), mm_per_px=3.0).find(blobs)
    >>> robot.name, np.round(robot.position, 1).tolist(), abs(round(robot.heading, 3))
    ('robot', [115.0, 100.0], 0.0)
    """

    def __init__(self, patterns: Patterns, view: View, *, mm_per_px: float | None = None) -> None:
        if mm_per_px is not None and not (np.isfinite(mm_per_px) and mm_per_px > 0):
            raise VisionError(f"mm_per_px must be a positive number of millimetres, got {mm_per_px}")
        self.patterns, self.view = patterns, view
        self._metric = view.unit == "m"
        self._given = None if mm_per_px is None else 1e3 / mm_per_px
        self.scale: float | None = 1.0 if self._metric else self._given
        self._shapes = shapes_of([r for r in patterns.robots if len(r.markers) > 1], mirrored=not self._metric)
        self._single = [r for r in patterns.robots if len(r.markers) == 1]
        self._areas = [np.full(len(shape.places), np.nan) for shape in self._shapes]
        self._scatter = [_AREA_NOISE**2 for _ in self._shapes]
        self._unit = [1.0 for _ in self._shapes]
        self._poses: list[dict[int, tuple[complex, complex, complex]]] = [{} for _ in self._shapes]
        self._count = {r.name: len(r.markers) for r in patterns.robots}
        self._tables: dict[tuple[str, ...], list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]] = {}

    def forget(self) -> None:
        """Forget what was learnt from the frames so far."""
        self.scale = 1.0 if self._metric else self._given
        for areas in self._areas:
            areas[:] = np.nan
        self._poses = [{} for _ in self._shapes]
        self._unit = [1.0 for _ in self._shapes]
        self._scatter = [_AREA_NOISE**2 for _ in self._shapes]

    def find(self, blobs: Blobs) -> tuple[Sighting, ...]:
        """Return the robots and the ball of one frame.

        Parameters
        ----------
        blobs : Blobs

        Returns
        -------
        tuple of Sighting
            Robots, the surest first, then the ball. Each blob is part of one of them at most, and a name is given once.
        """
        if not len(blobs):
            return ()
        levels = Levels(blobs, self.view)
        if self.scale is None and self._shapes:
            self.scale = self._find_scale(blobs, levels)
        used: set[int] = set()
        robots: list[Sighting] = []
        if self.scale is not None:
            robots = self._robots(blobs, levels, used, self.scale, learn=True)
        robots += self._single_robots(blobs, levels, used)
        return (*_named_once(robots, self._count, used), *self._ball(blobs, levels, used))

    def _robots(self, blobs: Blobs, levels: Levels, used: set[int], scale: float, *, learn: bool) -> list[Sighting]:
        chosen: list[tuple[_Candidates, int]] = []
        # First where the robots of the last frame must be by now, if they are there completely; then anywhere, among what is left.
        for attempt in range(_ROUNDS + 1):
            look_back = learn and attempt == 0
            if look_back and not any(self._poses):
                continue
            free = np.ones(len(blobs), dtype=bool)
            free[list(used)] = False
            pools = [self._candidates(k, blobs, levels, free, scale, look_back) for k in range(len(self._shapes))]
            new, again = self._choose([p for p in pools if p is not None], used, chosen)
            chosen += new
            if not (look_back or (new and again)):
                break
        found: list[tuple[float, Sighting]] = []
        scales: list[float] = []
        for k in range(len(self._shapes)):
            own = [(c, i) for c, i in chosen if c.shape == k]
            if learn:
                self._remember(k, own)
            if own:
                found += self._fitted(k, own, levels, scale)
                scales += [float(c.scale[i]) for c, i in own]
        if learn and scales and not self._metric and self._given is None:
            self.scale = 0.9 * scale + 0.1 * float(np.median(scales))
        found.sort(key=lambda pair: (-pair[0], *pair[1].position.tolist()))
        return [sighting for _, sighting in found]

    def _table(self, names: tuple[str, ...]) -> list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]:
        """Of each shape: colours of its patterns, which colours each place may have, and which each pair of anchors."""
        if names not in self._tables:
            tables = []
            for shape in self._shapes:
                colors = shape.colors(names)
                place = np.zeros((len(shape.places), len(names)), dtype=bool)
                pair = np.zeros((len(shape.anchors), len(names), len(names)), dtype=bool)
                for row in colors:
                    if (row < 0).any():
                        continue
                    place[np.arange(len(row)), row] = True
                    pair[np.arange(len(pair)), row[shape.anchors[:, 0]], row[shape.anchors[:, 1]]] = True
                tables.append((colors, place, pair))
            self._tables[names] = tables
        return self._tables[names]

    def _candidates(
        self, k: int, blobs: Blobs, levels: Levels, free: NDArray[np.bool_], scale: float, look_back: bool
    ) -> _Candidates | None:
        shape = self._shapes[k]
        colors, place_colors, pair_colors = self._table(blobs.names)[k]
        rows = np.flatnonzero(
            free & np.any(place_colors, axis=0, keepdims=True)[0, blobs.color] & levels.sized(shape, scale)
        )
        if len(rows) < shape.least:
            return None
        z = np.stack([levels.places(h)[rows] for h in shape.heights])  # (levels, blobs)
        if not np.isfinite(z).all():
            seen = np.isfinite(z).all(axis=0)
            rows, z = rows[seen], z[:, seen]
            if len(rows) < shape.least:
                return None
        color = blobs.color[rows]
        slack = 0.0 if self._metric else _SCALE_SLACK
        gate = shape.gate * scale
        if look_back:
            blob = self._where_they_were(k, z, color, colors, gate)
            return self._scored(k, rows, blob, z, levels, color, colors, scale) if len(blob) else None

        # Two blobs at the distance, and of the colours, of two places.
        near = np.abs(z[0][:, None] - z[0][None]) < shape.reach * scale * (1.0 + slack) + 2.0 * gate
        np.fill_diagonal(near, False)
        a, b = np.nonzero(near)
        i, j = shape.anchors.T
        arm = shape.places[j] - shape.places[i]
        apart = z[shape.level[j][None], b[:, None]] - z[shape.level[i][None], a[:, None]]
        length = np.abs(arm) * scale
        fits = (np.abs(np.abs(apart) - length) < gate + slack * length) & pair_colors[:, color[a], color[b]].T
        pair, q = np.nonzero(fits)
        if not len(pair):
            return None

        # The pose of each, and the blob nearest to each place of it.
        turn = apart[pair, q] / arm[q]
        if self._metric:
            turn /= np.abs(turn)
        middle = 0.5 * (z[shape.level[i[q]], a[pair]] + z[shape.level[j[q]], b[pair]])
        origin = middle - turn * 0.5 * (shape.places[i[q]] + shape.places[j[q]])
        expected = origin[:, None] + turn[:, None] * shape.places[None]
        most = int(near.sum(axis=1).max()) + 1
        np.fill_diagonal(near, True)
        around = np.argsort(~near, axis=1, kind="stable")[:, :most]
        inside = near[np.arange(len(rows))[:, None], around]
        close, is_close = around[a[pair]], inside[a[pair]]
        off = z[shape.level[None, :, None], close[:, None, :]] - expected[:, :, None]
        square = off.real**2 + off.imag**2
        allowed = place_colors[np.arange(len(shape.places))[None, :, None], color[close][:, None, :]]
        square = np.where(allowed & is_close[:, None, :], square, np.inf)
        best = square.argmin(axis=2)
        each = np.arange(len(best))[:, None]
        distance = square[each, np.arange(best.shape[1])[None], best]
        blob = np.where(distance < (1.5 * gate) ** 2, close[each, best], -1)
        enough = (blob >= 0).sum(axis=1) >= shape.least
        blob = blob[enough]
        if not len(blob):
            return None
        blob = blob[_different(blob)]
        return self._scored(k, rows, blob, z, levels, color, colors, scale)

    def _remember(self, k: int, chosen: list[tuple[_Candidates, int]]) -> None:
        """Where each robot of a shape is, how it is turned, and how far it went since the last frame."""
        before, now = self._poses[k], {}
        for c, i in chosen:
            which = int(c.pattern[i])
            if which >= 0 and which not in now:
                centre, turn = complex(c.centre[i]), complex(c.turn[i])
                last = before.get(which)
                now[which] = (centre, turn, centre - last[0] if last else 0j)
        self._poses[k] = now

    def _where_they_were(
        self,
        k: int,
        z: NDArray[np.complex128],
        color: NDArray[np.int64],
        colors: NDArray[np.int64],
        gate: float,
    ) -> NDArray[np.int64]:
        """Blobs of the robots of the last frame, moved on, of which every marker is there in its colour, ``(m, n)``."""
        shape, poses = self._shapes[k], self._poses[k]
        if not poses:
            return np.zeros((0, len(shape.places)), dtype=np.int64)
        centre, turn, step = np.array(list(poses.values())).T
        expected = (centre + step)[:, None] + turn[:, None] * shape.places[None]
        off = z[shape.level[None, :, None], np.arange(z.shape[1])] - expected[:, :, None]
        square = off.real**2 + off.imag**2
        square[color[None, None, :] != colors[list(poses)][:, :, None]] = np.inf
        blob = square.argmin(axis=2)
        blob = blob[(square.min(axis=2) < gate * gate).all(axis=1)]
        return np.asarray(blob if len(np.unique(blob)) == blob.size else blob[:0])

    def _scored(
        self,
        k: int,
        rows: NDArray[np.int64],
        blob: NDArray[np.int64],
        z: NDArray[np.complex128],
        levels: Levels,
        color: NDArray[np.int64],
        colors: NDArray[np.int64],
        scale: float,
    ) -> _Candidates | None:
        """Name each candidate, drop what does not fit its pattern, and score what is left."""
        shape = self._shapes[k]
        gate = shape.gate * scale
        there = blob >= 0
        if shape.radii.min() > 0:
            size = levels.radii(shape.heights[-1])[rows][blob] / (shape.radii * scale)
            there &= (size > SIZES[0]) & (size < SIZES[1])
        right = (color[blob][:, None, :] == colors[None]) & there[:, None, :]
        good = right.sum(axis=2)
        which = good.argmax(axis=1)
        u = np.arange(len(blob))
        most = good[u, which]
        open_name = (good == most[:, None]).sum(axis=1) > 1
        mask = right[u, which]
        points = np.where(mask, z[shape.level[None], blob], 0.0)
        for _ in range(2):
            origin, turn, size = _pose_of(points, shape.places, mask, rigid=self._metric)
            off = np.abs(points - origin[:, None] - turn[:, None] * shape.places[None])
            fits = mask & (off < gate)
            if (fits == mask).all():
                break
            mask = fits
        count = mask.sum(axis=1)
        stays = (count >= shape.least) & (np.abs(size / scale - 1.0) < max(_SCALE_SLACK, 1e-6) * 1.5)
        if not stays.any():
            return None
        error = np.sqrt((np.where(mask, off, 0.0) ** 2).sum(axis=1) / np.maximum(count, 1)) / gate
        missing = len(shape.places) - count
        score = count - 0.5 * missing - 0.5 * error
        kept = np.where(mask, rows[blob], -1)
        pattern = np.where(open_name, -1, which)
        return _Candidates(k, kept[stays], pattern[stays], score[stays], origin[stays], turn[stays], size[stays])

    def _choose(
        self, pools: list[_Candidates], used: set[int], before: list[tuple[_Candidates, int]]
    ) -> tuple[list[tuple[_Candidates, int]], bool]:
        """The best first, then the best of what has blobs of its own; and whether something lost a blob that it may do without."""
        entries = [
            (-s, c, i, row)
            for c in pools
            for i, (s, row) in enumerate(zip(c.score.tolist(), c.rows.tolist(), strict=True))
        ]
        entries.sort(key=lambda e: (e[0], e[3]))
        taken = [(c.centre[i], self._shapes[c.shape].span * c.scale[i]) for c, i in before]
        chosen, again = [], False
        for _, c, i, row in entries:
            own = [r for r in row if r >= 0]
            left = sum(r not in used for r in own)
            if left < len(own):
                again |= left >= self._shapes[c.shape].least
                continue
            room = self._shapes[c.shape].span * float(c.scale[i])
            if any(abs(c.centre[i] - centre) < min(room, other) for centre, other in taken):
                continue
            chosen.append((c, i))
            taken.append((c.centre[i], room))
            used.update(own)
        return chosen, again

    def _fitted(
        self, k: int, chosen: list[tuple[_Candidates, int]], levels: Levels, scale: float
    ) -> list[tuple[float, Sighting]]:
        """Least-squares poses of the robots of one shape, and their covariances."""
        shape = self._shapes[k]
        rows = np.array([c.rows[i] for c, i in chosen])
        there = rows >= 0
        cut = self._cut(k, rows, there, levels, scale)
        points, W = _weighted(shape, rows, there, cut, levels)
        origin, turn, size = _pose_of(points, shape.places, there, rigid=self._metric)
        fit = _gauss_newton(points, W, there, shape.places, origin, turn / size, size)
        covariance = (
            fit.covariance * self._unit_weight(k, fit.misfit, 2.0 * there.sum(axis=1) - 3.0, cut)[:, None, None]
        )
        near = np.exp(-2.0 * (np.abs(fit.off) / (shape.gate * scale)) ** 2)
        confidence = (near * there).sum(axis=1) / len(shape.places)
        found = []
        for n, (c, i) in enumerate(chosen):
            which = int(c.pattern[i])
            name = shape.patterns[which].name if which >= 0 else None
            sighting = Sighting(
                kind="robot",
                name=name,
                position=np.array([fit.origin[n].real, fit.origin[n].imag]),
                heading=float(np.angle(fit.turn[n])),
                covariance=0.5 * (covariance[n] + covariance[n].T),
                blobs=tuple(int(row) for row in rows[n] if row >= 0),
                confidence=float(confidence[n]),
            )
            found.append((float(c.score[i]), sighting))
        return found

    def _unit_weight(self, k: int, misfit: FloatArray, freedom: FloatArray, cut: FloatArray) -> FloatArray:
        """What the covariances of poses are to be multiplied by, ``(m,)``.

        What the misfits of late say of the covariances of the centroids scales that of the pose (the variance of unit weight); a single
        misfit that this does not explain is laid on that robot (Birge's ratio).
        """
        unit = self._unit[k]
        odd = misfit > unit * chdtri(freedom, _MISFIT)
        plain = ~odd & (freedom > 0) & ~cut.any(axis=1)
        if plain.any():
            told = float(misfit[plain].sum() / freedom[plain].sum())
            self._unit[k] = float(np.clip(unit + _UNIT_PACE * (told - unit), *_UNITS))
        return np.where(odd, misfit / freedom, unit)

    def _cut(
        self, k: int, rows: NDArray[np.int64], there: NDArray[np.bool_], levels: Levels, scale: float
    ) -> FloatArray:
        """How far the centroid of each marker may be off because something hides a part of it, from what it lacks of its usual area."""
        shape, usual = self._shapes[k], self._areas[k]
        radius = np.where(there, levels.radii(shape.heights[-1])[rows], np.nan)
        area = (radius / scale) ** 2
        if np.isnan(usual).any():
            first = np.nanmax(np.where(there, area, np.nan), axis=0, initial=0.0)
            usual = self._areas[k] = np.where(np.isnan(usual) & (first > 0), first, usual)
        with np.errstate(invalid="ignore"):
            share = area / usual[None]
            whole = np.abs(share - 1.0) < max(3.0 * np.sqrt(self._scatter[k]), _AREA_NOISE)
        excess = np.where(whole, share - 1.0, 0.0)
        usual *= 1.0 + _AREA_PACE * excess.sum(axis=0) / np.maximum(whole.sum(axis=0), 1)
        if whole.any():
            self._scatter[k] += _AREA_PACE * (float((excess**2).sum() / whole.sum()) - self._scatter[k])
        lost = np.clip(np.nan_to_num(1.0 - share - 2.0 * np.sqrt(self._scatter[k])), 0.0, 0.9)
        return np.asarray(_CUT * np.nan_to_num(radius) * lost / (1.0 - lost))

    def _find_scale(self, blobs: Blobs, levels: Levels) -> float | None:
        """Units to a metre that explain most markers, from a guess by the size of the blobs."""
        guesses = []
        for shape in self._shapes:
            wanted = {m.color for p in shape.patterns for m in p.markers}
            own = np.isin(blobs.color, [i for i, name in enumerate(blobs.names) if name in wanted])
            if own.sum() < shape.least:
                continue
            if shape.radii.min() > 0:
                guesses.append(float(np.median(blobs.radius[own]) / np.median(shape.radii)))
            z = levels.places(shape.heights[0])[own]
            apart = np.abs(z[:, None] - z[None]) + np.where(np.eye(len(z)), np.inf, 0.0)
            guesses.append(float(np.median(apart.min(axis=1)) * 0.2 / shape.gate))
        best: tuple[float, float] | None = None
        for guess in guesses:
            for factor in _SCALE_STEPS:
                robots = self._robots(blobs, levels, set(), guess * factor, learn=False)
                score = sum(len(r.blobs) * r.confidence for r in robots)
                if robots and (best is None or score > best[0]):
                    best = score, self._scale_of(robots, levels, guess * factor)
        return None if best is None else best[1]

    def _scale_of(self, robots: Sequence[Sighting], levels: Levels, scale: float) -> float:
        before, self.scale = self.scale, scale
        self._robots(levels.blobs, levels, set(), scale, learn=True)
        found, self.scale = self.scale, before
        return scale + 10.0 * (found - scale)  # the median itself

    def _single_robots(self, blobs: Blobs, levels: Levels, used: set[int]) -> list[Sighting]:
        found = []
        for pattern in self._single:
            marker = pattern.markers[0]
            own: list[int] = []
            if marker.color in blobs.names:
                own = [int(r) for r in np.flatnonzero(blobs.color == blobs.names.index(marker.color)) if r not in used]
            if own:
                row = own[surest(blobs.area[own], blobs.centroid[own])]
                z, cov = levels.places(marker.height)[row], levels.covariances(marker.height)[row]
                if np.isfinite(z):
                    used.add(row)
                    found.append(Sighting("robot", pattern.name, np.array([z.real, z.imag]), None, cov, (row,)))
        return found

    def _ball(self, blobs: Blobs, levels: Levels, used: set[int]) -> list[Sighting]:
        ball = self.patterns.ball
        if ball is None or ball.color not in blobs.names:
            return []
        own = np.flatnonzero(blobs.color == blobs.names.index(ball.color))
        own = np.array([r for r in own if r not in used], dtype=np.int64)
        z = levels.places(ball.radius)[own]
        fit = np.minimum(blobs.circularity[own] / _BALL_ROUND, 1.0)
        if ball.radius > 0 and self.scale is not None and len(own):
            share = blobs.area[own] / (
                np.pi * (ball.radius * levels.pixels_per_unit(ball.radius)[own] * self.scale) ** 2
            )
            fit = np.where((share > _BALL_AREA[0]) & (share < _BALL_AREA[1]), fit * np.minimum(share, 1.0 / share), 0.0)
        else:
            fit = fit * (blobs.area[own] / blobs.area[own].max(initial=1.0))
        fit = np.where(np.isfinite(z), fit, 0.0)
        if not len(own) or fit.max() <= 0:
            return []
        best = surest(fit, blobs.centroid[own])
        row = int(own[best])
        used.add(row)
        where, covariance = z[best], levels.covariances(ball.radius)[row]
        confidence = float(min(fit[best], 1.0))
        return [Sighting("ball", "ball", np.array([where.real, where.imag]), None, covariance, (row,), confidence)]


_SCALE_SLACK = 0.08  # of a scale that was found in pixels: perspective and lens make it vary over the image
_SCALE_STEPS = tuple(float(f) for f in 1.12 ** np.arange(-4, 5))


class _Fit(NamedTuple):
    """Poses by least squares: origins and turns, (m,) in the plane of complex numbers, covariances (m, 3, 3), misfits (m,), and how far each
    marker was off before, (m, n).
    """

    origin: NDArray[np.complex128]
    turn: NDArray[np.complex128]
    covariance: FloatArray
    misfit: FloatArray
    off: NDArray[np.complex128]


def _weighted(
    shape: Shape, rows: NDArray[np.int64], there: NDArray[np.bool_], cut: FloatArray, levels: Levels
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Places of the markers, (m, n), and the inverses of their covariances: xx, xy and yy, (3, m, n)."""
    points = np.zeros(rows.shape, dtype=np.complex128)
    W = np.zeros((3, *rows.shape))
    for level, height in enumerate(shape.heights):
        here = there & (shape.level == level)
        points[here] = levels.places(height)[rows[here]]
        spread = levels.covariances(height)[rows[here]]
        xx, xy, yy = spread[:, 0, 0] + cut[here] ** 2, spread[:, 0, 1], spread[:, 1, 1] + cut[here] ** 2
        W[:, here] = np.stack([yy, -xy, xx]) / (xx * yy - xy * xy)
    return points, W


def _gauss_newton(
    points: NDArray[np.complex128],
    W: FloatArray,
    there: NDArray[np.bool_],
    places: NDArray[np.complex128],
    origin: NDArray[np.complex128],
    turn: NDArray[np.complex128],
    size: FloatArray,
) -> _Fit:
    """One step: the problem is nearly linear, and a second one is below rounding."""
    arm = (size * turn)[:, None] * places[None]
    off = np.where(there, points - origin[:, None] - arm, 0.0)
    u, v = off.real, off.imag
    a, b, c = W
    Wu, Wv = a * u + b * v, b * u + c * v
    Wx, Wy = -a * arm.imag + b * arm.real, -b * arm.imag + c * arm.real  # W times how the marker moves with the heading
    spin = -arm.imag * Wx + arm.real * Wy
    sums = np.stack([a, b, c, Wx, Wy, spin, Wu, Wv, arm.real * Wv - arm.imag * Wu, u * Wu + v * Wv]).sum(axis=2)
    covariance = np.linalg.inv(sums[[0, 1, 3, 1, 2, 4, 3, 4, 5]].T.reshape(-1, 3, 3))
    slope = sums[6:9].T
    step = (covariance @ slope[..., None])[..., 0]
    misfit = sums[9] - (slope * step).sum(axis=1)
    return _Fit(origin + step[:, 0] + 1j * step[:, 1], turn * np.exp(1j * step[:, 2]), covariance, misfit, off)


def _pose_of(
    points: NDArray[np.complex128], places: NDArray[np.complex128], mask: NDArray[np.bool_], *, rigid: bool
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], FloatArray]:
    """Origins, turns and sizes that take places to points best, in the plane of complex numbers; a turn has the size in it, which is 1 where `rigid`."""
    count = np.maximum(mask.sum(axis=1), 1)
    middle = (points * mask).sum(axis=1) / count
    lever = (places[None] * mask).sum(axis=1) / count
    arms = (places[None] - lever[:, None]) * mask
    turn = ((points - middle[:, None]) * arms.conj()).sum(axis=1) / np.maximum((np.abs(arms) ** 2).sum(axis=1), 1e-300)
    if rigid:
        turn = turn / np.maximum(np.abs(turn), 1e-300)
    return middle - turn * lever, turn, np.ones(len(turn)) if rigid else np.abs(turn)


def _different(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of rows that differ."""
    weights = np.array([pow(1_000_003, k + 1, 2**61 - 1) for k in range(rows.shape[1])], dtype=np.uint64)
    keys = ((rows + 2).astype(np.uint64) * weights).sum(axis=1, dtype=np.uint64)
    return np.sort(np.unique(keys, return_index=True)[1])


def _named_once(robots: list[Sighting], count: Mapping[str, int], used: set[int]) -> list[Sighting]:
    """The surest of a name keeps it; another one stays without if it is complete, and is clutter if it is not."""
    names: set[str] = set()
    out = []
    for robot in robots:
        if robot.name not in names:
            out.append(robot)
        elif len(robot.blobs) == count[robot.name]:
            out.append(replace(robot, name=None))
        else:
            used.difference_update(robot.blobs)
        if robot.name:
            names.add(robot.name)
    return out
