"""Screws and home pose, in and out: the product of exponentials.

    T_base_tip(q) = exp([S_1] q_1) ... exp([S_n] q_n) M           space screws, in the base frame
                  = M exp([B_1] q_1) ... exp([B_n] q_n)           body screws, in the tip frame, B_i = Ad(M^-1) S_i

This is the form that a `Chain` keeps, with screws written linear part first. Sources that write the angular part first, as
Modern Robotics does, are read with ``angular_first=True``.

References
----------
Brockett, Robotic manipulators and the product of exponentials formula (1984).
Lynch, Park, Modern Robotics (2017), eq. 4.14 (space form), eq. 4.16 (body form), section 3.3.2.2 (screws of axes).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError
from pieper.model._chain_check import check_chain
from pieper.model.chain import Chain, default_joint_names
from pieper.spatial.twist import adjoint

if TYPE_CHECKING:
    from collections.abc import Sequence

FloatArray = NDArray[np.float64]
ScrewFrame: TypeAlias = Literal["space", "body"]


def revolute(axis: ArrayLike, point: ArrayLike) -> FloatArray:
    """Unit screw of a joint that turns about an axis through a point, ``(point x w, w)`` with ``w = axis / |axis|``.

    Parameters
    ----------
    axis : (..., 3) array
        Direction of the axis; need not be a unit vector [-].
    point : (..., 3) array
        Any point on the axis [m].

    Returns
    -------
    (..., 6) array
        Linear part first [m, -].

    Raises
    ------
    ArrayError
        An array has the wrong shape or is not finite, or an axis is zero.

    References
    ----------
    Modern Robotics, eq. 3.75, with zero pitch; ``-w x point`` there.

    Examples
    --------
    >>> revolute([0.0, 0.0, 2.0], [0.5, 0.0, 0.0]).tolist()
    [0.0, -0.5, 0.0, 0.0, 0.0, 1.0]
    """
    w = _direction(axis)
    p = _vectors(point, "point")
    v = np.cross(p, w)
    return np.concatenate([v, np.broadcast_to(w, v.shape)], axis=-1)


def prismatic(axis: ArrayLike) -> FloatArray:
    """Unit screw of a joint that slides along an axis, ``(axis / |axis|, 0)``.

    Parameters
    ----------
    axis : (..., 3) array
        Direction; need not be a unit vector [-].

    Returns
    -------
    (..., 6) array
        Linear part first [-].

    Raises
    ------
    ArrayError
        The array has the wrong shape or is not finite, or an axis is zero.

    Examples
    --------
    >>> prismatic([0.0, 3.0, 4.0]).tolist()
    [0.0, 0.6, 0.8, 0.0, 0.0, 0.0]
    """
    v = _direction(axis)
    return np.concatenate([v, np.zeros_like(v)], axis=-1)


def swap_order(screws: ArrayLike) -> FloatArray:
    """Screws or twists with the angular part first from ones with the linear part first, and back.

    Parameters
    ----------
    screws : (..., 6) array

    Returns
    -------
    (..., 6) array

    Raises
    ------
    ArrayError
        The last axis is not of length 6.

    Examples
    --------
    >>> swap_order([0.0, 0.0, 1.0, 0.0, -0.5, 0.0]).tolist()
    [0.0, -0.5, 0.0, 0.0, 0.0, 1.0]
    """
    array = _numbers(screws, "screws")
    if array.ndim == 0 or array.shape[-1] != 6:
        raise ArrayError(f"screws must have shape (..., 6), got {array.shape}")
    return np.concatenate([array[..., 3:], array[..., :3]], axis=-1)


def from_screws(
    screws: ArrayLike,
    home: ArrayLike,
    *,
    frame: ScrewFrame = "space",
    angular_first: bool = False,
    name: str = "arm",
    joint_names: Sequence[str] | None = None,
    limits: ArrayLike | None = None,
    base: str = "base",
    tip: str = "tip",
) -> Chain:
    """The chain with these screws and this home pose.

    Parameters
    ----------
    screws : (n, 6) array
        Unit screws at the home pose: ``|w| = 1`` for turning joints, ``w = 0`` and ``|v| = 1`` for sliding ones [m, -].
        `revolute` and `prismatic` make them.
    home : (4, 4) array
        Pose of the tip in the base frame at ``q = 0`` [m, -].
    frame : str
        ``"space"``: screws in the base frame. ``"body"``: screws in the tip frame.
    angular_first : bool
        True when the screws are written ``(w, v)``, as in Modern Robotics.
    name : str
    joint_names : sequence of n str, optional
        ``joint_1`` ... unless given.
    limits : (n, 2) array, optional
        [rad or m]; without limits unless given.
    base, tip : str
        Frame names.

    Returns
    -------
    Chain

    Raises
    ------
    ArrayError
        A wrong shape, a screw that is not a unit screw or has pitch, a home pose that is none, an unknown ``frame``.

    Examples
    --------
    The arm of two links of 1 m, from Modern Robotics' own order:

    >>> import numpy as np
    >>> home = np.eye(4)
    >>> home[0, 3] = 2.0
    >>> chain = from_screws([[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, -1, 0]], home, angular_first=True)
    >>> chain.screws.tolist()
    [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 0.0, 0.0, 1.0]]
    """
    if frame not in ("space", "body"):
        raise ArrayError(f"frame must be 'space' or 'body', got {frame!r}")
    rows = _numbers(screws, "screws")
    if rows.size == 0:
        rows = rows.reshape(0, 6)
    if rows.ndim != 2 or rows.shape[1] != 6:
        raise ArrayError(f"screws must have shape (n, 6), got {rows.shape}")
    if angular_first:
        rows = swap_order(rows)
    M = _numbers(home, "home")
    if frame == "body" and len(rows):
        if M.shape != (4, 4):
            raise ArrayError(f"home must have shape (4, 4), got {M.shape}")
        rows = _clean(rows @ adjoint(M).T, turning=np.any(rows[:, 3:] != 0.0, axis=1))
    n = len(rows)
    return Chain(
        name=name,
        screws=rows,
        home=M,
        limits=np.tile([-np.inf, np.inf], (n, 1)) if limits is None else np.asarray(limits),
        joint_names=tuple(default_joint_names(n) if joint_names is None else joint_names),
        base=base,
        tip=tip,
    )


def as_screws(
    chain: Chain, *, frame: ScrewFrame = "space", angular_first: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Screws and home pose of a chain.

    Parameters
    ----------
    chain : Chain
    frame : str
        ``"space"``: in the base frame. ``"body"``: in the tip frame.
    angular_first : bool
        True to write them ``(w, v)``, as in Modern Robotics.

    Returns
    -------
    screws : (m, 6) array
        One per axis [m, -].
    home : (4, 4) array

    Raises
    ------
    ArrayError
        Unknown ``frame``, or no chain.

    Examples
    --------
    >>> from pieper.model.catalog import describe
    >>> screws, home = as_screws(describe("mh12", nominal=True).chain())
    >>> screws[1].tolist()  # joint_2_l turns about y, through (0.155, 0, 0.45)
    [-0.45, 0.0, 0.155, 0.0, 1.0, 0.0]
    """
    check_chain(chain)
    if frame not in ("space", "body"):
        raise ArrayError(f"frame must be 'space' or 'body', got {frame!r}")
    screws = chain.screws.copy()
    if frame == "body" and len(screws):
        R, p = chain.home[:3, :3], chain.home[:3, 3]
        T_tip_base = np.eye(4)
        T_tip_base[:3, :3], T_tip_base[:3, 3] = R.T, -R.T @ p
        screws = _clean(screws @ adjoint(T_tip_base).T, turning=chain.is_revolute)
    return (swap_order(screws) if angular_first else screws), chain.home.copy()


def _clean(screws: FloatArray, *, turning: NDArray[np.bool_]) -> FloatArray:
    """Screws after a change of frame; a sliding joint keeps an angular part of exactly zero."""
    screws[~turning, 3:] = 0.0
    return screws


def _numbers(value: ArrayLike, name: str) -> FloatArray:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise ArrayError(f"{name} must be numbers, got {value!r}") from cause
    if not np.isfinite(array).all():
        raise ArrayError(f"{name} must be finite, got {array.tolist()}")
    return array


def _vectors(value: ArrayLike, name: str) -> FloatArray:
    array = _numbers(value, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ArrayError(f"{name} must have shape (..., 3), got {array.shape}")
    return array


def _direction(axis: ArrayLike) -> FloatArray:
    w = _vectors(axis, "axis")
    length = np.linalg.norm(w, axis=-1, keepdims=True)
    if not length.all():
        raise ArrayError("axis must not be zero; give it a direction, for example [0, 0, 1]")
    unit: FloatArray = w / length
    return unit
