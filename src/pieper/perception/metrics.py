"""How far estimates are from the truth: errors, detection, identity, consistency.

An estimate may stand for a thing only within a distance `reach` of it. The tracking figures are those of the literature, with
similarity ``1 - d / (2 reach)``, which is one half at the reach:

- precision, recall, MOTA, identity switches: Bernardin and Stiefelhagen, *Evaluating multiple object tracking performance: the
  CLEAR MOT metrics*, 2008. Pairs of the frame before are kept while they hold.
- IDF1: Ristani et al., *Performance measures and a data set for multi-target, multi-camera tracking*, 2016.
- HOTA, the mean over thresholds 0.05 to 0.95 of the similarity: Luiten et al., *HOTA: a higher order metric for evaluating
  multi-object tracking*, 2021, eqs. 6 to 11 and 13.
- NEES, the normalised estimation error squared ``e' P^-1 e``, which is chi-square distributed if the covariances are honest:
  Bar-Shalom, Li, Kirubarajan, *Estimation with applications to tracking and navigation*, 2001, section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.spatial._checks import FloatArray

REACH = 0.05  # m; less than a robot
_THRESHOLDS = np.arange(0.05, 0.99, 0.05)
_EPS = float(np.finfo(np.float64).eps)
_KEPT = 1000.0  # worth of a pair that was there a frame ago; any similarity is at most 1


@dataclass(frozen=True, eq=False)
class Moment:
    """What was and what was said in one frame.

    Attributes
    ----------
    things : (n,) int array
        Numbers of the true things, from 0; each at most once.
    distance : (n, m) array
        From each thing to each estimate; infinite for pairs that cannot be, such as a robot and a ball.
    tracks : (m,) int array
        Numbers of the tracks, from 0; each at most once.
    """

    things: NDArray[np.int64]
    tracks: NDArray[np.int64]
    distance: FloatArray

    def __post_init__(self) -> None:
        things, tracks = (np.asarray(n, dtype=np.int64).reshape(-1) for n in (self.things, self.tracks))
        distance = np.asarray(self.distance, dtype=np.float64).reshape(len(things), len(tracks))
        if len(set(things)) < len(things) or len(set(tracks)) < len(tracks):
            raise ArrayError(f"a thing or track is there twice in one frame: things {things}, tracks {tracks}")
        if np.isnan(distance).any() or (distance < 0).any():
            raise ArrayError(
                f"distances must be 0 or more (infinity: never together), got {np.nanmin(distance) if not np.isnan(distance).any() else np.nan}"
            )
        object.__setattr__(self, "things", things)
        object.__setattr__(self, "tracks", tracks)
        object.__setattr__(self, "distance", distance)

    def similarity(self, reach: float) -> FloatArray:
        """Return ``1 - d / (2 reach)``, at least 0."""
        return np.maximum(0.0, 1.0 - self.distance / (2 * reach))


@dataclass(frozen=True)
class Clear:
    """Detection and switches, frame by frame.

    Attributes
    ----------
    found, false, missed : int
        Pairs, estimates without a thing, things without an estimate.
    switches : int
        How often the track of a thing was another one than before.
    distance : float
        Mean over the pairs; NaN without any.
    """

    found: int
    false: int
    missed: int
    switches: int
    distance: float

    @property
    def precision(self) -> float:
        """Share of the estimates that stand for a thing."""
        return _ratio(self.found, self.found + self.false)

    @property
    def recall(self) -> float:
        """Share of the things that were found."""
        return _ratio(self.found, self.found + self.missed)

    @property
    def mota(self) -> float:
        """1 less the errors of all three kinds for each thing; below 0 if there are more errors than things."""
        things = self.found + self.missed
        return 1.0 - (self.false + self.missed + self.switches) / things if things else float("nan")


@dataclass(frozen=True)
class Identity:
    """How much of every thing's time one track told of it, under the best one-to-one choice of tracks."""

    agreed: int
    false: int
    missed: int

    @property
    def idf1(self) -> float:
        """F1 of that."""
        return _ratio(2 * self.agreed, 2 * self.agreed + self.false + self.missed)


