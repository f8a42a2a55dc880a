"""Jacobians, their rate and their derivative.

Linear part first in every one. The three kinds are named for what they give:

* geometric (``jacobian``): velocity of the tip *origin* and angular velocity, both in base axes;
* ``jacobian_space``: twist of the tip seen in the base frame (Modern Robotics, eq. 5.11);
* ``jacobian_body``: twist of the tip seen in the tip frame (Modern Robotics, eq. 5.18).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import as_joints, as_out
from pieper.spatial._checks import whole_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain


def jacobian(
    chain: Chain, q: ArrayLike, *, out: NDArray[np.float64] | None = None, threads: int = 1
) -> NDArray[np.float64]:
    """Geometric Jacobian: ``[v_tip; omega] = J(q) dq``, both in base axes.

    A revolute axis z through p contributes ``(z x (p_tip - p), z)``, a prismatic one ``(z, 0)``
    (Siciliano et al., Robotics, 2009, eq. 3.30).

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].
    out : (..., 6, n) float64 array, optional
        Where to write the result.
    threads : int
        Number of threads for large batches.

    Returns
    -------
    (..., 6, n) array
        Rows 0-2 [m/rad or -], rows 3-5 [- or 0].

    Raises
    ------
    ArrayError
        `q` or `out` has the wrong shape or type, or `q` is not finite.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("mh12", nominal=True).chain()
    >>> jacobian(arm, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])[:, 0].round(6) + 0.0
    array([0.   , 0.895, 0.   , 0.   , 0.   , 1.   ])
    """
    try:
        return chain.native.jacobian(q, out, threads)
    except TypeError:
        return chain.native.jacobian(*_converted(chain, q, out, threads))


def jacobian_space(
    chain: Chain, q: ArrayLike, *, out: NDArray[np.float64] | None = None, threads: int = 1
) -> NDArray[np.float64]:
    """Space Jacobian: columns are the screws carried along, ``Ad(exp([S_1] q_1) ... exp([S_i-1] q_i-1)) S_i``.

    Parameters and errors as for `jacobian`. Returns (..., 6, n), a twist in the base frame.
    """
    try:
        return chain.native.jacobian_space(q, out, threads)
    except TypeError:
        return chain.native.jacobian_space(*_converted(chain, q, out, threads))


def jacobian_body(
    chain: Chain, q: ArrayLike, *, out: NDArray[np.float64] | None = None, threads: int = 1
) -> NDArray[np.float64]:
    """Body Jacobian, ``Ad(T_base_tip^-1) jacobian_space``.

    Parameters and errors as for `jacobian`. Returns (..., 6, n), a twist in the tip frame.
    """
    try:
        return chain.native.jacobian_body(q, out, threads)
    except TypeError:
        return chain.native.jacobian_body(*_converted(chain, q, out, threads))


def _converted(
    chain: Chain, q: ArrayLike, out: NDArray[np.float64] | None, threads: int
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, int]:
    """The arguments as the kernels take them, or an error that says what is wrong with them."""
    values = as_joints(chain, q)
    return (
        values,
        None if out is None else as_out(out, (*values.shape[:-1], 6, chain.dof)),
        whole_number(threads, "threads"),
    )


def jacobian_rate(chain: Chain, q: ArrayLike, dq: ArrayLike) -> NDArray[np.float64]:
    """Time derivative of the geometric Jacobian, ``dJ/dt = sum_i dJ/dq_i dq_i``.

    Parameters
    ----------
    chain : Chain
    q, dq : (..., n) array_like
        Joint values [rad or m] and speeds [rad/s or m/s]; leading axes broadcast.

    Returns
    -------
    (..., 6, n) array

    Raises
    ------
    ArrayError
        Shapes that do not broadcast, or numbers that are not finite.
    """
    values, speeds = as_joints(chain, q), as_joints(chain, dq, name="dq")
    try:
        values, speeds = np.broadcast_arrays(values, speeds)
    except ValueError:
        raise ArrayError(f"q and dq must broadcast, got {values.shape} and {speeds.shape}") from None
    return chain.native.jacobian_rate(np.ascontiguousarray(values), np.ascontiguousarray(speeds))


def hessian(chain: Chain, q: ArrayLike) -> NDArray[np.float64]:
    """Derivative of the geometric Jacobian by each joint.

    With columns ``(v_j, w_j)``, ``dv_j/dq_i = w_a x v_b`` where a is the axis nearer to the base and b the other one, and
    ``dw_j/dq_i = w_i x w_j`` when i comes before j, else 0 (Haviland and Corke, IEEE RAM 2023, part 2, eqs. 12-18).

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].

    Returns
    -------
    (..., n, 6, n) array
        ``hessian[..., i, :, :]`` is ``dJ/dq_i``.
    """
    return chain.native.hessian(as_joints(chain, q))


def manipulability(chain: Chain, q: ArrayLike, *, threads: int = 1) -> NDArray[np.float64] | np.float64:
    """Yoshikawa's measure ``sqrt(det(J J^T))`` of the geometric Jacobian (IJRR 4(2), 1985, eq. 12).

    It is the product of the singular values, zero at a singularity; it mixes metres and radians, so compare it only
    along one arm. Chains of fewer than six joints use ``sqrt(det(J^T J))``.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].
    threads : int
        Number of threads for large batches.

    Returns
    -------
    (...) array, or a float for one configuration
    """
    return chain.native.manipulability(as_joints(chain, q), whole_number(threads, "threads"))[()]
