"""Estimates against the truth of a scene: all figures of `metrics` in one answer.

A thing of which less than `VISIBLE` is seen need not be found, and an estimate of it is no false one; how far off it is counts apart, as
``hidden``. Things and estimates of different kinds, or of markers of different colours, never belong together.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import asdict, dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from pieper.errors import VisionError
from pieper.perception.metrics import (
    REACH,
    Clear,
    Consistency,
    Hota,
    Identity,
    Moment,
    Spread,
    clear,
    consistency,
    hota,
    identity,
    pairs,
    spread,
)
from pieper.perception.output import TrackedFrame, TrackFile, TrackRow
from pieper.spatial.angle import difference

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from pieper.perception.estimate import Estimate
    from pieper.perception.truth import TrueMarker, TrueObject, Truth
    from pieper.spatial._checks import FloatArray

VISIBLE = 0.5
"""Share of a thing from which it has to be found."""
REACH_PX = 15.0
"""As `metrics.REACH`, of tracks in pixels."""


@dataclass(frozen=True)
class Evaluation:
    """All figures; lengths in the unit of the tracks, angles in radians.

    Attributes
    ----------
    unit : str
        ``"m"`` or ``"px"``.
    reach : float
        Within which an estimate may stand for a thing.
    frames, frames_without : int
        Of the truth, and those of them that the tracks do not have.
    position, hidden : Spread
        Errors of what was seen in its frame, and of what was not and was predicted.
    heading, velocity : Spread
        Errors of what was seen.
    clear, identity, hota
        Detection, identity, and both in balance.
    named : float
        Share of the pairs with a name whose name is right; NaN if nothing has a name.
    nees, heading_nees : Consistency
        Of the places, and of the headings, of what was seen.
    milliseconds : mapping of str to float
        Mean time of each stage for a frame, if it was measured.
    """

    unit: str
    reach: float
    frames: int
    frames_without: int
    position: Spread
    hidden: Spread
    heading: Spread
    velocity: Spread
    clear: Clear
    identity: Identity
    hota: Hota
    named: float
    nees: Consistency
    heading_nees: Consistency
    milliseconds: Mapping[str, float]

    def as_data(self) -> dict[str, Any]:
        """Return everything for JSON; None for what is not known."""
        data = asdict(self)
        data["clear"] |= {"precision": self.clear.precision, "recall": self.clear.recall, "mota": self.clear.mota}
        data["identity"]["idf1"] = self.identity.idf1
        plain: dict[str, Any] = _plain(data)
        return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


@dataclass(frozen=True)
class _Thing:
    """A true thing, or a true marker, in one frame."""

    key: tuple[str, str]
    kind: str
    name: str
    position: FloatArray
    heading: float | None
    velocity: FloatArray | None
    visible: float


def tracked(steps: Iterable[tuple[int, float, Sequence[Estimate]]], *, unit: str = "m", source: str = "") -> TrackFile:
    """Return estimates as a table: of each frame its number, its time and what was believed.

    Parameters
    ----------
    steps : iterable of (int, float, sequence of Estimate)
        Of each frame its number, its time [s] and what was believed.
    unit : str
        Of places: ``"m"`` or ``"px"``.
    source : str
        What was tracked.

    Returns
    -------
    TrackFile
    """
    frames = (
        TrackedFrame(index, time, tuple(TrackRow.of(index, e) for e in estimates)) for index, time, estimates in steps
    )
    return TrackFile(unit, source, tuple(frames))


def evaluate(
    truths: Sequence[Truth],
    tracks: TrackFile,
    *,
    reach: float | None = None,
    milliseconds: Mapping[str, float] | None = None,
) -> Evaluation:
    """Measure tracks against the truth.

    Parameters
    ----------
    truths : sequence of Truth
        Of every frame.
    tracks : TrackFile
        In metres: robots and balls are compared. In pixels: markers are, with the markers of the truth.
    reach : float, optional
        Distance within which an estimate may stand for a thing; 50 mm or 15 px by default.
    milliseconds : mapping of str to float, optional
        Mean time of each stage, to be told along.

    Returns
    -------
    Evaluation
        Errors in metres or pixels, and what was missed, swapped or made up.

    Raises
    ------
    VisionError
        There is no truth, no frame is in both, or tracks in pixels are not of markers.
    """
    if reach is not None and not reach > 0:
        raise VisionError(f"reach must be positive, got {reach}")
    near = reach or (REACH if tracks.unit == "m" else REACH_PX)
    rows = {frame.index: frame.rows for frame in tracks.frames}
    if not any(truth.index in rows for truth in truths):
        raise VisionError(f"no frame is in both: {len(truths)} frames of truth, {len(rows)} of tracks")
    if tracks.unit != "m" and any(row.kind not in (None, "marker") for row in chain.from_iterable(rows.values())):
        raise VisionError(
            "these tracks are in pixels, where only markers can be compared; track with --field for robots"
        )
    names: dict[tuple[str, str], int] = {}
    moments, seen = [], []
    for truth in truths:
        things = _things(truth, tracks.unit)
        said = [row for row in rows.get(truth.index, ()) if row.track is not None and row.state != "lost"]
        moment, things, said = _moment(things, said, near, names)
        moments.append(moment)
        seen.append((things, said))
    return _figures(truths, tracks, moments, seen, near, rows, milliseconds or {})


def _things(truth: Truth, unit: str) -> list[_Thing]:
    if unit == "m":
        return [_of_object(thing) for thing in truth.objects]
    return [_of_marker(thing, k, m) for thing in truth.objects for k, m in enumerate(thing.markers)]


def _of_object(thing: TrueObject) -> _Thing:
    return _Thing(
        (thing.kind, thing.name), thing.kind, thing.name, thing.position, thing.heading, thing.velocity, thing.visible
    )


def _of_marker(thing: TrueObject, k: int, marker: TrueMarker) -> _Thing:
    key = (thing.name, str(k))
    known = bool(np.isfinite(marker.image).all())
    place = marker.image if known else np.full(2, 1e9)
    return _Thing(key, "marker", marker.color, place, None, None, marker.visible if known else 0.0)


def _moment(
    things: list[_Thing], said: list[TrackRow], near: float, names: dict[tuple[str, str], int]
) -> tuple[Moment, list[_Thing], list[TrackRow]]:
    """The frame as the metrics want it, without hidden things; what stands for those is taken out, and told apart."""
    distance = _distance(things, said)
    must = np.array([thing.visible >= VISIBLE for thing in things], dtype=bool)
    aside: set[int] = set()
    if not must.all():
        likely = np.where(distance <= near, 1.0 - distance / (2 * near) + 10.0 * must[:, None], 0.0)
        for i, j in zip(*linear_sum_assignment(-likely), strict=True):
            if likely[i, j] > 0 and not must[i]:
                aside.add(int(j))
    kept = [j for j in range(len(said)) if j not in aside]
    wanted = [thing for thing, needed in zip(things, must, strict=True) if needed]
    numbers = [names.setdefault(thing.key, len(names)) for thing in wanted]
    tracks = [int(said[j].track or 0) for j in kept]
    moment = Moment(np.array(numbers, int), np.array(tracks, int), distance[must][:, kept])
    return moment, wanted, [said[j] for j in kept]


def _distance(things: list[_Thing], said: list[TrackRow]) -> FloatArray:
    at = np.array([thing.position for thing in things]).reshape(-1, 2)
    told = np.array([[_number(row.x), _number(row.y)] for row in said]).reshape(-1, 2)
    distance = np.linalg.norm(at[:, None] - told[None], axis=-1)
    for i, thing in enumerate(things):
        for j, row in enumerate(said):
            marker = thing.kind == "marker" and row.name is not None and row.name != thing.name
            if thing.kind != row.kind or marker or not np.isfinite(distance[i, j]):
                distance[i, j] = np.inf
    return np.asarray(distance)


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _figures(
    truths: Sequence[Truth],
    tracks: TrackFile,
    moments: list[Moment],
    seen: list[tuple[list[_Thing], list[TrackRow]]],
    near: float,
    rows: Mapping[int, Sequence[TrackRow]],
    milliseconds: Mapping[str, float],
) -> Evaluation:
    errors: dict[str, list[Any]] = defaultdict(list)
    right: list[bool] = []
    for (moment, chosen, told), (things, said) in zip(pairs(moments, reach=near), seen, strict=True):
        del moment
        for i, j in zip(chosen, told, strict=True):
            _add(errors, things[i], said[j])
            if said[j].name is not None:
                right.append(said[j].name == things[i].name)
    for truth in truths:
        _add_hidden(errors, truth, tracks.unit, rows.get(truth.index, ()), near)
    compact = _renumbered(moments)
    return Evaluation(
        unit=tracks.unit,
        reach=near,
        frames=len(truths),
        frames_without=sum(truth.index not in rows for truth in truths),
        position=spread(_vectors(errors["position"])),
        hidden=spread(errors["hidden"]),
        heading=spread(errors["heading"]),
        velocity=spread(_vectors(errors["velocity"])),
        clear=clear(compact, reach=near),
        identity=identity(compact, reach=near),
        hota=hota(compact, reach=near),
        named=float(np.mean(right)) if right else float("nan"),
        nees=consistency(_vectors(errors["sure"]), np.array(errors["P"]).reshape(-1, 2, 2)),
        heading_nees=consistency(np.array(errors["turn"]).reshape(-1, 1), np.array(errors["hh"]).reshape(-1, 1, 1)),
        milliseconds=dict(milliseconds),
    )


def _vectors(values: list[Any]) -> FloatArray:
    return np.array(values, dtype=np.float64).reshape(-1, 2)


def _add(errors: dict[str, list[Any]], thing: _Thing, row: TrackRow) -> None:
    if row.state != "seen":
        errors["hidden"].append(float(np.hypot(_number(row.x) - thing.position[0], _number(row.y) - thing.position[1])))
        return
    away = np.array([_number(row.x), _number(row.y)]) - thing.position
    errors["position"].append(away)
    P = np.array([[_number(row.xx), _number(row.xy)], [_number(row.xy), _number(row.yy)]])
    if np.isfinite(P).all() and np.linalg.det(P) > 0:
        errors["sure"].append(away)
        errors["P"].append(P)
    if thing.velocity is not None and row.vx is not None and row.vy is not None:
        errors["velocity"].append(np.array([row.vx, row.vy]) - thing.velocity)
    if thing.heading is not None and row.heading is not None:
        turn = float(difference(row.heading, thing.heading))
        errors["heading"].append(turn)
        if row.hh:
            errors["turn"].append(turn)
            errors["hh"].append(row.hh)


def _add_hidden(errors: dict[str, list[Any]], truth: Truth, unit: str, rows: Sequence[TrackRow], near: float) -> None:
    """Predictions of things that are not seen enough to be found."""
    things = [thing for thing in _things(truth, unit) if thing.visible < VISIBLE]
    said = [row for row in rows if row.state == "hidden"]
    if not things or not said:
        return
    distance = _distance(things, said)
    for i, j in zip(*linear_sum_assignment(np.where(np.isfinite(distance), distance, 1e9)), strict=True):
        same = things[i].kind != "marker" and said[j].name == things[i].name
        if np.isfinite(distance[i, j]) and (same or distance[i, j] <= 4 * near):
            errors["hidden"].append(float(distance[i, j]))


def _renumbered(moments: list[Moment]) -> list[Moment]:
    """The same with tracks numbered from 0 without gaps; a table may count to millions."""
    numbers: dict[int, int] = {}

    def small(tracks: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.array([numbers.setdefault(int(track), len(numbers)) for track in tracks], dtype=np.int64)

    return [Moment(m.things, small(m.tracks), m.distance) for m in moments]
