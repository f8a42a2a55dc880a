"""Along a curve of solutions in small steps: where it begins, goes on, branches, ends or closes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik._equations import Equations
from pieper.kinematics.joints import periodic_joints
from pieper.spatial._checks import FloatArray

if TYPE_CHECKING:
    from numpy.typing import NDArray


_TURN = 2.0 * np.pi
_PROBE = 1e-2  # length of the step that tells a curve from an isolated double solution
_SIDEWAYS = 0.1  # a step whose end is brought back across the curve by more than this share of it was too long
BEND = 0.2  # rad, most that the tangent may turn in a step
_OTHER_WAY = 0.95  # curves that leave a branch point at a larger cosine are one
_STRAIGHT = 0.06  # rad, a tangent that turns by less in a step allows a longer one
_SHORTEST = 1e-7  # steps below this are given up
# The least singular value that should not vanish falls towards branch points, and is small where two curves run side by side.
_CAUTION = 0.5  # a step may be this share of the way to where it would be 0
_ALONGSIDE = 4.0  # a step may be this times it
_APART = 0.5  # the end of a step may be brought back across the curve by this times it, less than to the next curve
_NULL = 1e-4  # singular values up to this are those of the null space at a branch point, which is not known to the last digit
_BRANCHING = 1e-5  # below this singular value there is a branch point ahead, closer than its curves can be told apart
_SURFACE = "the solutions near q form a surface, not a curve; hold a joint or ask for more rows"
NO_WAY_ON = "no way on"


class Point(NamedTuple):
    """A regular point of a curve."""

    q: FloatArray
    t: FloatArray
    strength: float  # the least singular value that vanishes only where curves cross


Begin = tuple[Equations, Point, FloatArray]


def begin(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> Begin | None:
    """A regular point of the curve, and the direction to go; None where the solution is isolated."""
    rank = equations.rank
    here, t, strength, met = equations.correct(q)
    if not met or strength <= _BRANCHING:
        return _leave_branch_point(equations, q, wanted)
    if wanted is not None and float(t @ wanted) < 0.0:
        t = -t
    if equations.count > rank:
        _, J = equations(here)
        if np.linalg.svd(J, compute_uv=False)[rank] > _BRANCHING or not _goes_on(equations, here, t):
            return None
    return equations, Point(here, t, strength), t


def _goes_on(equations: Equations, q: FloatArray, t: FloatArray) -> bool:
    """True when a step along the tangent, one way or the other, can be brought back to a solution."""
    for h in (_PROBE, -_PROBE):
        end, _, _, met = equations.correct(q + h * t)
        if met and np.linalg.norm(end - q) > 0.5 * _PROBE:
            return True
    return False


def _leave_branch_point(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> Begin | None:
    """The null space has two dimensions or more at `q`: take a step in it that leads to a curve."""
    found = ways_from(equations, q, wanted)
    if found.flat:
        raise ArrayError(_SURFACE)
    if found.ways:
        return found.ways[0]
    begin = _along_degenerate(equations, q, wanted) if equations.held is None else None
    if begin is None and found.others:
        raise ArrayError(_SURFACE)
    return begin


class Ways(NamedTuple):
    ways: list[Begin]  # curves, the one that bends least first
    flat: bool  # most directions lead to solutions: a surface
    others: bool  # there are solutions nearby


def ways_from(equations: Equations, q: FloatArray, wanted: FloatArray | None = None) -> Ways:
    """The curves that leave a point where the null space has two dimensions or more, by a step in each of many directions."""
    _, J = equations(q)
    values = np.zeros(equations.chain.dof)
    _, s, Vt = np.linalg.svd(J)
    values[: len(s)] = s
    null = Vt[values <= _NULL]
    if len(null) < 2:
        return Ways([], False, False)
    if wanted is not None and np.linalg.norm(null @ wanted) > 0.0:
        along = (null @ wanted) @ null
        directions = [along / np.linalg.norm(along)]
    else:
        angles = np.arange(24) * (np.pi / 24) + 0.01
        pairs = [(a, b) for a in range(len(null)) for b in range(a + 1, len(null))]
        directions = [np.cos(x) * null[a] + np.sin(x) * null[b] for a, b in pairs for x in angles]
    found: list[tuple[float, Begin]] = []
    flat = others = 0
    for d in directions:
        end, t, strength, met = equations.correct(q + _PROBE * d, 40)
        if not met:
            continue
        moved = float(np.linalg.norm(end - q))
        sideways = float(np.linalg.norm(end - q - _PROBE * d))
        others += moved > 0.3 * _PROBE
        flat += strength <= _BRANCHING and sideways < 0.1 * _PROBE
        if strength > _BRANCHING and sideways < 0.5 * _PROBE and abs(float(t @ (end - q))) > 0.9 * moved:
            out = t if float(t @ d) > 0.0 else -t
            found.append((sideways, (equations, Point(end, t, strength), out)))
    ways: list[Begin] = []
    for _, way in sorted(found, key=lambda entry: entry[0]):
        if all(abs(float(way[2] @ other[2])) < _OTHER_WAY for other in ways):
            ways.append(way)
    return Ways(ways, not ways and 3 * flat > len(directions), others > 0)


def _along_degenerate(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> Begin | None:
    """A curve whose Jacobian has one rank less all along, as that of a straight arm; with one joint held it has not."""
    best, most = None, _BRANCHING
    for joint in range(equations.chain.dof):
        holding = Equations(equations.chain, equations.target, (joint, float(q[joint])))
        here, t, strength, met = holding.correct(q)
        if met and strength > most and _goes_on(holding, here, t):
            back = wanted is not None and float(t @ wanted) < 0.0
            best, most = (holding, Point(here, t, strength), -t if back else t), strength
    return best


def lengths(q: FloatArray, t: FloatArray) -> FloatArray:
    """Length along a curve through points with unit tangents, as that of the cubic between neighbours."""
    chord = np.diff(q, axis=0)
    mean = 0.25 * (t[1:] + t[:-1])
    h = np.linalg.norm(chord, axis=1)
    for _ in range(30):
        h = np.linalg.norm(1.5 * chord - h[:, None] * mean, axis=1)
    return np.concatenate([[0.0], np.cumsum(h)])


def march(
    equations: Equations, begin: Point, direction: FloatArray, step: float, max_steps: int
) -> tuple[list[Point], str, list[int]]:
    """Points one way along the curve, why it ended, and after which points others cross."""
    chain = equations.chain
    turns = periodic_joints(chain)
    lower, upper = np.where(turns, -np.inf, chain.limits[:, 0]), np.where(turns, np.inf, chain.limits[:, 1])
    first = Point(begin.q, direction, begin.strength)
    points = [first]
    crossings: list[int] = []
    here, bend, fall = first, np.zeros_like(direction), 1.0
    h = 0.5 * step
    for _ in range(max_steps):
        if here.strength <= _BRANCHING:
            end = _across_branch_point(equations, here, bend)
            if end is None:
                return points, "branch point", crossings
            crossings.append(len(points) - 1)
        else:
            ahead = _CAUTION * here.strength / fall if fall > 0.0 else np.inf
            h = min(h, step, max(min(_ALONGSIDE * here.strength, ahead), _BRANCHING))
            end, h = _step(equations, here, bend, h)
            if end is None:
                return points, NO_WAY_ON, crossings
        last = _closes(equations, first, here, end, turns) if len(points) > 2 else None
        if last is not None:
            points.append(last)
            return points, "closed", crossings
        moved = end.q - here.q
        length = float(np.linalg.norm(moved))
        change = end.t - here.t
        bend, fall = change / length, (here.strength - end.strength) / length
        h = 1.5 * length if float(np.linalg.norm(change)) < _STRAIGHT else length
        points.append(end)
        here = end
        if ((end.q < lower) | (end.q > upper)).any():
            joint = chain.joint_names[int(np.argmax((end.q < lower) | (end.q > upper)))]
            return points, f"beyond the limit of {joint}", crossings
    return points, f"{max_steps} steps", crossings


def _step(equations: Equations, here: Point, bend: FloatArray, h: float) -> tuple[Point, float] | tuple[None, float]:
    """The next point, with the length of the step that led there."""
    while h >= _SHORTEST:
        ahead = here.q + h * here.t + (0.5 * h * h) * bend
        q, t, strength, met = equations.correct(ahead, 6)
        if met:
            along = float(t @ here.t)
            if along < 0.0:
                t, along = -t, -along
            sideways = q - ahead
            most = min(_SIDEWAYS * h, _APART * here.strength)
            if along >= 1.0 - 0.5 * BEND * BEND and float(sideways @ sideways) <= most * most:
                return Point(q, t, strength), h
        h *= 0.5
    return None, h


def _across_branch_point(equations: Equations, here: Point, bend: FloatArray) -> Point | None:
    """The first point beyond a branch point, on the curve that goes straight on."""
    for h in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
        end, _ = _step(equations, here, bend, h)
        if end is not None and end.strength > 3.0 * _BRANCHING and np.linalg.norm(end.q - here.q) > 0.5 * h:
            return end
    return None


def _closes(equations: Equations, first: Point, here: Point, end: Point, turns: NDArray[np.bool_]) -> Point | None:
    """The first point again, as it is come to between `here` and `end`; None when it is not."""
    to_first = first.q - here.q
    to_first = to_first - np.where(turns, _TURN * np.round(to_first / _TURN), 0.0)
    moved = end.q - here.q
    length = float(np.linalg.norm(moved))
    ahead = float(to_first @ moved) / length
    near = float(np.linalg.norm(to_first - (ahead / length) * moved)) <= 0.3 * length
    if not near or not 0.0 < ahead <= length * (1.0 + 1e-6) or float(here.t @ first.t) < 0.5:
        return None
    # the point of the curve that passes the first one most closely
    u, at = ahead / length, here.q
    for _ in range(6):
        cubic = u * u * (3 - 2 * u) * moved + length * (u * (1 - u) ** 2 * here.t - u * u * (1 - u) * end.t)
        at, _, strength, met = equations.correct(here.q + cubic)
        left = to_first - (at - here.q)
        missed = float(np.linalg.norm(left))
        if met and missed <= max(1e-8, 10.0 * equations.accepted / strength):
            return Point(here.q + to_first, first.t, first.strength)
        u += float(left @ first.t) / length
    return None
