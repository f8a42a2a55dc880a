"""The poses nearest to a target that an arm with five joints can take: the position exactly, the orientation as well as can be.

Five joints reach a five-dimensional part of the six-dimensional poses. What remains when the position is met exactly is a
surface of joint values, and on it the angle to the target has a few least values. They are the solutions of

    min  angle(R_base_tip(q), R_target)    subject to    p_base_tip(q) = p_target.

The angle is that of the single turn which would take the tip to the target [rad]; metres and radians are never weighed against
each other. When only one tool axis counts it is the angle between the axis and its target.

**Three parallel axes 2, 3, 4**, direction h (youBot, SO-101, most arms with five joints). For a given q5 the point
``c = exp(s_5 q_5) p_home`` is known, and because axes 2, 3, 4 leave heights along h,

    h . exp(s_1 q_1)^-1 p = h . c

gives q1: two values. What is left is planar: the three parallel joints turn the tip by an angle phi and put axis 4 where
``W = y - Rot(phi) (c - P4)`` says, which the elbow reaches while W is between the difference and the sum of the lengths of its two arms: phi
is in one or two arcs. The target's approach direction, projected into the arm plane, gives the best phi,

    trace(R_target^T R_1 R_h(phi) R_5 R_home) = A + B cos(phi) + C sin(phi),    phi = atan2(C, B),

or an end of an arc where that is out of reach: there the elbow is stretched or folded. So the whole problem is a
function of q5 alone, which is sampled around its circle. Each of its least values is then taken to the last digit by Newton's method
on all five joints. Where the tip lies on axis 5, q1 does not depend on q5, and the function has one least value for each q1.

**Other arms with five joints** get a sixth, virtual joint about one of seven axes through the tip: every answer meets
the position and misses the orientation by a turn about that axis alone. From there, and from joint values spread evenly, Newton's
method goes downhill.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import constrained_newton as newton
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import size_of
from pieper.ik.numeric import solve_numeric
from pieper.ik.prepared import prepared
from pieper.ik.target import Target, ignore_orientation
from pieper.ik.virtual_joint import complete_method, extended, family_of
from pieper.kinematics.joints import without_turns
from pieper.spatial import angle as _angle
from pieper.spatial import rotation as _rotation
from pieper.spatial._checks import poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

    BoolArray = NDArray[np.bool_]

MOST_PROJECTIONS = 8
"""Places for answers; the nearest ones are kept."""

_SAMPLES = 48  # of q5 around its circle
_TURNS_OF_BASE = 24  # of q1, where the tip is on axis 1 and the position does not tell it
_MET = 1e-10  # [m in units of the size of the arm], what "exactly" means
_SAME = 1e-6  # [rad]
_ON_AXIS = 1e-9  # of the size of the arm
_VIRTUAL = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=np.float64
)
_STARTS, _NEAR_STARTS = 64, 16  # of other arms, for each target: spread evenly, and next to it
_TURN = 2.0 * np.pi


class Projections(NamedTuple):
    """Least angles with the position met, nearest first, for every target."""

    q: FloatArray
    """(..., 8, 5) joint values in (-pi, pi] [rad]; NaN in places that hold none."""
    valid: BoolArray
    """(..., 8): True for an answer."""
    T_base_tip: FloatArray
    """(..., 8, 4, 4): the pose that the arm takes there [m, -]."""
    rotation_error: FloatArray
    """(..., 8): the angle that is left, of the whole rotation or of the one axis that counts [rad]."""
    position_error: FloatArray
    """(..., 8): what is left of the position [m]: rounding."""
    out_of_reach: FloatArray
    """(...): 0 where there is an answer, else by how much the position is out of reach [m]."""
    complete: bool
    """True when the least values were looked for around the whole surface: arms with three parallel axes."""


@dataclass(frozen=True, eq=False)
class _Goal:
    """N targets: a rotation, or the direction of a tool axis."""

    p: FloatArray  # (N, 3)
    R: FloatArray  # (N, 3, 3)
    axis_tip: FloatArray | None = None

    def objective(self, state: newton.State) -> newton.Objective:
        if self.axis_tip is None:
            return newton.rotation_objective(state, self.R)
        return newton.axis_objective(state, self.R @ self.axis_tip, self.axis_tip)

    def angles(self, R: FloatArray, which: NDArray[np.intp]) -> FloatArray:
        """(B,) angles that rotations R (B, 3, 3) leave to their targets."""
        if self.axis_tip is None:
            return _rotation.distance(R, self.R[which])
        return angle_between(R @ self.axis_tip, self.R[which] @ self.axis_tip)


def project(chain: Chain, target: ArrayLike | Target) -> Projections:
    """The poses nearest to a target that an arm with five joints can take, joint limits left aside.

    Parameters
    ----------
    chain : Chain
        Five joints, no mimic joints.
    target : (..., 4, 4) array or Target
        Poses ``T_base_tip`` of the tip in the base frame [m, -]; or a `pieper.ik.target.position_and_axis`, of whose
        rotation only the direction of the axis counts.

    Returns
    -------
    Projections
        One answer for each least value of the angle that is left, the nearest first; the position is met exactly. A pose that the arm can take has
        answers with an angle of 0, those of its closed form. Nothing valid, and the distance, where the position is out of reach.

    Raises
    ------
    ArrayError
        Wrong shape, not finite, not a rotation, another number of joints, mimic joints, or a target of other rows.

    Notes
    -----
    A least value is a local one: answers with a larger angle belong to other branches of the arm (turned round, elbow the other way).
    Where the least values form a curve (a tool axis that is the last joint axis, so that joint 5 is free) some of its points are given.

    Examples
    --------
    A youBot is asked to point 0.1 rad out of the plane of its arm:

    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> from pieper.spatial.rotation import from_rotation_vector
    >>> arm = catalog.describe("youbot").chain()
    >>> T = fk(arm, [2.0, 1.3, -1.9, 2.4, 1.0])
    >>> sideways = fk(arm, [2.0, 1.3, -1.9, 2.4, 1.0])
    >>> across = np.cross(T[:3, 2], [0.0, 0.0, 1.0])
    >>> up = np.cross(across / np.linalg.norm(across), T[:3, 2])
    >>> sideways[:3, :3] = from_rotation_vector(0.1 * up) @ T[:3, :3]
    >>> nearest = project(arm, sideways)
    >>> float(nearest.rotation_error[0].round(9)), nearest.q[0].round(9)
    (0.1, array([ 2. ,  1.3, -1.9,  2.4,  1. ]))
    """
    T, axis = _checked(chain, target)
    shape, n = T.shape[:-2], chain.dof
    flat = np.ascontiguousarray(T.reshape(-1, 4, 4))
    goal = _Goal(flat[:, :3, 3], flat[:, :3, :3], axis)
    family = family_of(chain)
    geometric = family.name == "three parallel axes" and family.complete
    if not len(flat):
        q, which = np.empty((0, n)), np.empty(0, dtype=np.intp)
    elif geometric:
        q, which = _starts_from_geometry(chain, goal)
    else:
        q, which = _starts_from_virtual_joints(chain, flat, goal)
    scale = size_of(chain)
    found = newton.minimise(chain, q, which, lambda s: newton.position_rows(s, goal.p, scale), goal.objective)
    everything, everything_of = found.q, which
    q, which = found.q[found.minimum], which[found.minimum]
    if family.complete and len(flat):  # what a closed form finds beside singular poses, to the last digit
        exact = solve_closed_form(chain, family, flat)
        at, _ = np.nonzero(exact.valid)
        q, which = np.concatenate([exact.q[exact.valid], q]), np.concatenate([at, which])
    last_is_free = _last_is_free(chain, axis)
    answers = _collect(chain, goal, q, which, _MET * scale, last_is_free)
    missed = np.asarray(~answers[1].any(axis=-1))
    distance = np.zeros(len(flat))
    if missed.any():
        there, distance[missed] = _reached(chain, flat[missed])
        # where the position hardly moves with any joint Newton's method comes to no rest: the best it went through
        rest = missed[everything_of]
        q = np.concatenate([everything[rest], there])
        which = np.append(everything_of[rest], np.flatnonzero(missed))
        second = _collect(chain, goal, q[~np.isnan(q[:, 0])], which[~np.isnan(q[:, 0])], _MET * scale, last_is_free)
        for part, best in zip(answers, second, strict=True):
            part[missed, 0] = best[missed, 0]
        distance[answers[1].any(axis=-1)] = 0.0
    parts = [part.reshape((*shape, *part.shape[1:])) for part in (*answers, distance)]
    return Projections._make([*parts, geometric])


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...) angles between vectors (..., 3), to the last digit at 0 and pi [rad]."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def _checked(chain: Chain, target: ArrayLike | Target) -> tuple[FloatArray, FloatArray | None]:
    if chain.dof != 5 or chain.is_coupled:
        mimic = " and mimic joints" if chain.is_coupled else ""
        raise ArrayError(
            f"projection is for arms with 5 joints, {chain.name!r} has {chain.dof}{mimic}; lock joints, or use the numeric solver"
        )
    if not isinstance(target, Target):
        return poses(target, "T_base_tip"), None
    if any(weight != 1.0 for weight in target.weights):
        raise ArrayError(f"projection needs a target with all rows of weight 1, got weights {target.weights}")
    axis = None if target.axis is None else np.asarray(target.axis, dtype=np.float64)
    return poses(target.T_base_tip, "T_base_tip"), axis


def _last_is_free(chain: Chain, axis_tip: FloatArray | None) -> bool:
    """Whether the last joint turns about the tool axis, so that it moves nothing that counts."""
    return axis_tip is not None and axis_misfit(chain, axis_tip) < _ON_AXIS


def axis_misfit(chain: Chain, axis_tip: FloatArray) -> float:
    """How far a tool axis, (3,) in the frame of the tip, is from being the last joint axis: angle [rad] plus distance in units of the size of the arm."""
    v, w = chain.screws[-1, :3], chain.screws[-1, 3:]
    if not w.any():
        return float("inf")
    sine = float(np.linalg.norm(np.cross(chain.home[:3, :3] @ axis_tip, w)))
    away = float(np.linalg.norm(np.cross(chain.home[:3, 3] - np.cross(w, v), w)))
    return sine + away / size_of(chain)


def _collect(
    chain: Chain, goal: _Goal, q: FloatArray, which: NDArray[np.intp], met: float, last_is_free: bool
) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray, FloatArray]:
    """Answers that meet the position, distinct ones, sorted by angle, in (N, 8) places."""
    count, n = len(goal.p), chain.dof
    q = wrapped(chain, q)
    if last_is_free:
        q[:, -1] = 0.0
    T = chain.native.fk(q)
    position = np.linalg.norm(T[:, :3, 3] - goal.p[which], axis=-1)
    rotation = goal.angles(T[:, :3, :3], which)
    keep = position <= met
    rank = np.where(rotation < 1e-10, 0.0, rotation)  # equal but for rounding: then in order of the joint values
    order = np.lexsort((*np.round(q.T[::-1], 6), np.round(rank, 9), which))
    order = order[keep[order]]
    q, T, position, rotation, which = q[order], T[order], position[order], rotation[order], which[order]
    place = np.arange(len(which)) - np.searchsorted(which, which)
    most = int(place.max(initial=-1)) + 1
    everything = np.full((count, most, n), np.nan)
    everything[which, place] = q
    turning = chain.is_revolute
    double = np.zeros((count, most), dtype=bool)
    for i in range(1, most):
        apart = without_turns(turning, everything[:, :i] - everything[:, i, None])
        with np.errstate(invalid="ignore"):
            double[:, i] = ((np.abs(apart).max(axis=-1) < _SAME) & ~double[:, :i]).any(axis=-1)
    distinct = ~double[which, place]
    q, T, position, rotation, which = (part[distinct] for part in (q, T, position, rotation, which))
    place = np.arange(len(which)) - np.searchsorted(which, which)
    fits = place < MOST_PROJECTIONS
    at = (which[fits], place[fits])
    results = []
    for part in (q, T, rotation, position):
        padded = np.full((count, MOST_PROJECTIONS, *part.shape[1:]), np.nan)
        padded[at] = part[fits]
        results.append(padded)
    valid = np.zeros((count, MOST_PROJECTIONS), dtype=bool)
    valid[at] = True
    return results[0], valid, results[1], results[2], results[3]


def wrapped(chain: Chain, q: FloatArray) -> FloatArray:
    """Joint values (..., n) with those of turning joints brought to (-pi, pi]."""
    return np.where(chain.is_revolute, _angle.wrap(q), q) if len(q) else q.copy()


def unlimited(chain: Chain) -> Chain:
    """The arm with joints that turn without limits."""
    limits = np.where(chain.is_revolute[:, None], [-np.inf, np.inf], chain.limits)
    return prepared(chain, "unlimited", None, lambda: replace(chain, limits=limits))


def _reached(chain: Chain, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, n) joint values at the positions of poses, of the poses themselves if they are found; and (N,) distances [m]."""
    whole = solve_numeric(unlimited(chain), T, restarts=64)
    answers = solve_numeric(unlimited(chain), ignore_orientation(T[:, :3, 3]), restarts=64, position_tolerance=1e-12)
    q = np.where(whole.reached[:, None], whole.q[:, 0], answers.q[:, 0])
    return q, np.where(answers.reached, 0.0, answers.nearest.position_error)


