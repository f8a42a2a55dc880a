"""Arms with seven joints at a pose: every solution for a value of one joint, and the whole curves of solutions.

With one joint held, six are left, which `pieper.ik.closed_form` or `pieper.ik.general_6r` solves completely. Holding an
*end* joint changes the target only, not the arm: with ``T = exp(s_1 q_1) ... exp(s_7 q_7) M``

    exp(s_2 q_2) ... exp(s_7 q_7) M = exp(-s_1 q_1) T,
    exp(s_1 q_1) ... exp(s_6 q_6) M = T M^-1 exp(-s_7 q_7) M,

so that the six joints are examined once and solved for any number of values in one call. `prepare` chooses the end whose
rest has a closed form. Arms with a spherical shoulder and a spherical wrist also take the swivel angle of their
elbow, see `pieper.ik.swivel`; an inner joint is held when asked by name.

The solutions of a pose form curves, along which the arm moves while its tip stays (self-motion). `self_motion` follows
all that pass through a sampled value, `nearest_on_self_motion` finds their point nearest to where the arm is, and `track_branches`
tells which of the sampled solutions belong together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, TypeGuard

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import general_6r
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.curve import NearestPoint, SolutionCurve, crossing, follow
from pieper.ik.family import Family, find_family
from pieper.ik.numeric import solve_numeric
from pieper.ik.prepared import prepared
from pieper.ik.swivel import Swivel, find_swivel, solve_swivel
from pieper.ik.target import pose
from pieper.kinematics.joints import as_joints
from pieper.spatial._checks import FloatArray, poses, stack, together, whole_number
from pieper.spatial.twist import exp

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain

SAMPLES = 16
"""Values that are tried when none are given."""

SAMPLES_OF_SELF_MOTION = 64
"""The same where all curves of a pose are looked for."""

_JOINTS = 7
_DOUBTFUL = int(general_6r.Flag.doubtful)
_TURN = 2.0 * np.pi
_LIMIT_ROUNDING = 1e-12  # rad or m by which a value may be beyond its range
_TOLERANCES = np.array([1e-9, 1e-9])
_SAME = 1e-6  # rad or m: solutions no farther apart are one
_SOLVES = 1e-8  # m or -: how well a joint vector has to meet a pose to be taken for a solution
_REGULAR = 1e-3  # least singular value of the Jacobian of a pose that is far enough from singular ones
_MOST_CURVES = 64
_ITERATED = 256  # solutions that iteration adds to the sampled ones, from starts all over the joint space
_MOST_HELD = 256  # arms with an inner joint held that are remembered


class RedundantSolutions(NamedTuple):
    """Every solution of every pose for each of m values of the redundancy; k places for each value, empty ones NaN."""

    q: FloatArray
    """(..., m k, n) joint values [rad or m]. Joints that turn are in (-pi, pi], but for the one that is held. Joint limits are not
    looked at."""
    valid: NDArray[np.bool_]
    """(..., m k): True for solutions within the tolerances."""
    position_error: FloatArray
    """(..., m k): measured at the pose that forward kinematics gives for all joints [m]."""
    rotation_error: FloatArray
    """(..., m k): the same for the rotation [rad]."""
    value: FloatArray
    """(..., m k): the value that each place belongs to [rad or m]."""
    doubtful: NDArray[np.bool_]
    """(..., m): True where solutions may be missing for a value, as at poses where they form curves though a joint is held."""


@dataclass(frozen=True, eq=False)
class Redundancy:
    """An arm with seven joints, the joint that is held, and how the other six are solved. Made by `prepare`.

    Attributes
    ----------
    chain : Chain
    joint : int
        The joint whose value is given, counted from 0.
    rest : Chain
        The other six, with that joint at 0.
    family : Family
        Their closed form; `Family.has_closed_form` is False where the general solver does it.
    swivel : Swivel or None
        Shoulder, elbow and wrist, of an arm that has them.
    """

    chain: Chain
    joint: int
    rest: Chain
    family: Family
    swivel: Swivel | None
    _kept: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def joint_name(self) -> str:
        """Name of the joint whose value is given."""
        return self.chain.joint_names[self.joint]

    @property
    def reason(self) -> str:
        """What was found, in words."""
        how = self.family.reason if self.family.has_closed_form else "no closed form: solved by the general solver"
        swivel = "; spherical shoulder and wrist: the swivel angle may be given instead" if self.swivel else ""
        return f"{self.joint_name} is given; of the other six, {how}{swivel}"

    @cached_property
    def without_limits(self) -> Chain:
        """The arm with a whole turn for every joint that turns."""
        limits = np.where(self.chain.is_revolute[:, None], [-np.pi, np.pi], self.chain.limits)
        return replace(self.chain, limits=limits)

    @property
    def places(self) -> int:
        """Places for solutions of one value, k."""
        return 8 if self.family.has_closed_form and self.family.level == "exact" else general_6r.MOST_SOLUTIONS

    def samples(self, count: int, *, limited: bool = True) -> FloatArray:
        """(count,): values in the middle of as many equal parts of the range of the joint, or of one turn if that is less.

        Parameters
        ----------
        count : int
        limited : bool
            False for a whole turn, whatever the limits of the joint.

        Returns
        -------
        (count,) array
            [rad or m].

        Raises
        ------
        ArrayError
            The joint slides without limits.
        """
        lower, upper = self.chain.limits[self.joint]
        if self.chain.is_revolute[self.joint] and (not limited or not upper - lower < _TURN):
            lower, upper = -np.pi, np.pi
        if not np.isfinite(upper - lower):
            raise ArrayError(
                f"{self.joint_name} slides without limits, so that there is no range to sample; give values"
            )
        if upper - lower <= _SAME:  # the joint is held
            return np.array([0.5 * (lower + upper)])
        return np.asarray(lower + (np.arange(count) + 0.5) * ((upper - lower) / count))

    def transports(self, values: FloatArray) -> FloatArray:
        """(..., 4, 4): what a target is multiplied by, from the left for the first joint and from the right for the last."""
        back = exp(-values[..., None] * self.chain.screws[self.joint])
        if self.joint == 0:
            return back
        home = self.chain.home
        return np.asarray(np.linalg.inv(home) @ back @ home)


def fits(chain: Chain) -> bool:
    """True for arms that `solve_redundant` takes: seven joints, six of which are solved with one held."""
    try:
        prepare(chain)
    except ArrayError:
        return False
    return True


def prepare(chain: Chain) -> Redundancy:
    """Which joint of an arm with seven is held, and how the others are solved; kept as long as the chain lives.

    An end joint whose rest has a closed form comes first, with plain roots before quartics; then the end for which the general
    solver has least to do.

    Parameters
    ----------
    chain : Chain
        Seven joints.

    Returns
    -------
    Redundancy

    Raises
    ------
    ArrayError
        Another number of joints, mimic joints, or six joints that no complete solver takes.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> print(prepare(catalog.describe("franka_panda").chain()).reason)
    panda_joint7 is given; of the other six, axes 4, 5 and 6 meet (spherical wrist), and axes 1 and 2 meet, read from the tip: up to 8 answers (exact)
    """
    return prepared(chain, "redundancy", None, lambda: _make(chain))


def _make(chain: Chain) -> Redundancy:
    if chain.dof != _JOINTS or chain.is_coupled:
        more = "; lock all but seven first, or use the numeric solver" if chain.dof > _JOINTS else ""
        mimic = " and mimic joints" if chain.is_coupled else ""
        raise ArrayError(f"redundancy is that of seven joints; {chain.name!r} has {chain.dof}{mimic}{more}")
    found = []
    for joint in (_JOINTS - 1, 0):
        rest = _without(chain, joint, 0.0)
        family = find_family(rest)
        if family.complete:
            found.append(((0.0, float(family.level != "exact"), float(family.quartic)), joint, rest, family))
        elif rest.is_revolute.all():
            best = min(general_6r.prepare(rest).native.reports, key=lambda r: r.rank if r.rank >= 0 else 99)
            found.append(((1.0, 1.0 - best.found, best.median_work), joint, rest, family))
    if not found:
        raise ArrayError(
            f"no six joints of {chain.name!r} can be solved completely with its first or its last joint held "
            f"({family.reason}); use the numeric solver"
        )
    _, joint, rest, family = min(found, key=lambda entry: entry[0])
    try:
        swivel = find_swivel(chain)
    except ArrayError:
        swivel = None
    return Redundancy(chain, joint, rest, family, swivel)


def solve_redundant(
    chain: Chain,
    T_base_tip: ArrayLike,
    *,
    values: ArrayLike | Mapping[str, ArrayLike] | None = None,
    samples: int = SAMPLES,
    swivel: Swivel | None = None,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    threads: int = 1,
) -> RedundantSolutions:
    """Every solution of an arm with seven joints for given values of one of them, or of its swivel angle.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (..., 4, 4) array_like
        Poses of the tip in the base frame [m, -].
    values : (..., m) array_like or mapping, optional
        Values of the joint that `prepare` chose [rad or m]; leading axes broadcast with those of the poses. Or a mapping of one
        name to values: ``{"joint_3": 0.2}`` holds another joint, ``{"swivel": angles}`` gives swivel angles. A number is one value.
        Default: `samples` values, each in the middle of a part of the range of the joint.
    samples : int
        How many values are tried when none are given.
    swivel : Swivel, optional
        What swivel angles are counted from; the stereographic reference when not given.
    position_tolerance, rotation_tolerance : float
        What counts as a solution [m] and [rad].
    threads : int
        Number of threads for a batch.

    Returns
    -------
    RedundantSolutions
        For each value all solutions that there are; joint limits are left aside, but for the value itself.

    Raises
    ------
    ArrayError
        A pose or value is malformed, a value is outside the limits of its joint, or the arm has no swivel angle.
    UnknownNameError
        There is no joint of that name.

    Notes
    -----
    An inner joint changes the arm of the other six, which is then examined for each value anew: milliseconds instead of microseconds.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("franka_panda").chain()
    >>> q = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]
    >>> answers = solve_redundant(arm, fk(arm, q), values=0.7)
    >>> bool(abs(answers.q[answers.valid] - q).max(axis=1).min() < 1e-9)
    True
    >>> int(solve_redundant(arm, fk(arm, q)).valid.sum()) > 30
    True
    """
    redundancy = prepare(chain)
    threads = whole_number(threads, "threads")
    tolerances = np.array([position_tolerance, rotation_tolerance])
    if values is None:
        plan = _sampled(redundancy, samples)
        if _is_plain(T_base_tip):  # the kernels look at the targets, which are poses only if these are
            try:
                return _solve_end(redundancy, T_base_tip, *plan, tolerances, threads)
            except ArrayError:
                poses(T_base_tip, "T_base_tip")  # says it in terms of what came, if that is what is wrong
                raise
        return _solve_end(redundancy, poses(T_base_tip, "T_base_tip"), *plan, tolerances, threads)
    T = poses(T_base_tip, "T_base_tip")
    name: str | None = None
    if isinstance(values, Mapping):
        if len(values) != 1:
            raise ArrayError(f"values must name one joint or 'swivel', got {len(values)} names: {', '.join(values)}")
        ((name, given),) = values.items()
    elif isinstance(values, str):
        raise ArrayError(
            f"values of the redundancy must be numbers, or a mapping of one name to numbers as {{{values!r}: 0.3}}, got {values!r}"
        )
    else:
        given = values
    words = "values" if name is None else f"values of {name!r}"
    array = stack(np.atleast_1d(stack(given, (), words)), ("m",), words)
    leading = together(T_base_tip=T.shape[:-2], values=array.shape[:-1])
    T = np.ascontiguousarray(np.broadcast_to(T, (*leading, 4, 4)))
    if name == "swivel":
        return _solve_swivel(redundancy, T, array, swivel, tolerances)
    joint = redundancy.joint if name is None else chain.joint_index(name)
    _require_in_range(chain, joint, array)
    if joint != redundancy.joint:
        return _solve_inner(redundancy, T, joint, array, tolerances, threads)
    transports = redundancy.transports(array)
    return _solve_end(redundancy, T, array, transports, tolerances, threads)


def self_motion(
    chain: Chain,
    T_base_tip: ArrayLike,
    *,
    also: ArrayLike | None = None,
    samples: int = SAMPLES_OF_SELF_MOTION,
    step: float = 0.1,
) -> list[SolutionCurve]:
    """The curves of all solutions of a pose, of an arm with seven joints.

    Every solution for `samples` values of a joint, a whole turn round, is on some curve, and so are those that iteration finds from all
    over the joint space. Each curve is followed once, through folds, with joint limits left aside: `SolutionCurve.intervals` are its
    parts inside them. Curves that cross one of these are followed too.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (4, 4) array_like
        Pose of the tip in the base frame [m, -].
    also : (n,) array_like, optional
        Joint values [rad or m] whose curve is to be among them, if they are a solution.
    samples : int
        Values of the joint that `prepare` chose, and of the swivel angle where there is one.
    step : float
        Largest distance between points of a curve.

    Returns
    -------
    list of SolutionCurve
        Longest first; empty when the pose is out of reach.

    Raises
    ------
    ArrayError
        Another kind of arm, or a malformed pose.

    Notes
    -----
    A curve can be missed when all of it falls between two neighbouring values of the sampled joint, ``2 pi / samples`` apart (0.1 rad by
    default), and iteration does not arrive on it: a short one, near a pose where it shrinks to a point. Joints that slide stay
    within their limits, and a curve that leaves them ends there.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_iiwa14").chain()
    >>> curves = self_motion(arm, fk(arm, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4]))
    >>> len(curves), all(curve.closed for curve in curves)
    (8, True)
    """
    redundancy = prepare(chain)
    T = poses(T_base_tip, "T_base_tip")
    if T.shape != (4, 4):
        raise ArrayError(f"self-motion is that of one pose, of shape (4, 4), got {T.shape}")
    answers = _solve_end(redundancy, T, *_sampled(redundancy, samples, limited=False), _TOLERANCES, 1)
    left = answers.q[answers.valid]
    if redundancy.swivel is not None:
        angles: FloatArray = (np.arange(samples, dtype=float) + 0.5) * (_TURN / samples) - np.pi
        answers = _solve_swivel(redundancy, T, angles, None, _TOLERANCES)
        left = np.concatenate([left, answers.q[answers.valid]])
    found = solve_numeric(redundancy.without_limits, T, count=_ITERATED, restarts=2 * _ITERATED)
    started = found.q[found.valid]
    least = np.linalg.svd(chain.native.jacobian(started), compute_uv=False)[:, -1]
    left = np.concatenate([left, started[least > _REGULAR]])  # near singular poses iteration stops beside a curve
    if also is not None:
        here = as_joints(chain, also, name="also")
        if here.ndim != 1:
            raise ArrayError(f"also must have shape ({chain.dof},), got {here.shape}")
        if np.abs(chain.native.fk(here) - T).max() < _SOLVES:
            left = np.concatenate([here[None], left])
    target = pose(T)
    curves: list[SolutionCurve] = []
    while len(left) and len(curves) < _MOST_CURVES:
        curve = follow(chain, target, left[0], step=step)
        left = left[1:]
        if curve is not None:
            curves.append(curve)
            left = left[~curve.contains(left, tolerance=_SAME)]
            for point in crossing(curve):
                if not any(known.contains(point, tolerance=_SAME) for known in curves):
                    left = np.concatenate([left, point[None]])
    return sorted(curves, key=lambda curve: -curve.length)


def nearest_on_self_motion(
    chain: Chain,
    T_base_tip: ArrayLike,
    seed: ArrayLike,
    *,
    within_limits: bool = True,
    samples: int = SAMPLES_OF_SELF_MOTION,
) -> NearestPoint:
    """The solution of a pose that is nearest to a joint vector, among all that there are and not only sampled ones.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (4, 4) array_like
        Pose of the tip in the base frame [m, -].
    seed : (n,) array_like
        Joint values [rad or m].
    within_limits : bool
        Whether the solution has to be inside the joint limits.
    samples : int
        As for `self_motion`, on whose curves it looks.

    Returns
    -------
    NearestPoint
        NaN, and an infinite distance, where the pose is out of reach or has no solution within limits.

    Raises
    ------
    ArrayError
        As `self_motion`, or the seed is malformed.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("franka_panda").chain()
    >>> q = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]
    >>> nearest_on_self_motion(arm, fk(arm, q), q).q.round(6)
    array([ 0.1, -0.5,  0.2, -2. ,  0.3,  1.6,  0.7])
    """
    best = NearestPoint(np.full(chain.dof, np.nan), np.nan, np.inf)
    for curve in self_motion(chain, T_base_tip, also=seed, samples=samples):
        best = min(best, curve.nearest(seed, within_limits=within_limits), key=lambda point: point.distance)
    return best


def track_branches(solutions: RedundantSolutions, curves: list[SolutionCurve]) -> NDArray[np.int64]:
    """Which solutions of one pose for several values of a joint belong to one branch.

    Along a branch the value rises or falls and the other joints follow it; at a fold it turns back and another branch begins. Two
    solutions for neighbouring values belong to one branch when a curve leads from one to the other without a fold between.

    Parameters
    ----------
    solutions : RedundantSolutions
        Those of one pose for values of one joint.
    curves : list of SolutionCurve
        The curves of the same pose, as `self_motion` gives them.

    Returns
    -------
    (m k,) int array
        Number of the branch of each place, from 0; -1 for empty places and solutions on none of the curves.

    Raises
    ------
    ArrayError
        The solutions are those of several poses, or of swivel angles.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_iiwa14").chain()
    >>> T = fk(arm, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    >>> answers = solve_redundant(arm, T)
    >>> branch = track_branches(answers, self_motion(arm, T))
    >>> answers.q[branch == 0][:, prepare(arm).joint].round(2)
    array([0.19, 0.57, 0.95])
    """
    if solutions.value.ndim != 1:
        raise ArrayError(
            f"branches are those of one pose; these solutions have leading axes {solutions.value.shape[:-1]}"
        )
    branch = np.full(solutions.valid.shape, -1)
    left = solutions.valid.copy()
    if not left.any():
        return branch
    held = np.flatnonzero((solutions.q[left] == solutions.value[left, None]).all(axis=0))
    if not len(held):
        raise ArrayError(
            "branches are followed along values of one joint, and these solutions are not; solve with `samples`, or name a joint"
        )
    gap = 1.001 * float(np.diff(np.unique(solutions.value)).max(initial=0.0))
    count = 0
    for curve in curves:
        tried = np.flatnonzero(left)
        places = curve.place(solutions.q[tried], tolerance=_SAME)
        on, places = tried[~np.isnan(places)], places[~np.isnan(places)]
        if not len(on):
            continue
        left[on] = False
        order = np.argsort(places, kind="stable")
        on, places = on[order], places[order]
        runs = np.split(np.arange(len(on)), np.flatnonzero(~_joined(curve, int(held[0]), places, gap)[:-1]) + 1)
        if len(runs) > 1 and _joined(curve, int(held[0]), places, gap)[-1]:  # the curve began in the middle of a branch
            runs[0] = np.concatenate([runs.pop(), runs[0]])
        for run in runs:
            branch[on[run]] = count
            count += 1
    return branch


def _joined(curve: SolutionCurve, joint: int, places: FloatArray, gap: float) -> NDArray[np.bool_]:
    """(k,): whether the joint goes on from each place to the next, and from the last to the first, by no more than a gap
    between values and without turning back.
    """
    after = np.append(places[1:], places[0] + curve.length)
    change = (
        curve.at(np.where(curve.closed, after, np.minimum(after, curve.length)))[:, joint] - curve.at(places)[:, joint]
    )
    way = np.sign(change)
    joined = (np.abs(change) <= gap) & (way != 0.0)
    joined[-1] &= curve.closed
    along = np.concatenate([curve.s, curve.s + curve.length])
    tangents = np.concatenate([curve.tangents[:, joint]] * 2)
    for i in np.flatnonzero(joined):
        between = (along > places[i]) & (along < after[i])
        joined[i] = bool((tangents[between] * way[i] > 0.0).all())
    return np.asarray(joined)


def _is_plain(T: object) -> TypeGuard[FloatArray]:
    """True for finite float64 arrays of shape (..., 4, 4)."""
    if type(T) is not np.ndarray or T.dtype != np.float64 or T.shape[-2:] != (4, 4):
        return False
    return isfinite(T.sum()) if T.ndim == 2 else bool(np.isfinite(T).all())


def _without(chain: Chain, joint: int, value: float) -> Chain:
    return chain.lock(**{chain.joint_names[joint]: value})


def _sampled(redundancy: Redundancy, samples: int, *, limited: bool = True) -> tuple[FloatArray, FloatArray]:
    """Sampled values and their transports, made once."""
    plan = redundancy._kept.get((samples, limited))
    if plan is None:
        count = whole_number(samples, "samples")
        values = redundancy.samples(count, limited=limited)
        plan = redundancy._kept[samples, limited] = (values, np.ascontiguousarray(redundancy.transports(values)))
    return plan


def _require_in_range(chain: Chain, joint: int, values: FloatArray) -> None:
    lower, upper = chain.limits[joint]
    outside = (values < lower - _LIMIT_ROUNDING) | (values > upper + _LIMIT_ROUNDING)
    if outside.any():
        raise ArrayError(
            f"values of {chain.joint_names[joint]!r} must be within its limits, {lower:.6g} to {upper:.6g}, "
            f"got {values[outside].flat[0]:.6g}"
        )


def _solve_end(
    redundancy: Redundancy,
    T: FloatArray,
    values: FloatArray,
    transports: FloatArray,
    tolerances: FloatArray,
    threads: int,
) -> RedundantSolutions:
    """The joint that `prepare` chose held at `values` (..., m)."""
    at = T[..., None, :, :]
    targets = transports @ at if redundancy.joint == 0 else at @ transports
    q, valid, doubtful = _solve_six(redundancy.rest, redundancy.family, redundancy.places, targets, tolerances, threads)
    return _assembled(redundancy.chain, T, redundancy.joint, values, q, valid, doubtful, tolerances)


def _solve_six(
    rest: Chain,
    family: Family,
    places: int,
    targets: FloatArray,
    tolerances: FloatArray,
    threads: int,
) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """All solutions of the six joints that are left: q (..., k, 6), valid (..., k), doubtful (...)."""
    if family.has_closed_form:
        position, rotation = tolerances.tolist()
        found = solve_closed_form(
            rest, family, targets, position_tolerance=position, rotation_tolerance=rotation, threads=threads
        )
        if places == found.q.shape[-2]:
            return found.q, found.valid, found.doubtful
        k = found.q.shape[-2]
        q = np.full((*found.valid.shape[:-1], places, rest.dof), np.nan)
        valid = np.zeros((*found.valid.shape[:-1], places), dtype=bool)
        q[..., :k, :], valid[..., :k] = found.q, found.valid
        doubtful = found.doubtful
        if doubtful.any() and rest.is_revolute.all():  # beside folds of the ideal arm the general solver looks again
            general = general_6r.solve_general_6r(rest, np.ascontiguousarray(targets[doubtful]), threads=threads)
            q[doubtful], valid[doubtful] = general.q, general.valid
            doubtful = doubtful.copy()
            doubtful[doubtful] = (general.flags & _DOUBTFUL) != 0
        return q, valid, doubtful
    general = general_6r.solve_general_6r(rest, targets, threads=threads)
    return general.q, general.valid, np.asarray((general.flags & _DOUBTFUL) != 0)


def _assembled(
    chain: Chain,
    T: FloatArray,
    joint: int,
    values: FloatArray,
    q: FloatArray,
    valid: NDArray[np.bool_],
    doubtful: NDArray[np.bool_],
    tolerances: FloatArray,
) -> RedundantSolutions:
    """Solutions of six joints (..., m, k, 6) with the seventh put in, judged as those of seven."""
    shape = valid.shape
    places = (*shape[:-2], shape[-2] * shape[-1])
    value = np.empty(shape)
    value[...] = values[..., None]
    value = value.reshape(places)
    rows = valid.reshape(-1).nonzero()[0]
    six = q.reshape(-1, q.shape[-1]).take(rows, axis=0)
    seven = np.empty((len(rows), q.shape[-1] + 1))
    seven[:, :joint] = six[:, :joint]
    seven[:, joint] = value.reshape(-1).take(rows)
    seven[:, joint + 1 :] = six[:, joint:]
    return _judged(chain, T, places, rows, seven, value, doubtful, tolerances)


def _judged(
    chain: Chain,
    T: FloatArray,
    places: tuple[int, ...],
    rows: NDArray[np.intp],
    found: FloatArray,
    value: FloatArray,
    doubtful: NDArray[np.bool_],
    tolerances: FloatArray,
) -> RedundantSolutions:
    """Candidates (r, n), each with its own place among all, and the errors that they have at the tip of the whole arm."""
    reached = chain.native.fk(found)
    reached -= T if T.ndim == 2 else T.reshape(-1, 4, 4).take(rows // places[-1], axis=0)
    reached *= reached
    parts = reached.reshape(-1, 16).T  # added one by one, so that a sum is the same in any batch
    errors = np.empty((len(rows), 2))
    errors[:, 0] = parts[3] + parts[7] + parts[11]
    x, y, z = parts[0:3], parts[4:7], parts[8:11]
    columns = x + y + z
    errors[:, 1] = 0.5 * (columns[0] + columns[1] + columns[2])  # |R - R_wanted| = 2 sqrt(2) sin(angle / 2)
    np.sqrt(errors, out=errors)
    good = (errors <= tolerances).all(axis=-1)
    if not good.all():
        rows, found, errors = rows[good], found[good], errors[good]
    q = np.full((value.size, found.shape[-1]), np.nan)
    q[rows] = found
    measured = np.full((value.size, 2), np.nan)
    measured[rows] = errors
    measured = measured.reshape(*places, 2)
    valid = np.zeros(value.size, dtype=bool)
    valid[rows] = True
    return RedundantSolutions(
        q.reshape(*places, chain.dof), valid.reshape(places), measured[..., 0], measured[..., 1], value, doubtful
    )


def _solve_inner(
    redundancy: Redundancy,
    T: FloatArray,
    joint: int,
    values: FloatArray,
    tolerances: FloatArray,
    threads: int,
) -> RedundantSolutions:
    """Another joint held: the six that are left are another arm for each value, unless the joint is the other end."""
    chain = redundancy.chain
    wanted = np.broadcast_shapes(T.shape[:-2], values.shape[:-1])
    T = np.broadcast_to(T, (*wanted, 4, 4))
    held = np.broadcast_to(values, (*wanted, values.shape[-1]))
    k = general_6r.MOST_SOLUTIONS
    q = np.full((*held.shape, k, chain.dof - 1), np.nan)
    valid = np.zeros((*held.shape, k), dtype=bool)
    doubtful = np.zeros(held.shape, dtype=bool)
    for number in np.unique(held):
        rest, family = _held(redundancy, joint, float(number))
        here = np.nonzero(held == number)
        targets = np.ascontiguousarray(T[here[:-1]])
        found, good, unsure = _solve_six(rest, family, k, targets, tolerances, threads)
        q[here], valid[here], doubtful[here] = found, good, unsure
    return _assembled(chain, T, joint, held, q, valid, doubtful, tolerances)


def _held(redundancy: Redundancy, joint: int, value: float) -> tuple[Chain, Family]:
    """The six joints that are left, and their closed form if there is one."""
    known = redundancy._kept.get((joint, value))
    if known is None:
        rest = _without(redundancy.chain, joint, value)
        family = find_family(rest)
        if not family.complete:
            family = Family("none", family.reason)
            if not rest.is_revolute.all():
                name = redundancy.chain.joint_names[joint]
                raise ArrayError(
                    f"with {name!r} held at {value:.6g} no complete solver takes the other six: {family.reason}"
                )
        known = (rest, family)
        if len(redundancy._kept) < _MOST_HELD:
            redundancy._kept[joint, value] = known
    return known


def _solve_swivel(
    redundancy: Redundancy,
    T: FloatArray,
    angles: FloatArray,
    swivel: Swivel | None,
    tolerances: FloatArray,
) -> RedundantSolutions:
    chain = redundancy.chain
    points = swivel or redundancy.swivel or find_swivel(chain)  # the last one says why there is none
    if points.chain is not chain:
        raise ArrayError(f"swivel is that of {points.chain.name!r}, not of this {chain.name!r}")
    angles = np.broadcast_to(angles, (*np.broadcast_shapes(T.shape[:-2], angles.shape[:-1]), angles.shape[-1]))
    T = np.broadcast_to(T, (*angles.shape[:-1], 4, 4))
    q, value = solve_swivel(points, np.broadcast_to(T[..., None, :, :], (*angles.shape, 4, 4)), angles)
    *leading, m, k, n = q.shape
    found = q.reshape(-1, n)
    rows = (~np.isnan(found[:, 0])).nonzero()[0]
    value = value.reshape(*leading, m * k)
    doubtful = np.zeros(angles.shape, dtype=bool)
    return _judged(chain, T, (*leading, m * k), rows, found[rows], value, doubtful, tolerances)
