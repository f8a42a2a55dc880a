"""From sightings to objects that last: a Kalman filter for each, one assignment for all, and a life measured in seconds.

State of an object: x, y, heading, and the rates of the three; a ball or a marker has no heading. Between frames the rates stay as they
are, driven by white acceleration of spectral density q [unit^2/s^3], in each coordinate (Bar-Shalom, Li, Kirubarajan 2001, *Estimation
with Applications to Tracking and Navigation*, section 6.2.2)::

    p' = p + dt v,    v' = v,    Q(dt) = q [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]

so the noise is that of the time that went by, whatever the frame rate: two short steps give what a long one gives. A sighting measures
x, y and heading; the innovation of the heading is the shorter turn. The update is Joseph's form, which keeps the covariance symmetric and
positive definite under rounding.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from pieper.errors import PieperWarning, VisionError
from pieper.perception.estimate import Estimate
from pieper.perception.track_parameters import Motion, TrackerParameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from pieper.perception.estimate import State
    from pieper.perception.sighting import Sighting
    from pieper.spatial._checks import FloatArray

__all__ = ["Motion", "Tracker", "TrackerParameters"]

_TURN = 2.0 * np.pi
_UNKNOWN_HEADING = np.pi**2 / 3.0  # variance of an angle of which nothing is known
_PLANE = [0, 1, 3, 4]  # rows of the state of what has no heading
_JOLT = 1e-3  # probability of an innovation that is put down to a jolt
_HITS = 3  # sights of what is believed; one fewer if it has a name
_ESTABLISHED = 0.25  # s
_ROUNDING = 1e-9  # s; time stamps are sums of frame times


@dataclass
class _Track:
    """What is known of a track beside its state."""

    number: int
    kind: str
    name: str | None
    born: float
    seen: float
    heading: bool
    hits: int = 1
    frames: int = 1
    misses: int = 0
    confirmed: bool = False
    sighting: int = -1

    @property
    def unique(self) -> bool:
        """Whether there is one of its name at most: markers are named after their colour, of which there may be many."""
        return self.name is not None and self.kind != "marker"


class Tracker:
    """Follows all objects of one view.

    Parameters
    ----------
    parameters : TrackerParameters

    Attributes
    ----------
    used : tuple of int
        Of the last `step`: which of its sightings are of objects that are believed.
    late : int
        Frames that were left out because they were captured before the last one.

    Examples
    --------
    A robot at 1 m/s along x, seen three times and then hidden:

    >>> from pieper.perception.sighting import Sighting
    >>> tracker = Tracker(TrackerParameters.metres())
    >>> for k in range(6):
    ...     x = [0.04 * k, 0.0]
    ...     there = [Sighting("robot", "blue", np.array(x), 0.0, np.diag([1e-6, 1e-6, 1e-4]))] if k < 4 else []
    ...     estimates = tracker.step(0.04 * k, there)
    >>> [(e.name, e.state, np.round(e.position, 3).tolist()) for e in estimates]
    [('blue', 'hidden', [0.2, 0.0])]
    >>> np.round(tracker.predict(0.3)[0].position, 2).tolist()
    [0.3, 0.0]
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        self.used: tuple[int, ...] = ()
        self.late = 0
        self._tracks: list[_Track] = []
        self._x: FloatArray = np.zeros((0, 6))
        self._P: FloatArray = np.zeros((0, 6, 6))
        self._q: FloatArray = np.zeros((0, 3))
        self._jolt: FloatArray = np.zeros((0, 3))
        self._dt = 0.0
        self._time: float | None = None
        self._late_time: float | None = None
        self._next = 1
        self._ended: list[Estimate] = []
        self._limits = [float(chdtri(dof, parameters.gate)) for dof in (1, 2, 3)]
        self._likely = [float(chdtri(dof, _JOLT)) for dof in (1, 2, 3)]

    def step(self, time: float, sightings: Sequence[Sighting]) -> tuple[Estimate, ...]:
        """Take the sightings of one frame, in any order.

        Parameters
        ----------
        time : float
            Of capture [s], on any clock that goes forward.
        sightings : sequence of Sighting

        Returns
        -------
        tuple of Estimate
            Of the objects that are believed, at `time`, in the order of their numbers; what ends now is among them once, as ``"lost"``.

        Raises
        ------
        VisionError
            `time` is not a finite number.

        Warns
        -----
        PieperWarning
            The time jumped. After a gap of `TrackerParameters.end` or more, and after a jump back by as much, all tracks end and new ones
            begin. A frame from less far back is left out, and the estimates are those of before; if the next one is from there too, the
            clock was set back, and the tracks go on with it.
        """
        if not np.isfinite(time):
            raise VisionError(f"the time of a frame must be a finite number of seconds, got {time}")
        if not self._turn_clock(float(time)):
            return self._estimates(())
        seen = _Measured(sightings, self.parameters)
        for track in self._tracks:
            track.sighting = -1
        matches = self._associate(seen)
        self._update(matches, seen)
        self._name(matches, seen)
        self._bear(seen, {j for _, j in matches})
        self._confirm()
        lost = self._bury()
        self.used = tuple(sorted(int(seen.order[t.sighting]) for t in self._tracks if t.confirmed and t.sighting >= 0))
        return self._estimates(lost)

    def predict(self, time: float) -> tuple[Estimate, ...]:
        """Return where the objects that are believed will be, or were, at another time; the tracker stays as it is.

        Parameters
        ----------
        time : float
            [s]; before the last frame, the covariance grows as it does after it.

        Returns
        -------
        tuple of Estimate

        Raises
        ------
        VisionError
            The time is not finite.
        """
        if not np.isfinite(time):
            raise VisionError(f"the time to predict to must be a finite number of seconds, got {time}")
        if self._time is None:
            return ()
        x, P = _advanced(self._x, self._P, self._q, float(time) - self._time)
        return tuple(
            self._estimate(track, x[i], P[i], float(time)) for i, track in enumerate(self._tracks) if track.confirmed
        )

    def restart(self, reason: str) -> None:
        """End all tracks, because what was does not bear on what comes; the next step reports them as ``"lost"``."""
        if self._tracks:
            warnings.warn(f"{reason}: all tracks end, and new ones begin", PieperWarning, stacklevel=3)
        if self._time is not None:
            self._ended += [replace(e, state="lost") for e in self.predict(self._time)]
        self._keep(np.zeros(len(self._tracks), dtype=bool))
        self._late_time = None

    # --- time

    def _turn_clock(self, time: float) -> bool:
        """Bring the tracks to a time; False if the frame is to be left out."""
        before, end = self._time, self.parameters.end
        if before is not None and time < before - _ROUNDING:
            if before - time >= end:
                self.restart(f"time went back by {before - time:.3g} s")
            elif self._late_time is None or time < self._late_time:
                warnings.warn(
                    f"time went back by {before - time:.3g} s: the frame is left out", PieperWarning, stacklevel=4
                )
                self._late_time = time
                self.late += 1
                return False
            else:
                self._set_clock(self._late_time)
        elif before is not None and time - before >= end and end > 0:
            self._predict(time)
            self._time = time
            self.restart(f"no frame for {time - before:.3g} s")
        self._late_time = None
        if self._time is not None and self._tracks:
            self._predict(time)
        self._time = time
        return True

    def _set_clock(self, time: float) -> None:
        """The clock was set: what was now is `time`."""
        shift = time - cast("float", self._time)
        for track in self._tracks:
            track.born += shift
            track.seen += shift
        self._time = time

    def _predict(self, time: float) -> None:
        self._dt = time - cast("float", self._time)
        self._x, self._P = _advanced(self._x, self._P, self._q, self._dt)

    # --- who is who

    def _associate(self, seen: _Measured) -> list[tuple[int, int]]:
        """Pairs of track and sighting: first for the tracks that are believed, then for the others with what is left."""
        matches: list[tuple[int, int]] = []
        free = np.ones(len(seen), dtype=bool)
        for confirmed in (True, False):
            rows = np.array([i for i, t in enumerate(self._tracks) if t.confirmed is confirmed], dtype=np.int64)
            columns = np.flatnonzero(free)
            if not (len(rows) and len(columns)):
                continue
            cost = self._cost(rows, columns, seen)
            for r, c in zip(*linear_sum_assignment(cost), strict=True):
                if cost[r, c] < 0:
                    matches.append((int(rows[r]), int(columns[c])))
                    free[columns[c]] = False
        return matches

    def _cost(self, rows: NDArray[np.int64], columns: NDArray[np.int64], seen: _Measured) -> FloatArray:
        """Minus log-likelihood of each pair, up to a constant that makes it negative; 0 where the two cannot be the same."""
        d = seen.z[None, columns] - self._x[rows, None, :3]
        S = self._P[rows, None, :3, :3] + seen.R[None, columns]
        may_match, same = self._by_name(rows, columns, seen)
        S[..., (0, 1, 2), (0, 1, 2)] += self._jolted(rows, same)
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        area = a * c - b * b
        distance = (c * d[..., 0] ** 2 - 2.0 * b * d[..., 0] * d[..., 1] + a * d[..., 1] ** 2) / area
        cost = distance + np.log(area) - self._limits[1]
        fits = (distance <= self._limits[2]) & may_match
        known = np.array([self._tracks[i].heading for i in rows])
        turned = fits & known[:, None] & seen.heading[None, columns]
        fits &= turned | (distance <= self._limits[1])
        if turned.any():
            e, W = d[turned], S[turned]
            e[:, 2] = _wrapped(e[:, 2])
            full = np.einsum("ij,ij->i", e, np.linalg.solve(W, e[..., None])[..., 0])
            # The heading counts for the gate and, by its excess alone, for the choice: tracks that have one and tracks that do not
            # yet have one are compared on the same footing.
            cost[turned] += full - distance[turned]
            fits[turned] = full <= self._limits[2]
        if not fits.any():
            return np.zeros_like(cost)
        bonus = np.where(same, 1e3, 0.0)
        return np.asarray(np.where(fits, cost - cost[fits].max() - 1.0 - bonus, 0.0))

    def _jolted(self, rows: NDArray[np.int64], same: NDArray[np.bool_]) -> FloatArray:
        """Variance that a jolt may have brought, ``(r, c, 3)``: since the last frame, or for a sighting that is by name of the track, since the
        last sight of it.
        """
        time = cast("float", self._time)
        unseen = np.array([time - self._tracks[i].seen for i in rows])
        since = np.where(same, np.maximum(unseen, self._dt)[:, None], self._dt)
        return np.asarray(self._jolt[rows, None] * (since[..., None] ** 3 / 3.0))

    def _by_name(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], seen: _Measured
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which pairs kind and name allow, and which have the one name that both alone can have."""
        tracks = [self._tracks[i] for i in rows]
        names = np.array([t.name or "" for t in tracks])[:, None]
        others = seen.names[None, columns]
        kinds = np.array([t.kind for t in tracks])[:, None] == seen.kinds[None, columns]
        equal = kinds & (names == others)
        unique = np.array([t.unique for t in tracks])[:, None]
        return np.asarray(equal | (kinds & ((names == "") | (others == "")))), np.asarray(equal & unique)

    # --- what is seen

    def _update(self, matches: list[tuple[int, int]], seen: _Measured) -> None:
        for size, with_heading in ((3, True), (2, False)):
            chosen = [(i, j) for i, j in matches if bool(seen.heading[j]) is with_heading]
            if not chosen:
                continue
            rows = np.array(chosen, dtype=np.int64)
            i, j = rows[:, 0], rows[:, 1]
            y = seen.z[j, :size] - self._x[i, :size]
            if with_heading:
                y[:, 2] = _wrapped(y[:, 2])
            self._absorb_jolts(i, y, seen.R[j, :size, :size])
            self._x[i], self._P[i] = _updated(self._x[i], self._P[i], y, seen.R[j, :size, :size])
        self._x[:, 2] = _wrapped(self._x[:, 2])
        for row, column in matches:
            track = self._tracks[row]
            track.sighting, track.seen = column, cast("float", self._time)
            track.hits += 1
            track.misses = 0
            track.heading |= bool(seen.heading[column])
        for track in self._tracks:
            track.frames += 1
            track.misses += track.sighting < 0

    def _absorb_jolts(self, i: NDArray[np.int64], y: FloatArray, R: FloatArray) -> None:
        """Widen what is known of the tracks whose innovation is too large for a quiet motion."""
        n = y.shape[1]
        S = self._P[i, :n, :n] + R
        odd = np.einsum("ij,ij->i", y, np.linalg.solve(S, y[..., None])[..., 0]) > self._likely[n - 1]
        for k in i[odd]:
            since = max(cast("float", self._time) - self._tracks[k].seen, self._dt)
            self._P[k] = _advanced(self._x[[k]], self._P[[k]], self._jolt[[k]], since, move=False)[1][0]

    def _name(self, matches: list[tuple[int, int]], seen: _Measured) -> None:
        """Give tracks that have none the name of what was seen."""
        for i, j in matches:
            if self._tracks[i].name is None and seen.names[j]:
                self._tracks[i].name = str(seen.names[j])

    def _bear(self, seen: _Measured, taken: set[int]) -> None:
        time = cast("float", self._time)
        new = [j for j in range(len(seen)) if j not in taken]
        if not new:
            return
        x, P = np.zeros((len(new), 6)), np.zeros((len(new), 6, 6))
        q, jolt = np.zeros((2, len(new), 3))
        for k, j in enumerate(new):
            kind = str(seen.kinds[j])
            motion = self.parameters.motion(kind)
            x[k, :2], P[k, :2, :2] = seen.z[j, :2], seen.R[j, :2, :2]
            P[k, 3, 3] = P[k, 4, 4] = motion.speed**2
            q[k, :2], jolt[k, :2] = motion.acceleration, motion.jolt
            if kind == "robot":
                P[k, 2, 2] = _UNKNOWN_HEADING
            if kind == "robot" or seen.heading[j]:
                P[k, 5, 5], q[k, 2], jolt[k, 2] = motion.turn_rate**2, motion.turn_acceleration, motion.turn_jolt
            if seen.heading[j]:
                x[k, 2], P[k, :3, :3] = seen.z[j, 2], seen.R[j]
            name = str(seen.names[j]) or None
            self._tracks.append(_Track(self._number(), kind, name, time, time, bool(seen.heading[j]), sighting=j))
        self._x = np.concatenate([self._x, x])
        self._P = np.concatenate([self._P, P])
        self._q = np.concatenate([self._q, q])
        self._jolt = np.concatenate([self._jolt, jolt])

    def _number(self) -> int:
        self._next += 1
        return self._next - 1

    def _confirm(self) -> None:
        """Believe what was seen long enough; what claims the name of a believed track that is not seen is that track, found again."""
        time = cast("float", self._time)
        holders = {t.name: i for i, t in enumerate(self._tracks) if t.confirmed and t.unique and t.hits > 0}
        keep = np.ones(len(self._tracks), dtype=bool)
        for i, track in enumerate(self._tracks):
            if not (track.confirmed or self._is_sure(track, time)):
                continue
            holder = holders.get(track.name, i) if track.unique else i
            if holder == i:
                track.confirmed = True
                holders.setdefault(track.name, i)
            elif track.sighting >= 0 and self._tracks[holder].seen < track.born and keep[holder]:
                self._move(i, holder)
                keep[i] = False
            elif track.confirmed:
                track.name = None  # the name is taken, and its holder is seen
        self._keep(keep)

    def _is_sure(self, track: _Track, time: float) -> bool:
        """Whether a new track is old enough, and was seen often enough, now, and in half of its frames."""
        if self.parameters.confirm == 0.0:
            return True
        old = time - track.born >= self.parameters.confirm - _ROUNDING
        return old and track.sighting >= 0 and track.hits >= _HITS - track.unique and 2 * track.hits >= track.frames

    def _patience(self, track: _Track) -> float:
        """How long a track lasts unseen."""
        p = self.parameters
        span = track.seen - track.born
        return p.end if span >= _ESTABLISHED else min(p.end, max(p.forget, 2.0 * span))

    def _move(self, source: int, target: int) -> None:
        """Let the state of one track be that of another, which keeps its number and age."""
        new, old = self._tracks[source], self._tracks[target]
        for rows in (self._x, self._P, self._q, self._jolt):
            rows[target] = rows[source]
        old.seen, old.sighting, old.misses, old.heading = new.seen, new.sighting, 0, new.heading

    def _bury(self) -> list[Estimate]:
        time, p = cast("float", self._time), self.parameters
        keep, lost = np.ones(len(self._tracks), dtype=bool), []
        for i, track in enumerate(self._tracks):
            unseen = time - track.seen
            if track.confirmed and track.sighting < 0 and unseen >= self._patience(track) - _ROUNDING:
                lost.append(replace(self._estimate(track, self._x[i], self._P[i], time), state="lost"))
                keep[i] = False
            elif not track.confirmed and track.misses >= 2 and unseen > p.forget:
                keep[i] = False
        self._keep(keep)
        return lost

    def _keep(self, which: NDArray[np.bool_]) -> None:
        if which.all():
            return
        self._tracks = [t for t, kept in zip(self._tracks, which, strict=True) if kept]
        self._x, self._P, self._q, self._jolt = (rows[which] for rows in (self._x, self._P, self._q, self._jolt))

    # --- what is said

    def _estimates(self, lost: Iterable[Estimate]) -> tuple[Estimate, ...]:
        time = cast("float", self._time)
        live = [self._estimate(t, self._x[i], self._P[i], time) for i, t in enumerate(self._tracks) if t.confirmed]
        ended, self._ended = self._ended, []
        return tuple(sorted([*live, *lost, *ended], key=lambda e: e.track))

    def _estimate(self, track: _Track, x: FloatArray, P: FloatArray, time: float) -> Estimate:
        state: State = "seen" if time == track.seen else "hidden"
        return Estimate(
            track=track.number,
            kind=track.kind,
            name=track.name,
            time=time,
            position=x[:2].copy(),
            heading=float(_wrapped(x[2])) if track.heading else None,
            velocity=x[3:5].copy(),
            turn_rate=float(x[5]) if track.heading else None,
            covariance=P.copy() if track.heading else P[np.ix_(_PLANE, _PLANE)],
            state=state,
            unseen=max(time - track.seen, 0.0),
            age=time - track.born,
        )


class _Measured:
    """The sightings of a frame as arrays, in an order of their own, so that the order in which they come does not matter."""

    def __init__(self, sightings: Sequence[Sighting], parameters: TrackerParameters) -> None:
        def key(i: int) -> tuple[Any, ...]:
            s = sightings[i]
            return (s.kind, s.name or "", *s.position.tolist(), s.heading is None, s.heading or 0.0)

        self.order = sorted(range(len(sightings)), key=key)
        ordered = [sightings[i] for i in self.order]
        self.kinds = np.array([s.kind for s in ordered], dtype=np.str_)
        self.names = np.array([s.name or "" for s in ordered], dtype=np.str_)
        self.heading = np.array([s.heading is not None for s in ordered], dtype=bool)
        self.z = np.zeros((len(ordered), 3))
        self.R = np.zeros((len(ordered), 3, 3))
        for k, s in enumerate(ordered):
            self.z[k, :2] = s.position
            n = len(s.covariance)
            self.R[k, :n, :n] = s.covariance
            if s.heading is not None:
                self.z[k, 2] = s.heading
        self.R[:, [0, 1], [0, 1]] += parameters.floor**2
        self.R[:, 2, 2] += parameters.heading_floor**2

    def __len__(self) -> int:
        return len(self.order)


def _wrapped(angle: Any) -> Any:
    """In (-pi, pi], as `pieper.spatial.angle.wrap` gives it for what is a few turns off at most, in a fifth of its time."""
    return np.pi - (np.pi - angle) % _TURN


def _advanced(
    x: FloatArray, P: FloatArray, q: FloatArray, dt: float, *, move: bool = True
) -> tuple[FloatArray, FloatArray]:
    """State and covariance a time later, or earlier; without `move`, only the noise of that time is added."""
    x, out = x.copy(), P.copy()
    if dt == 0.0:
        return x, out
    if move:
        x[:, :3] += dt * x[:, 3:]
        x[:, 2] = _wrapped(x[:, 2])
        B, C = P[:, :3, 3:], P[:, 3:, 3:]
        BC = B + dt * C
        out[:, :3, :3] += dt * (B.transpose(0, 2, 1) + BC)
        out[:, :3, 3:] = BC
    k, s = np.arange(3), abs(dt)
    out[:, k, k] += q * (s**3 / 3.0)
    out[:, k, k + 3] += q * (dt * s / 2.0)
    out[:, k + 3, k + 3] += q * s
    out[:, 3:, :3] = out[:, :3, 3:].transpose(0, 2, 1)
    return x, out


def _updated(x: FloatArray, P: FloatArray, y: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """State and covariance with an innovation `y` of the first coordinates, whose measurement has the covariance `R`."""
    n = y.shape[1]
    K = np.linalg.solve(P[:, :n, :n] + R, P[:, :n, :]).transpose(0, 2, 1)
    left = np.broadcast_to(np.eye(6), P.shape).copy()
    left[:, :, :n] -= K
    P = left @ P @ left.transpose(0, 2, 1) + K @ R @ K.transpose(0, 2, 1)
    return x + (K @ y[..., None])[..., 0], 0.5 * (P + P.transpose(0, 2, 1))