# Three parallel axes


@dataclass(frozen=True, eq=False)
class _Geometry:
    """An arm whose axes 2, 3, 4 are parallel, seen along them. Numbers in the plane across h are complex."""

    h: FloatArray  # (3,) the direction of axis 2
    u: FloatArray  # (3,) and
    v: FloatArray  # (3,) span the plane across it, u x v = h
    signs: FloatArray  # (3,) of axes 2, 3, 4 along h
    P2: complex
    P4: complex
    first: complex  # from axis 2 to axis 3 at home
    second: complex  # from axis 3 to axis 4
    w1: FloatArray
    p1: FloatArray
    w5: FloatArray
    p5: FloatArray

    @classmethod
    def of(cls, chain: Chain) -> _Geometry:
        v, w = chain.screws[:, :3], chain.screws[:, 3:]
        points = np.cross(w, v)
        h = w[1] / np.linalg.norm(w[1])
        seed = np.eye(3)[np.argmin(np.abs(h))]
        u = np.cross(seed, h)
        u = u / np.linalg.norm(u)
        across = np.cross(h, u)
        P2, P3, P4 = (complex(points[i] @ u, points[i] @ across) for i in (1, 2, 3))
        return cls(h, u, across, np.sign(w[1:4] @ h), P2, P4, P3 - P2, P4 - P3, w[0], points[0], w[4], points[4])

    def flat(self, vectors: FloatArray) -> NDArray[np.complex128]:
        """The plane part of vectors (..., 3)."""
        return np.asarray(vectors @ self.u + 1j * (vectors @ self.v))


