"""Every solution of seven joints with one held: those of the other six, judged at the tip of the whole arm; and for swivel angles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import general_6r
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import Family, find_family
from pieper.ik.held_joint import RedundantSolutions
from pieper.ik.swivel import find_swivel, solve_swivel
from pieper.spatial._checks import whole_number

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.ik.held_joint import Redundancy
    from pieper.ik.swivel import Swivel
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

_DOUBTFUL = int(general_6r.Flag.doubtful)
_MOST_HELD = 256  # arms with an inner joint held that are remembered


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
        rest = redundancy.chain.lock(**{redundancy.chain.joint_names[joint]: value})
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
