"""Targets that leave the tip some freedom: a position and one axis, or a position alone.

Each joint beyond the rows that count leaves one dimension of answers:

====== ================================ =================
joints position and one axis (5 rows)   position (3 rows)
====== ================================ =================
3                                       isolated answers
4                                       curves
5      isolated answers                 surfaces
6      curves                           three dimensions
====== ================================ =================

**Isolated answers** are all found: virtual joints make a whole pose of the target (`pieper.ik.virtual_joint`).

**Families** are sampled by filling the freedom in: the turn about the tool axis, the direction of another tool axis or
the whole orientation is given evenly spread values, each of which leaves isolated answers that are all found. A sample is not an answer to
"which is nearest to where the arm is now", so with a seed the best samples are moved along their family by Newton's
method until ``|q - seed|`` is least, and once more within the joint limits.

**A tool axis that is the last joint axis** (youBot, and the flange axis of most arms) makes the turn of that joint free: it moves
nothing that counts. Then the other joints are solved and the last one is said to be free. With five joints in all, four are left for five rows: the axis
has to lie in the plane of the arm, and `PartialSolutions.nearest` tells by which angle it does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import constrained_newton as newton
from pieper.ik._directions import directions, orientations, pointing, turns_about
from pieper.ik._partial_plan import VIRTUAL_AXES, Plan, plan_of
from pieper.ik.family import size_of
from pieper.ik.numeric import solve_numeric
from pieper.ik.projection import Projections, angle_between, project, spread_joints, unlimited, wrapped
from pieper.ik.target import Target
from pieper.kinematics.joints import as_joints, without_turns
from pieper.spatial._checks import poses, whole_number
from pieper.spatial.twist import exp

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

    BoolArray = NDArray[np.bool_]

_TURN = 2.0 * np.pi
_SAME = 1e-6  # [rad]
_NEAREST_SAMPLES = 8  # that are moved along their family
_STARTS = 32  # where no sample met a family
_AT_ONCE = 16384  # poses, to bound the memory

# Some orientation, for targets whose orientation is free and does not matter.
_SOME_ROTATION = exp(np.array([0.0, 0.0, 0.0, 0.3, 0.8, 1.3]))[:3, :3]


class PartialSolutions(NamedTuple):
    """Answers of targets that leave some freedom."""

    q: FloatArray
    """(..., k, n) joint values [rad or m], NaN where ``valid`` is False. Turning joints are in (-pi, pi], or with a seed within half
    a turn of it; with a seed the nearest comes first."""
    valid: BoolArray
    """(..., k)"""
    position_error: FloatArray
    """(..., k): measured at the pose that forward kinematics gives [m]."""
    rotation_error: FloatArray
    """(..., k): angle between the tool axis and where it is to point [rad]; 0 where the orientation does not count."""
    complete: bool
    """True when every answer is listed, a free joint apart; False for samples of a family."""
    free_dimension: int
    """0 where answers are isolated; 1, 2 or 3 for curves, surfaces and more."""
    free_joint: int | None
    """The joint, counted from 0, that may have any value in every answer; None where there is no such joint."""
    nearest: Projections | None
    """Of an arm with five joints whose last one is free: the poses with the least angle, for targets without an answer, whose axis is
    not in the plane of the arm; NaN for the others. See `pieper.ik.projection.project`."""
    words: str
    """What kind of answers these are, in words."""


def covers(chain: Chain, target: Target) -> bool:
    """Whether `solve_partial` takes this arm and these rows; else the numeric solver has to.

    Up to six joints without mimic joints; all three rows of the position, with no row of the rotation or with one axis (5 or
    6 joints), all of weight 1; and an arm that can move along these rows, for which a complete method is known.

    Examples
    --------
    >>> from pieper.ik.target import components, ignore_orientation, position_and_axis
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> covers(arm, position_and_axis([0.3, 0.3, 0.3], [0.0, 0.0, -1.0]))
    True
    >>> covers(arm, components(np.eye(4), "x y rz"))
    False
    >>> covers(catalog.describe("panda").chain(), ignore_orientation([0.3, 0.3, 0.3]))
    False
    """
    return plan_of(chain, target) is not None


def solve_partial(
    chain: Chain,
    target: Target,
    *,
    seed: ArrayLike | None = None,
    samples: int = 64,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    threads: int = 1,
) -> PartialSolutions:
    """Joint values for a position and one axis, or for a position alone, joint limits left aside.

    Parameters
    ----------
    chain : Chain
            Up to six joints.
    target : Target
        Made by `pieper.ik.target.position_and_axis` or `pieper.ik.target.ignore_orientation`.
    seed : (..., n) array, optional
        Joint values to be near [rad or m]; leading axes broadcast to those of the target. Of a family, the answers
        nearest to it come first, one of them within the joint limits; isolated answers are sorted.
    samples : int
        Values that each family is sampled at; of a family of two or three dimensions, directions or orientations.
    position_tolerance, rotation_tolerance : float
        What counts as reached, measured on the arm [m] and [rad].
    threads : int
        Number of threads for a batch.

    Returns
    -------
    PartialSolutions
        Nothing valid where the target is out of reach.

    Raises
    ------
    ArrayError
        The target is not covered (see `covers`), wrong shapes, not finite, or not positive numbers.

    Notes
    -----
    Of a family with no sample and no seed in reach of it nothing is found: a small part of a surface can lie between samples. Isolated answers are
    all found.

    Examples
    --------
    A drill straight down with a UR5e: its turn is free, and the flange turns about it, so there are eight answers with any wrist 3.

    >>> from pieper.ik.target import position_and_axis
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> drill = position_and_axis([0.4, 0.2, 0.3], [0.0, 0.0, -1.0])
    >>> answers = solve_partial(arm, drill, seed=[0.3, -1.5, 1.8, -1.8, -1.5, 0.7])
    >>> int(answers.valid.sum()), answers.free_joint
    (8, 5)
    >>> answers.q[0].round(3)
    array([ 0.161, -1.611,  2.11 , -2.069, -1.571,  0.7  ])

    A gripper jaw along x: the family is a curve, and the answer nearest to the seed is on it to the last digit.

    >>> jaw = position_and_axis([0.4, 0.2, 0.3], [1.0, 0.0, 0.0], axis_tip=[1.0, 0.0, 0.0])
    >>> answers = solve_partial(arm, jaw, seed=[0.3, -1.5, 1.8, -1.8, -1.5, 0.7])
    >>> answers.free_dimension, answers.complete, bool(answers.position_error[0] < 1e-12)
    (1, False, True)
    """
    plan = plan_of(chain, target)
    if plan is None:
        raise ArrayError(
            f"solve_partial does not cover this target of {chain.name!r} with {chain.dof} joints: it takes a position, or a position and "
            "one axis, with weights 1, for up to 6 joints that can move along these rows; use the numeric solver"
        )
    m = whole_number(samples, "samples")
    workers = whole_number(threads, "threads")
    for name, value in (("position_tolerance", position_tolerance), ("rotation_tolerance", rotation_tolerance)):
        _require_positive(value, name)
    T = poses(target.T_base_tip, "T_base_tip")
    shape = T.shape[:-2]
    seeds = None if seed is None else _seed_for_each(chain, seed, shape)
    flat = np.ascontiguousarray(T.reshape(-1, 4, 4))
    problem = _Problem(chain, target, plan, position_tolerance, rotation_tolerance, workers)
    chunk = max(1, _AT_ONCE // m) if plan.sampled else _AT_ONCE
    parts = []
    for start in range(0, max(1, len(flat)), chunk):
        some = slice(start, start + chunk)
        parts.append(_solve(problem, flat[some], None if seeds is None else seeds[some], m))
    q, valid, position, rotation, nearest = _joined(parts, shape)
    return PartialSolutions(
        q,
        valid,
        position,
        rotation,
        complete=not plan.sampled and all(part.complete for part in parts),
        free_dimension=plan.free_dimension,
        free_joint=plan.free_joint,
        nearest=nearest,
        words=plan.words,
    )


def _require_positive(value: object, name: str) -> None:
    if not (isinstance(value, (float, int, np.floating, np.integer)) and 0.0 < value < np.inf):
        raise ArrayError(f"{name} must be a positive number, got {value!r}")


def _seed_for_each(chain: Chain, seed: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """(N, n): one seed for each target."""
    seeds = as_joints(chain, seed, name="seed")
    try:
        return np.ascontiguousarray(np.broadcast_to(seeds, (*shape, chain.dof))).reshape(-1, chain.dof)
    except ValueError:
        raise ArrayError(f"seed must have leading axes that broadcast to {shape}, got shape {seeds.shape}") from None


def _joined(
    parts: list[_Part], shape: tuple[int, ...]
) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray, Projections | None]:
    """The answers of all chunks, with as many places for each target, and the leading axes that the targets had."""
    k = max(part.q.shape[1] for part in parts)
    q, valid, position, rotation = (
        np.concatenate([_padded(array, k) for array in arrays])
        for arrays in zip(*(part[:4] for part in parts), strict=True)
    )
    nearest = None
    if parts[0].nearest is not None:
        columns = zip(*(part.nearest[:6] for part in parts if part.nearest is not None), strict=True)
        joined = (np.concatenate(arrays) for arrays in columns)
        nearest = Projections._make([*(array.reshape((*shape, *array.shape[1:])) for array in joined), False])
    return (
        q.reshape(*shape, k, q.shape[-1]),
        valid.reshape(*shape, k),
        position.reshape(*shape, k),
        rotation.reshape(*shape, k),
        nearest,
    )


def _padded(array: NDArray, k: int) -> NDArray:  # type: ignore[type-arg]
    """(N, k, ...) from fewer places."""
    wider = [(0, 0), (0, k - array.shape[1])] + [(0, 0)] * (array.ndim - 2)
    return np.pad(array, wider, constant_values=False if array.dtype == bool else np.nan)


# One chunk of targets


@dataclass(frozen=True, eq=False)
class _Problem:
    chain: Chain
    target: Target
    plan: Plan
    position_tolerance: float
    rotation_tolerance: float
    threads: int

    @property
    def projects(self) -> bool:
        """Whether targets that are not solved are projected."""
        return self.chain.dof == 5 and (self.plan.free_joint is not None or self.plan.badly_conditioned)

    def rows(self, T: FloatArray) -> Callable[[newton.State], newton.Rows]:
        """What `pieper.ik.constrained_newton` has to keep, for targets (N, 4, 4)."""
        scale, p, axis = size_of(self.chain), T[:, :3, 3], self.plan.axis_tip
        if axis is None:
            return lambda state: newton.position_rows(state, p, scale)
        across = np.linalg.svd((T[:, :3, :3] @ axis)[:, None, :])[2][:, 1:]
        return lambda state: newton.stacked(
            newton.position_rows(state, p, scale), newton.axis_rows(state, across, axis)
        )

    def descend(
        self,
        T: FloatArray,
        seeds: FloatArray,
        q: FloatArray,
        which: NDArray[np.intp],
        *,
        limits: FloatArray | None = None,
        iterations: int = 40,
    ) -> tuple[FloatArray, BoolArray]:
        """Joint values next to the starts (B, n) that meet the rows and are nearest to the seeds (N, n), and which of them do."""
        near = newton.minimise(
            self.chain,
            q,
            which,
            self.rows(T),
            lambda state: newton.distance_objective(state, seeds),
            limits=limits,
            iterations=iterations,
        )
        position, rotation = self.errors(near.q, T[which])
        return near.q, self.met(position, rotation)  # at a singular place Newton may crawl, and still be there

    def met(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Which errors are within the tolerances."""
        return np.asarray((position <= self.position_tolerance) & (rotation <= self.rotation_tolerance))

    def errors(self, q: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(B,) errors of joint values (B, n) over the rows that count."""
        reached = self.chain.native.fk(q)
        position = np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=-1)
        axis = self.plan.axis_tip
        if axis is None:
            return position, np.zeros(len(q))
        return position, angle_between(reached[:, :3, :3] @ axis, T[:, :3, :3] @ axis)


class _Part(NamedTuple):
    q: FloatArray
    valid: BoolArray
    position: FloatArray
    rotation: FloatArray
    complete: bool
    nearest: Projections | None


def _solve(problem: _Problem, T: FloatArray, seeds: FloatArray | None, samples: int) -> _Part:
    """Answers for targets (N, 4, 4)."""
    chain, plan = problem.chain, problem.plan
    q, which, doubtful = _solve_by_method(problem, T, samples)
    complete, nearest = plan.method is not None and not doubtful.any() and not plan.badly_conditioned, None
    if problem.projects:
        unsure = doubtful | ~np.isin(np.arange(len(T)), which)
        nearest = _scattered(project(chain, Target(T[unsure], axis=tuple(plan.axis_tip))), unsure)  # type: ignore[arg-type]
        complete = complete or (plan.method is None and nearest.complete)
        q, which = np.concatenate([q, nearest.q[nearest.valid]]), np.append(which, np.nonzero(nearest.valid)[0])
    if plan.sampled:
        missed = np.flatnonzero(~np.isin(np.arange(len(T)), which))
        more, more_of = _between_samples(problem, T[missed])
        q, which = np.concatenate([q, more]), np.append(which, missed[more_of])
    q = wrapped(chain, q)
    if plan.free_joint is not None:
        low, high = chain.limits[plan.free_joint]
        q[:, plan.free_joint] = min(max(0.0, low), high) if seeds is None else seeds[which, plan.free_joint]
    if seeds is not None:
        q = _towards(chain, q, seeds[which])
        if plan.sampled and len(T):
            q, which = _with_nearest(problem, T, seeds, q, which)
    position, rotation = problem.errors(q, T[which])
    keep = problem.met(position, rotation)
    order = np.lexsort((np.zeros(len(q)) if seeds is None else np.linalg.norm(q - seeds[which], axis=-1), which))
    order = order[keep[order]]
    order = order[~_repeated(chain, q[order], which[order], len(T), everywhere=not plan.sampled)]
    q, which, position, rotation = q[order], which[order], position[order], rotation[order]
    place = np.arange(len(which)) - np.searchsorted(which, which)
    k = max(1, int(place.max(initial=-1)) + 1)
    padded = [np.full((len(T), k, *part.shape[1:]), np.nan) for part in (q, position, rotation)]
    for room, part in zip(padded, (q, position, rotation), strict=True):
        room[which, place] = part
    valid = np.zeros((len(T), k), dtype=bool)
    valid[which, place] = True
    if nearest is not None:
        nearest = _of_missed(nearest, np.asarray(valid.any(axis=-1)))
    return _Part(padded[0], valid, padded[1], padded[2], complete, nearest)


def _solve_by_method(problem: _Problem, T: FloatArray, samples: int) -> tuple[FloatArray, NDArray[np.intp], BoolArray]:
    """Answers (B, n) of the complete method, the target of each, and the targets that may have more."""
    n, plan = problem.chain.dof, problem.plan
    if plan.method is None or not len(T):
        return np.empty((0, n)), np.empty(0, dtype=np.intp), np.zeros(len(T), dtype=bool)
    filled = _completions(plan, problem.chain, T, samples)
    answers = plan.method.solve(np.ascontiguousarray(filled.reshape(-1, 4, 4)), threads=problem.threads)
    at, _ = np.nonzero(answers.valid)
    return (
        answers.q[answers.valid][:, :n],
        at // filled.shape[1],
        np.asarray(answers.doubtful.reshape(filled.shape[:2]).any(axis=1)),
    )


def _between_samples(problem: _Problem, T: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Members of families so small that no sample met them: by Newton's method from evenly spread starts, then numerically."""
    if not len(T):
        return np.empty((0, problem.chain.dof)), np.empty(0, dtype=np.intp)
    starts = spread_joints(problem.chain, _STARTS)
    which = np.repeat(np.arange(len(T)), _STARTS)
    seeds = np.tile(starts, (len(T), 1))
    q, good = problem.descend(T[which], seeds, seeds, np.arange(len(which)), iterations=100)
    q, which = q[good], which[good]
    missed = np.flatnonzero(~np.isin(np.arange(len(T)), which))
    if not len(missed):
        return q, which
    last = solve_numeric(
        unlimited(problem.chain),
        replace(problem.target, T_base_tip=T[missed]),
        position_tolerance=problem.position_tolerance,
        rotation_tolerance=problem.rotation_tolerance,
        restarts=64,
        threads=problem.threads,
    )
    return np.concatenate([q, last.q[last.valid]]), np.append(which, missed[np.nonzero(last.valid)[0]])


def _scattered(nearest: Projections, where: BoolArray) -> Projections:
    """Projections of some targets in places for all."""
    arrays = []
    for part in nearest[:6]:
        room = np.zeros((len(where), *part.shape[1:]), dtype=part.dtype)
        if part.dtype != bool:
            room[...] = np.nan
        room[where] = part
        arrays.append(room)
    return Projections._make([*arrays, nearest.complete])


def _of_missed(nearest: Projections, reached: BoolArray) -> Projections:
    """Projections of those targets alone that have no answer; the others are within reach."""
    kept = _scattered(Projections._make([*(part[~reached] for part in nearest[:6]), nearest.complete]), ~reached)
    kept.out_of_reach[reached] = 0.0
    return kept


def _repeated(chain: Chain, q: FloatArray, which: NDArray[np.intp], count: int, *, everywhere: bool) -> BoolArray:
    """(B,) answers that come again, in a list sorted by target; of samples only neighbours are compared."""
    place = np.arange(len(which)) - np.searchsorted(which, which)
    most = int(place.max(initial=-1)) + 1
    room = np.full((count, most, q.shape[1]), np.nan)
    room[which, place] = q
    again = np.zeros((count, most), dtype=bool)
    for step in range(1, most if everywhere else min(most, 2 * _NEAREST_SAMPLES)):
        apart = without_turns(chain.is_revolute, room[:, step:] - room[:, :-step])
        with np.errstate(invalid="ignore"):
            again[:, step:] |= np.abs(apart).max(axis=-1) < _SAME
    return np.asarray(again[which, place])


def _towards(chain: Chain, q: FloatArray, seeds: FloatArray) -> FloatArray:
    """Turning joints as the copy within half a turn of the seed."""
    return np.where(chain.is_revolute, q + _TURN * np.round((seeds - q) / _TURN), q)


# Filling the freedom in


def _completions(plan: Plan, chain: Chain, T: FloatArray, samples: int) -> FloatArray:
    """Whole poses (N, m, 4, 4) that agree with targets (N, 4, 4) in the rows that count."""
    n = chain.dof
    if plan.plane is not None:
        several = samples if plan.sampled else 1
        R = turns_about(plan.plane, np.asarray(np.arange(several) * (_TURN / several))) @ chain.home[:3, :3]
        R = np.broadcast_to(R, (len(T), several, 3, 3))
    elif plan.axis_tip is not None:
        if n == 5 or plan.free_joint is not None:
            return T[:, None]
        turns = turns_about(plan.axis_tip, np.asarray(np.arange(samples) * (_TURN / samples)))
        R = T[:, None, :3, :3] @ turns
    elif n == 3:
        R = np.broadcast_to(_SOME_ROTATION, (len(T), 1, 3, 3))
    elif n == 4:
        # the last virtual axis points along half a circle: every direction that it must be across meets that
        angles = (np.arange(samples) + 0.5) * (np.pi / samples)
        half_circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(samples)], axis=-1)
        R = np.broadcast_to(pointing(np.array(VIRTUAL_AXES[1]), half_circle), (len(T), samples, 3, 3))
    elif n == 5:
        R = np.broadcast_to(pointing(np.array(VIRTUAL_AXES[0]), directions(samples)), (len(T), samples, 3, 3))
    else:
        R = np.broadcast_to(orientations(samples), (len(T), samples, 3, 3))
    filled = np.zeros((len(T), R.shape[1], 4, 4))
    filled[..., :3, :3] = R
    filled[..., :3, 3] = T[:, None, :3, 3]
    filled[..., 3, 3] = 1.0
    return filled