def _turned(axis: FloatArray, angle: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) turned about a unit axis by angles (...)."""
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = axis * (vectors @ axis)[..., None]
    return np.asarray(along + cosine * (vectors - along) + sine * np.cross(axis, vectors))


def _starts_from_geometry(chain: Chain, goal: _Goal) -> tuple[FloatArray, NDArray[np.intp]]:
    """Joint values (B, 5) on the surface next to the least angles, and the target of each."""
    arm = prepared(chain, "geometry_of_three_parallel_axes", None, lambda: _Geometry.of(chain))
    scale = size_of(chain)
    # where the last joint moves nothing that counts, one value of it is enough
    samples = 1 if _last_is_free(chain, goal.axis_tip) else _SAMPLES
    q5 = np.asarray(np.arange(samples) * (_TURN / samples), dtype=np.float64)
    c = _turned(arm.w5, q5, np.broadcast_to(chain.home[:3, 3] - arm.p5, (samples, 3))) + arm.p5  # (K, 3)
    # h . exp(s_1 q_1)^-1 p = h . c: a cos(q1 - middle) = d
    away = goal.p - arm.p1  # (N, 3)
    along = (away @ arm.w1)[:, None] * arm.w1
    cosine_part = (away - along) @ arm.h
    sine_part = -np.cross(arm.w1, away) @ arm.h
    a = np.hypot(cosine_part, sine_part)
    d = c @ arm.h - arm.p1 @ arm.h - (along @ arm.h)[:, None]  # (N, K)
    on_axis = a < _ON_AXIS * scale
    starts, targets = [], []
    for some, fronts in ((~on_axis, 2), (on_axis, _TURNS_OF_BASE)):
        which = np.flatnonzero(some)
        if not len(which):
            continue
        if fronts == 2:
            ratio = d[which] / a[which, None]
            half = np.where(np.abs(ratio) <= 1.0 + 1e-9, np.arccos(np.clip(ratio, -1.0, 1.0)), np.nan)
            middle = np.arctan2(sine_part, cosine_part)[which, None]
            q1 = np.stack([middle + half, middle - half], axis=1)  # (N', F, K)
        else:
            turns = np.arange(fronts) * (_TURN / fronts)
            q1 = np.where(np.abs(d[which]) < _ON_AXIS * scale, 0.0, np.nan)[:, None, :] + turns[:, None]
        q, rows = _starts_of_branches(chain, arm, goal, which, q1, q5, c)
        starts.append(q)
        targets.append(rows)
    return np.concatenate(starts), np.concatenate(targets)


def _starts_of_branches(
    chain: Chain,
    arm: _Geometry,
    goal: _Goal,
    which: NDArray[np.intp],
    q1: FloatArray,
    q5: FloatArray,
    c: FloatArray,
) -> tuple[FloatArray, NDArray[np.intp]]:
    """For values of joint 1, (N, F, K), the best turns phi in the arm plane, and of those the best along q5."""
    y = arm.flat(_turned(arm.w1, -q1, (goal.p[which] - arm.p1)[:, None, None, :]) + arm.p1) - arm.P2  # (N, F, K)
    d = arm.flat(c) - arm.P4  # (K,) from axis 4 to the tip
    # |W - P2|^2 = |y|^2 + |d|^2 - 2 |y| |d| cos(psi), psi = phi + arg d - arg y
    most, least = abs(arm.first) + abs(arm.second), abs(abs(arm.first) - abs(arm.second))
    size_y, size_d = np.abs(y), np.abs(d)
    product = np.maximum(2.0 * size_y * size_d, 1e-300)
    squares = size_y**2 + size_d**2
    with np.errstate(over="ignore"):
        lowest, highest = (squares - most**2) / product, (squares - least**2) / product
    reachable = (lowest <= 1.0 + 1e-9) & (highest >= -1.0 - 1e-9) & np.isfinite(q1)
    inner, outer = np.arccos(np.clip(highest, -1.0, 1.0)), np.arccos(np.clip(lowest, -1.0, 1.0))
    offset = np.angle(y) - np.angle(d)  # phi = psi + offset
    free, cosine, sine = _trace_terms(chain, arm, goal, which, q1, q5)
    best = without_turns(True, np.arctan2(sine, cosine) - offset)
    inside = (np.abs(best) >= inner) & (np.abs(best) <= outer)
    kinds = [(best, inside)]
    for edge, real, outwards in ((outer, lowest > -1.0, 1.0), (inner, highest < 1.0, -1.0)):
        # an end of an arc is a best place when going out of the arc would be better still
        kinds += [(s * edge, real & (-outwards * s * np.sin(s * edge - best) > 0.0)) for s in (1.0, -1.0)]
    amplitude = np.hypot(cosine, sine)
    psi = np.stack([kind[0] for kind in kinds], axis=2)  # (N, F, 5, K)
    possible = np.stack([kind[1] for kind in kinds], axis=2) & reachable[:, :, None]
    value = free[:, :, None] + amplitude[:, :, None] * np.cos(psi - best[:, :, None])
    value = np.where(possible, value, -np.inf)
    top = possible & (value >= np.roll(value, 1, axis=-1)) & (value >= np.roll(value, -1, axis=-1))
    i, f, _, k = np.nonzero(top)
    phi = psi[top] + offset[i, f, k]
    W = y[i, f, k] - np.exp(1j * phi) * d[k]
    # the elbow: W = Rot(a2) (first + Rot(a3) second)
    l1, l2 = abs(arm.first), abs(arm.second)
    bend = np.arccos(np.clip((np.abs(W) ** 2 - l1**2 - l2**2) / (2.0 * l1 * l2), -1.0, 1.0))
    at_rest = np.angle(arm.first) - np.angle(arm.second)
    q = []
    for side in (1.0, -1.0):
        a3 = side * bend + at_rest
        a2 = np.angle(W) - np.angle(arm.first + np.exp(1j * a3) * arm.second)
        planar = np.stack([a2, a3, phi - a2 - a3], axis=-1) * arm.signs
        q.append(np.concatenate([q1[i, f, k, None], planar, q5[k, None]], axis=-1))
    return np.concatenate(q), np.concatenate([which[i], which[i]])


def _trace_terms(
    chain: Chain, arm: _Geometry, goal: _Goal, which: NDArray[np.intp], q1: FloatArray, q5: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, F, K) numbers A, B, C with trace(R_target^T R) = A + B cos(phi) + C sin(phi), or the same for the cosine of an axis."""
    if goal.axis_tip is None:
        columns, wanted = chain.home[:3, :3].T, goal.R[which].swapaxes(-1, -2)  # rows are the columns of the rotations
    else:
        columns, wanted = (chain.home[:3, :3] @ goal.axis_tip)[None], (goal.R[which] @ goal.axis_tip)[:, None]
    A = np.zeros(q1.shape)
    B, C = np.zeros(q1.shape), np.zeros(q1.shape)
    angles = np.where(np.isfinite(q1), q1, 0.0)
    for column in range(len(columns)):
        x = _turned(arm.w5, q5, np.broadcast_to(columns[column], (len(q5), 3)))  # (K, 3)
        z = _turned(arm.w1, -angles, wanted[:, column, None, None, :])  # (N, F, K, 3)
        height = (z @ arm.h) * (x @ arm.h)
        A += height
        B += np.einsum("nfkc,kc->nfk", z, x) - height
        C += np.einsum("nfkc,kc->nfk", z, np.cross(arm.h, x))
    return A, B, C


