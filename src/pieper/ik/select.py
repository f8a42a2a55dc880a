"""Choosing among answers: those within limits, those of a branch, and the one nearest to where the arm is.

A joint that turns looks the same after a whole turn, so an answer stands for all its copies ``q + 2 pi k``.
`within_limits`, `nearest` and `along` take the copy that suits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.kinematics.joints import as_joints, periodic_joints
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.ik.solutions import IKSolutions
    from pieper.model.chain import Chain

_TURN = 2.0 * np.pi
_ROUNDING = 1e-9  # [rad or m]; as far outside a limit a value is put on it, as the compiled core does


def within_limits(answers: IKSolutions, chain: Chain | None = None) -> IKSolutions:
    """The answers that have a copy inside the joint limits, as that copy; the others are no longer valid.

    Parameters
    ----------
    answers : IKSolutions
    chain : Chain, optional
        Whose limits to keep; the arm that the answers were found for when not given.

    Returns
    -------
    IKSolutions
        Same shapes; NaN and ``valid`` False where no copy of an answer is inside.

    Examples
    --------
    >>> from pieper.ik.solve import solve
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> answers = solve(arm, fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]), count=4)
    >>> within_limits(answers, arm).valid
    array([ True,  True,  True,  True])
    """
    chain = answers.chain if chain is None else chain
    lowest, highest = _whole_turns(answers.q, chain)
    q = answers.q + _TURN * np.clip(0.0, lowest, np.maximum(lowest, highest))
    lower, upper = chain.limits.T
    with np.errstate(invalid="ignore"):
        inside = np.asarray(answers.valid & np.all((q >= lower) & (q <= upper), axis=-1))
    return _keep(replace(answers, chain=chain, q=q, within_limits=inside), inside)


def by_branch(answers: IKSolutions, branch: str) -> IKSolutions:
    """The answers of a branch, as in ``"front, elbow up"``; the others are no longer valid.

    Parameters
    ----------
    answers : IKSolutions
    branch : str
        Words of the labels, separated by commas: ``"front"``, ``"back"``, ``"elbow up"``, ``"elbow down"``, ``"flip"``, ``"no flip"``.
        What is left out may be either.

    Returns
    -------
    IKSolutions
        Same shapes; NaN and ``valid`` False in the places of other branches.

    Raises
    ------
    UnknownNameError
        No branch of this arm has such a word, or its branches have no names.

    Examples
    --------
    >>> from pieper.ik.solve import solve
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> answers = solve(arm, fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]))
    >>> chosen = by_branch(answers, "front, elbow up")
    >>> [label for label in chosen.labels[chosen.valid]]
    ['front, elbow up, no flip', 'front, elbow up, flip']
    """
    known = sorted({word for name in answers.branch_names if name for word in name.split(", ")})
    wanted = [word.strip() for word in branch.split(",") if word.strip()]
    for word in wanted:
        if word not in known:
            raise unknown_name("label", word, known, f"the answers of {answers.chain.name!r}")
    fits = np.array([bool(name) and set(wanted) <= set(name.split(", ")) for name in answers.branch_names] + [False])
    kept = np.asarray(answers.valid & fits[answers.branch])
    return _keep(answers, kept)


def _keep(answers: IKSolutions, kept: NDArray[np.bool_]) -> IKSolutions:
    """Only some of the answers."""
    return replace(
        answers,
        q=np.where(kept[..., None], answers.q, np.nan),
        valid=kept,
        within_limits=answers.within_limits & kept,
        branch=np.where(kept, answers.branch, -1).astype(np.int8),
        position_error=np.where(kept, answers.position_error, np.nan),
        rotation_error=np.where(kept, answers.rotation_error, np.nan),
    )


def nearest(answers: IKSolutions, q: ArrayLike, *, weights: ArrayLike | None = None) -> FloatArray:
    """The answer nearest to `q`, each turning joint as the copy nearest to it that its limits allow.

    Answers outside the limits are taken only where none is inside.

    Nearest is ``sqrt(sum((weights * (answer - q))^2))``.

    Parameters
    ----------
    answers : IKSolutions
    q : (..., n) array
        Joint values to stay near, for example where the arm is now [rad or m]; leading axes broadcast to the targets.
    weights : (n,) array, optional
        How much the motion of each joint counts; all alike when not given, a metre as much as a radian.

    Returns
    -------
    (..., n) array
        One answer per target [rad or m]; NaN where a target has none.

    Raises
    ------
    ArrayError
        Wrong shape, or not finite.

    Examples
    --------
    >>> from pieper.ik.solve import solve
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> answers = solve(arm, fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 3.3]), seed=[0.1, -1.2, 1.4, -1.7, -1.5, 3.2])
    >>> nearest(answers, [0.0, -1.0, 1.0, -1.5, -1.5, -3.0]).round(6)
    array([ 0.1     , -1.2     ,  1.4     , -1.7     , -1.5     , -2.983185])
    """
    chain = answers.chain
    here = as_joints(chain, q)
    try:
        here = np.broadcast_to(here, (*answers.status.shape, chain.dof))
    except ValueError:
        raise ArrayError(
            f"q must have leading axes that broadcast to {answers.status.shape}, got shape {here.shape}"
        ) from None
    scale = np.ones(chain.dof) if weights is None else stack(weights, (chain.dof,), "weights")
    if not answers.valid.shape[-1]:
        return np.full_like(here, np.nan)
    lowest, highest = _whole_turns(answers.q, chain)
    wanted = np.round((here[..., None, :] - answers.q) / _TURN)
    none_inside = highest < lowest
    turns = np.where(none_inside, wanted, np.clip(wanted, lowest, np.maximum(lowest, highest)))
    copies = _on_limits(answers.q + _TURN * np.where(periodic_joints(chain), turns, 0.0), chain)
    distance = np.linalg.norm(scale * (copies - here[..., None, :]), axis=-1)
    inside = np.asarray(answers.valid & ~none_inside.any(axis=-1))
    wanted_of = np.where(inside.any(axis=-1, keepdims=True), inside, answers.valid)
    best = np.argmin(np.where(wanted_of, distance, np.inf), axis=-1)
    chosen = np.take_along_axis(copies, best[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(np.where(np.asarray(answers.valid.any(axis=-1))[..., None], chosen, np.nan))


def along(answers: IKSolutions, q: ArrayLike) -> FloatArray:
    """For targets one after the other: the answer nearest to the one taken before, the first one nearest to `q`.

    What `nearest` takes, target after target; one that has no answer is left out, and the next is near to the one before it.

    Parameters
    ----------
    answers : IKSolutions
        Of m targets.
    q : (n,) array
        Joint values where the sequence begins, for example where the arm is now [rad or m].

    Returns
    -------
    (m, n) array
        One answer per target [rad or m]; NaN where a target has none.

    Raises
    ------
    ArrayError
        Targets that are no sequence, or `q` of a wrong shape or not finite.

    Examples
    --------
    >>> from pieper.ik.solve import solve
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> turning = [[0.1, -1.2, 1.4, -1.7, -1.5, q6] for q6 in (2.0, 3.0, 4.0, 5.0)]  # past pi, where an angle would wrap
    >>> along(solve(arm, fk(arm, turning)), turning[0])[:, 5].round(6)
    array([2., 3., 4., 5.])
    """
    chain = answers.chain
    here = as_joints(chain, q)
    if answers.status.ndim != 1 or here.ndim != 1:
        raise ArrayError(
            f"along takes a sequence of targets (m, 4, 4) and one joint vector ({chain.dof},), got targets of shape "
            f"{answers.status.shape} and joints of shape {here.shape}"
        )
    chosen = np.full((len(answers.q), chain.dof), np.nan)
    if not answers.valid.any():
        return chosen
    values = np.where(answers.valid[..., None], answers.q, 0.0)
    lowest, highest = _whole_turns(values, chain)
    none_inside = highest < lowest
    inside = np.asarray(answers.valid & ~none_inside.any(axis=-1))
    usable = np.where(inside.any(axis=-1, keepdims=True), inside, answers.valid)
    penalty = np.where(usable, 0.0, np.inf)
    lowest, highest = np.where(none_inside, -np.inf, lowest), np.where(none_inside, np.inf, highest)
    turning = periodic_joints(chain)
    lowest[..., ~turning], highest[..., ~turning] = 0.0, 0.0
    in_turns, weights = values / _TURN, np.ones(chain.dof)
    for i in np.flatnonzero(usable.any(axis=-1)):  # few operations, on (k, n): the choice depends on the one before
        wanted = here / _TURN - in_turns[i]
        turns = np.minimum(np.maximum(np.rint(wanted), lowest[i]), highest[i])
        apart = turns - wanted
        best = ((apart * apart) @ weights + penalty[i]).argmin()
        here = chosen[i] = values[i, best] + _TURN * turns[best]
    return _on_limits(chosen, chain)


def _whole_turns(q: FloatArray, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Least and greatest number of turns to add that keep each joint inside its limits; 0 for joints that slide."""
    lower, upper = chain.limits.T
    turning = periodic_joints(chain)
    with np.errstate(invalid="ignore"):
        lowest = np.where(turning, np.ceil((lower - _ROUNDING - q) / _TURN), 0.0)
        highest = np.where(turning, np.floor((upper + _ROUNDING - q) / _TURN), 0.0)
    return lowest, highest


def _on_limits(q: FloatArray, chain: Chain) -> FloatArray:
    """The same joint values, those that rounding has put beyond a limit on it."""
    inside = np.clip(q, *chain.limits.T)
    return np.asarray(np.where(np.abs(inside - q) <= _ROUNDING, inside, q))