@dataclass(frozen=True)
class Hota:
    """Detection and association in balance, means over all thresholds."""

    hota: float
    detection: float
    association: float
    location: float


def pairs(
    moments: Sequence[Moment], *, reach: float = REACH
) -> Iterator[tuple[Moment, NDArray[np.int64], NDArray[np.int64]]]:
    """Yield for each frame which things and which estimates belong together, as rows (k,) and columns (k,) of its distances.

    Pairs of the frame before are kept while they are within reach; of the others, as many as can be, and the nearest.
    """
    kept: dict[int, int] = {}
    for moment in moments:
        score = moment.similarity(reach)
        near = score >= 0.5 - _EPS
        same = np.array([[kept.get(int(thing)) == track for track in moment.tracks] for thing in moment.things])
        score = np.where(near, score + _KEPT * same.reshape(score.shape), 0.0)
        rows, columns = linear_sum_assignment(-score)
        good = near[rows, columns]
        rows, columns = rows[good], columns[good]
        kept = dict(zip(moment.things[rows].tolist(), moment.tracks[columns].tolist(), strict=True))
        yield moment, rows, columns


def clear(moments: Sequence[Moment], *, reach: float = REACH) -> Clear:
    """Return precision, recall, switches and MOTA.

    >>> moments = [Moment([0], [0], [[0.01]]), Moment([0], [1], [[0.02]]), Moment([0], [], [[]])]
    >>> result = clear(moments, reach=0.05)
    >>> result.switches, result.recall, result.precision, result.mota
    (1, 0.67, 1.0, 0.33)
    """
    found = false = missed = switches = 0
    total = 0.0
    last: dict[int, int] = {}
    for moment, rows, columns in pairs(moments, reach=reach):
        found += len(rows)
        missed += len(moment.things) - len(rows)
        false += len(moment.tracks) - len(columns)
        total += float(moment.distance[rows, columns].sum())
        now = dict(zip(moment.things[rows].tolist(), moment.tracks[columns].tolist(), strict=True))
        switches += sum(last.get(thing, track) != track for thing, track in now.items())
        last.update(now)
    return Clear(found, false, missed, switches, _ratio(total, found))


def identity(moments: Sequence[Moment], *, reach: float = REACH) -> Identity:
    """Return IDF1 and its parts: one track for one thing over the whole time.

    >>> identity([Moment([0], [0], [[0.0]]), Moment([0], [1], [[0.0]])]).idf1
    0.5
    """
    things, tracks, together = _counts(moments)
    for moment in moments:
        near = moment.similarity(reach) >= 0.5
        together[np.ix_(moment.things, moment.tracks)] += near
    rows, columns = linear_sum_assignment(-together)
    agreed = int(together[rows, columns].sum())
    return Identity(agreed, int(tracks.sum()) - agreed, int(things.sum()) - agreed)


def hota(moments: Sequence[Moment], *, reach: float = REACH) -> Hota:
    """Return HOTA and its parts.

    >>> hota([Moment([0], [0], [[0.0]])]).hota
    1.0
    """
    things, tracks, likely = _counts(moments)
    if not things.sum() or not tracks.sum():
        return Hota(0.0, 0.0, 0.0, 1.0)
    scores = [moment.similarity(reach) for moment in moments]
    for moment, s in zip(moments, scores, strict=True):
        rest = s.sum(0)[None] + s.sum(1)[:, None] - s
        likely[np.ix_(moment.things, moment.tracks)] += np.divide(s, rest, out=np.zeros_like(s), where=rest > _EPS)
    alignment = likely / np.maximum(things[:, None] + tracks[None] - likely, _EPS)
    together = np.zeros((len(_THRESHOLDS), *likely.shape))
    found, near = np.zeros(len(_THRESHOLDS)), np.zeros(len(_THRESHOLDS))
    for moment, s in zip(moments, scores, strict=True):
        rows, columns = linear_sum_assignment(-alignment[np.ix_(moment.things, moment.tracks)] * s)
        good = s[rows, columns] >= _THRESHOLDS[:, None] - _EPS
        found += good.sum(1)
        near += (good * s[rows, columns]).sum(1)
        for a, which in enumerate(good):
            together[a, moment.things[rows[which]], moment.tracks[columns[which]]] += 1
    jaccard = together / np.maximum(1, things[:, None] + tracks[None] - together)
    association = (together * jaccard).sum((1, 2)) / np.maximum(1, found)
    detection = found / (things.sum() + tracks.sum() - found)
    location = np.maximum(1e-10, near) / np.maximum(1e-10, found)
    means = (np.sqrt(detection * association), detection, association, location)
    return Hota(*(float(values.mean()) for values in means))