# Other arms


def _starts_from_virtual_joints(chain: Chain, T: FloatArray, goal: _Goal) -> tuple[FloatArray, NDArray[np.intp]]:
    """Joint values (B, 5), of which those of virtual joints meet the position, and the target of each."""
    starts, targets = [np.tile(spread_joints(chain, _STARTS), (len(T), 1))], [np.repeat(np.arange(len(T)), _STARTS)]
    near, near_targets = [], []
    for axis in _VIRTUAL:
        method = complete_method(extended(chain, [axis.tolist()]))
        if method is None:
            break
        answers = method.solve(T)
        near.append(answers.q[answers.valid][:, : chain.dof])
        near_targets.append(np.nonzero(answers.valid)[0])
    if near:
        q, which = np.concatenate(near), np.concatenate(near_targets)
        order = np.lexsort((goal.angles(chain.native.fk(q)[:, :3, :3], which), which))
        q, which = q[order], which[order]
        best = np.arange(len(which)) - np.searchsorted(which, which) < _NEAR_STARTS
        starts.append(q[best])
        targets.append(which[best])
    return np.concatenate(starts), np.concatenate(targets)


def spread_joints(chain: Chain, count: int) -> FloatArray:
    """(count, n) joint values evenly spread over one turn, or over the range of a slide.

    The additive sequence of Roberts (2018), from the powers of one irrational number.
    """
    n = chain.dof
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (n + 1))  # root^(n + 1) = root + 1
    spread = (0.5 + np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, n + 1))) % 1.0
    low, high = np.where(chain.is_revolute[:, None], [-np.pi, np.pi], np.clip(chain.limits, -10.0, 10.0)).T
    return np.asarray(low + (high - low) * spread)
