"""Seven joints with one held: which one, and every solution of the other six for values of it or of the swivel angle."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import general_6r
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import Family, find_family
from pieper.ik.prepared import prepared
from pieper.ik.swivel import Swivel, find_swivel, solve_swivel
from pieper.spatial._checks import FloatArray, whole_number
from pieper.spatial.twist import exp

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.model.chain import Chain

_JOINTS = 7
_DOUBTFUL = int(general_6r.Flag.doubtful)
_TURN = 2.0 * np.pi
_POINT = 1e-6  # rad or m: a range no longer than this is one value
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
        if upper - lower <= _POINT:  # the joint is held
            return np.array([0.5 * (lower + upper)])
        return np.asarray(lower + (np.arange(count) + 0.5) * ((upper - lower) / count))

    def transports(self, values: FloatArray) -> FloatArray:
        """(..., 4, 4): what a target is multiplied by, from the left for the first joint and from the right for the last."""
        back = exp(-values[..., None] * self.chain.screws[self.joint])
        if self.joint == 0:
            return back
        home = self.chain.home
        return np.asarray(np.linalg.inv(home) @ back @ home)


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


def _without(chain: Chain, joint: int, value: float) -> Chain:
    return chain.lock(**{chain.joint_names[joint]: value})


def sampled(redundancy: Redundancy, samples: int, *, limited: bool = True) -> tuple[FloatArray, FloatArray]:
    """Sampled values and their transports, made once."""
    plan = redundancy._kept.get((samples, limited))
    if plan is None:
        count = whole_number(samples, "samples")
        values = redundancy.samples(count, limited=limited)
        plan = redundancy._kept[samples, limited] = (values, np.ascontiguousarray(redundancy.transports(values)))
    return plan


def solve_end(
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


def solve_inner(
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


def at_swivel_angles(
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