# The nearest to a seed


def _with_nearest(
    problem: _Problem, T: FloatArray, seeds: FloatArray, q: FloatArray, which: NDArray[np.intp]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """The samples, and the joint values nearest to the seeds on their families: regardless of limits, and within them."""
    chain = problem.chain
    everyone = np.arange(len(T))
    first, first_of = _best(q, which, seeds, np.ones(len(q), dtype=bool))
    first, first_of = np.concatenate([first, seeds]), np.concatenate([first_of, everyone])
    free, good = problem.descend(T, seeds, first, first_of)
    free, free_of = _towards(chain, free[good], seeds[first_of[good]]), first_of[good]

    inside = _inside(chain, q, seeds[which])
    second, second_of = _best(inside, which, seeds, np.asarray(np.isfinite(inside).all(axis=-1)))
    # a copy that breaks a limit may start inside it, and a branch lead there that no sample is on
    starts, starts_of = np.concatenate([second, first, free]), np.concatenate([second_of, first_of, free_of])
    held, good = problem.descend(T, seeds, starts, starts_of, limits=chain.limits, iterations=100)
    return np.concatenate([q, free, second, held[good]]), np.concatenate([which, free_of, second_of, starts_of[good]])


def _best(
    q: FloatArray, which: NDArray[np.intp], seeds: FloatArray, allowed: BoolArray
) -> tuple[FloatArray, NDArray[np.intp]]:
    """The samples nearest to each seed, a few of them."""
    q, which = q[allowed], which[allowed]
    order = np.lexsort((np.linalg.norm(q - seeds[which], axis=-1), which))
    q, which = q[order], which[order]
    few = np.arange(len(which)) - np.searchsorted(which, which) < _NEAREST_SAMPLES
    return q[few], which[few]


def _inside(chain: Chain, q: FloatArray, seeds: FloatArray) -> FloatArray:
    """Copies by whole turns within limits, the nearest to the seeds; NaN where a joint has none."""
    low, high = chain.limits.T
    with np.errstate(invalid="ignore"):
        least, most = np.ceil((low - q) / _TURN), np.floor((high - q) / _TURN)
        turns = np.clip(np.round((seeds - q) / _TURN), least, most)
        copies = np.where(chain.is_revolute, q + _TURN * turns, q)
        good = np.where(chain.is_revolute, least <= most, (q >= low) & (q <= high))
    return np.asarray(np.where(good, copies, np.nan))