def _counts(moments: Sequence[Moment]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frames of each thing, frames of each track, and an empty table of things by tracks."""
    things = np.concatenate([np.zeros(0, np.int64), *(m.things for m in moments)])
    tracks = np.concatenate([np.zeros(0, np.int64), *(m.tracks for m in moments)])
    per_thing, per_track = np.bincount(things).astype(float), np.bincount(tracks).astype(float)
    return per_thing, per_track, np.zeros((len(per_thing), len(per_track)))


@dataclass(frozen=True)
class Spread:
    """Of errors: root mean square, what 95 % of them stay below, the largest; NaN if there are none."""

    count: int
    rms: float
    p95: float
    largest: float


def spread(errors: ArrayLike) -> Spread:
    """Return how large errors are: distances, or vectors ``(n, k)`` whose length counts.

    >>> spread([[3.0, 4.0], [0.0, 0.0]])
    Spread(count=2, rms=3.54, p95=4.75, largest=5.0)
    """
    e = np.asarray(errors, dtype=np.float64)
    size = np.abs(e) if e.ndim == 1 else np.linalg.norm(e, axis=-1)
    if not size.size:
        return Spread(0, *[float("nan")] * 3)
    return Spread(size.size, float(np.sqrt(np.mean(size**2))), float(np.percentile(size, 95)), float(size.max()))


@dataclass(frozen=True)
class Consistency:
    """Whether covariances are honest.

    Attributes
    ----------
    count : int
        Errors.
    mean : float
        Of the NEES over the degrees of freedom: 1 if honest, more if too sure, less if too shy.
    inside : float
        Share of the NEES within the 95 % band of chi-square, between its quantiles 0.025 and 0.975: 0.95 if honest.
    band : (float, float)
        That band.
    """

    count: int
    mean: float
    inside: float
    band: tuple[float, float]


def nees(errors: ArrayLike, covariances: ArrayLike) -> FloatArray:
    """Return ``e' P^-1 e`` (...) of each error e (..., d) with its covariance P (..., d, d).

    Raises
    ------
    ArrayError
        Shapes that do not go together.

    Examples
    --------
    >>> nees([[0.1, 0.0]], [[[0.01, 0.0], [0.0, 0.01]]])
    array([1.])
    """
    e, P = np.asarray(errors, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    if P.shape != (*e.shape, e.shape[-1]):
        raise ArrayError(f"covariances of errors {e.shape} must have shape {(*e.shape, e.shape[-1])}, got {P.shape}")
    return np.asarray((e * np.linalg.solve(P, e[..., None])[..., 0]).sum(-1))


def consistency(errors: ArrayLike, covariances: ArrayLike) -> Consistency:
    """Return whether errors ``(n, k)`` are as large as covariances ``(n, k, k)`` say."""
    e = np.asarray(errors, dtype=np.float64)
    freedom = e.shape[-1]
    low, high = (float(chi2.ppf(q, freedom)) for q in (0.025, 0.975))
    if not len(e):
        return Consistency(0, float("nan"), float("nan"), (low, high))
    value = nees(e, covariances)
    return Consistency(
        len(e), float(value.mean() / freedom), float(((value >= low) & (value <= high)).mean()), (low, high)
    )


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")
