"""Cartesian paths: straight lines, arcs and splines of poses, joined and rounded, by their length.

A path is a curve of poses ``T_base_tcp(s)`` over its length s, which counts metres and radians together::

    ds^2 = |dp|^2 + (radius |dphi|)^2,

with dp the motion of the tip and dphi the angle it turns by. ``radius`` [m/rad] says how many metres one radian counts; a path that only
turns has a length too. Along a path the tip moves at unit speed in this measure, exactly on lines and arcs, to 1e-9 on splines and
roundings.

`line`, `arc_through`, `arc_about` and `spline` make paths, `join` puts them one behind another, with corners or with rounded ones. A
path says at which lengths an arm has to come to rest: `CartesianPath.corners`, where direction or curvature jump.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError, MotionError, unknown_name
from pieper.motion._path_pieces import (
    Arc,
    Measured,
    Part,
    Piece,
    Rounding,
    Spline,
    Straight,
    slope_at_end,
    slope_at_start,
    turn_between,
)
from pieper.spatial import rotation
from pieper.spatial._checks import FloatArray, poses, rotations, stack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

METRES_PER_RADIAN = 0.1
"""What a radian counts in the length of a path unless something else is said [m/rad]: about the size of a tool."""

SAME_POSITION, SAME_ROTATION = 1e-9, 1e-9
"""Poses no further apart than this [m, rad] are one pose."""

MOST_POSES = 1_000_000
"""More than these are not sampled from a path."""

_SMOOTH = (1e-6, 1e-3)
"""Jumps of direction [-] and of curvature [1/m] up to this, of what they are themselves where that is more, are rounding."""


@dataclass(frozen=True, eq=False)
class CartesianPath:
    """A curve of poses by its length. Made by `line`, `arc_through`, `arc_about`, `spline` and `join`.

    Attributes
    ----------
    pieces : tuple
        Smooth pieces, one behind the other.
    radius : float
        What a radian counts in the length [m/rad].
    """

    pieces: tuple[Piece, ...]
    radius: float = METRES_PER_RADIAN

    @property
    def length(self) -> float:
        """In metres, a radian counted as `radius` metres; 0 for a path that stays where it is."""
        return float(sum(piece.length for piece in self.pieces))

    @property
    def bounds(self) -> FloatArray:
        """(pieces + 1,) lengths at which the pieces begin and end [m]."""
        return np.concatenate([[0.0], np.cumsum([piece.length for piece in self.pieces])])

    @property
    def corners(self) -> FloatArray:
        """Lengths inside the path at which direction or curvature jump, (k,) [m]: a move with bounded jerk comes to rest there."""
        bounds, found = self.bounds, []
        for k in range(1, len(self.pieces)):
            ends = zip(_SMOOTH, slope_at_end(self.pieces[k - 1]), slope_at_start(self.pieces[k]), strict=True)
            if any(np.abs(a - b).max() > rounding * max(1.0, np.abs(a).max()) for rounding, a, b in ends):
                found.append(bounds[k])
        return np.array(found)

    def at(self, s: ArrayLike) -> FloatArray:
        """Poses at some lengths.

        Parameters
        ----------
        s : (...) array
            Lengths from 0 to `length` [m].

        Returns
        -------
        (..., 4, 4) array
            ``T_base_tcp`` [m, -].

        Raises
        ------
        ArrayError
            A length outside the path, or not finite.
        """
        given = stack(s, (), "s")
        total = self.length
        beyond = max(1e-9, 1e-12 * total)
        if ((given < -beyond) | (given > total + beyond)).any():
            worst = float(given.ravel()[int(np.argmax(np.abs(given - total / 2.0)))])
            raise ArrayError(f"s must be a length from 0 to {total:.9g} m along the path, got {worst:.9g}")
        bounds = self.bounds
        flat = np.clip(given.ravel(), 0.0, total)
        which = np.clip(np.searchsorted(bounds, flat, side="right") - 1, 0, len(self.pieces) - 1)
        T = np.empty((flat.size, 4, 4))
        for k in np.unique(which):
            piece, rows = self.pieces[k], which == k
            T[rows] = piece.poses(np.clip(flat[rows] - bounds[k], 0.0, piece.length))
        return T.reshape(*given.shape, 4, 4)

    def sample(self, *, count: int | None = None, step: float | None = None) -> tuple[FloatArray, FloatArray]:
        """Lengths and poses, evenly along the path, with every corner among them.

        Parameters
        ----------
        count : int, optional
            About how many poses, at least 2; corners are added to them.
        step : float, optional
            Or how far apart they are at most [m]. 2 mm when neither is given.

        Returns
        -------
        s, T_base_tcp : (m,) and (m, 4, 4) arrays
            One pose alone for a path of no length.

        Raises
        ------
        ArrayError
            Both, a count below 2, a step that is not above 0, or more poses than `MOST_POSES`.
        """
        if count is not None and step is not None:
            raise ArrayError("sample takes a count or a step, not both")
        whole: object = count
        if count is not None and (isinstance(whole, bool) or not isinstance(whole, (int, np.integer)) or count < 2):
            raise ArrayError(f"count must be a whole number of at least 2, got {count!r}")
        if step is not None and not (np.isfinite(step) and step > 0.0):
            raise ArrayError(f"step must be above 0 [m], got {step!r}")
        total = self.length
        if total == 0.0:
            return np.zeros(1), self.at(np.zeros(1))
        spacing = total / (count - 1) if count is not None else (0.002 if step is None else step)
        if total / spacing > MOST_POSES:
            raise ArrayError(
                f"a path of {total:.6g} m in steps of {spacing:.3g} m would be more than {MOST_POSES} poses; "
                f"take a step of {total / MOST_POSES:.2g} m or more"
            )
        edges = np.unique(np.concatenate([[0.0], self.corners, [total]]))
        parts = [np.zeros(1)]
        for low, high in itertools.pairwise(edges):
            parts.append(np.linspace(low, high, max(1, int(np.ceil((high - low) / spacing - 1e-9))) + 1)[1:])
        s = np.concatenate(parts)
        return s, self.at(s)

    @property
    def start(self) -> FloatArray:
        """(4, 4) first pose."""
        return self.at(0.0)

    @property
    def end(self) -> FloatArray:
        """(4, 4) last pose."""
        return self.at(self.length)

    def __repr__(self) -> str:
        return f"CartesianPath({len(self.pieces)} pieces, {self.length:.6g} m with {self.radius:g} m for a radian)"


# ---------------------------------------------------------------------------------------------------------------------
# lines and arcs


def line(T_start: ArrayLike, T_goal: ArrayLike, *, radius: float = METRES_PER_RADIAN) -> CartesianPath:
    """Straight from one pose to another, turning about one axis at an even rate (slerp).

    Parameters
    ----------
    T_start, T_goal : (4, 4) arrays
        ``T_base_tcp`` [m, -]. Twice the same pose makes a path of length 0.
    radius : float
        What a radian counts in the length [m/rad].

    Returns
    -------
    CartesianPath
        Poses by length along the path [m].

    Raises
    ------
    ArrayError
        No poses, or a radius that is not above 0.
    MotionError
        Orientations half a turn apart: two ways are equally short.

    Examples
    --------
    >>> path = line(np.eye(4), [[0, -1, 0, 0.3], [1, 0, 0, 0.0], [0, 0, 1, 0.4], [0, 0, 0, 1]])
    >>> round(path.length, 6)  # sqrt(0.5^2 + (0.1 pi / 2)^2)
    0.524094
    >>> path.at(path.length / 2)[:3, 3]
    array([0.15, 0.  , 0.2 ])
    """
    start, goal = _pose(T_start, "T_start"), _pose(T_goal, "T_goal")
    return CartesianPath((Straight.between(start, goal, _radius(radius), "T_start and T_goal"),), radius)


def arc_through(
    T_start: ArrayLike, p_via: ArrayLike, T_goal: ArrayLike, *, radius: float = METRES_PER_RADIAN
) -> CartesianPath:
    """The arc of a circle from one pose through a point to another pose, turning from one orientation to the other at an even rate.

    Parameters
    ----------
    T_start, T_goal : (4, 4) arrays
        ``T_base_tcp`` [m, -].
    p_via : (3,) array
        A point of the arc between them, in the base frame [m].
    radius : float
        What a radian counts in the length [m/rad]. Not that of the circle.

    Returns
    -------
    CartesianPath
        Poses by length along the path [m].

    Raises
    ------
    MotionError
        Three points on a line or two that are the same, which are on no circle; orientations half a turn apart.
    ArrayError
        No poses or no point, or a radius that is not above 0.

    Examples
    --------
    >>> T_goal = np.eye(4)
    >>> T_goal[:3, 3] = [0.4, 0.0, 0.0]
    >>> arc = arc_through(np.eye(4), [0.2, 0.2, 0.0], T_goal)
    >>> round(arc.length / (0.2 * np.pi), 12), arc.at(arc.length / 4)[:3, 3].round(4)
    (1.0, array([0.0586, 0.1414, 0.    ]))
    """
    start, goal = _pose(T_start, "T_start"), _pose(T_goal, "T_goal")
    via = stack(p_via, (3,), "p_via")
    if via.ndim != 1:
        raise ArrayError(f"p_via must have shape (3,), got {via.shape}")
    a, b = via - start[:3, 3], goal[:3, 3] - start[:3, 3]
    normal = np.cross(a, b)
    across = float(np.linalg.norm(normal))
    scale = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)))
    if across <= 1e-9 * scale * scale or scale == 0.0:
        raise MotionError(
            "an arc needs three different points that are not on one line; start, via and goal are at "
            f"{start[:3, 3].tolist()}, {via.tolist()} and {goal[:3, 3].tolist()}: use line, or arc_about for a full circle"
        )
    # the centre from the perpendicular bisectors: Weisstein, Circumcircle, MathWorld
    centre = start[:3, 3] + np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * across**2)
    axis = normal / across
    out = start[:3, 3] - centre
    side = np.cross(axis, out)
    angle = float(np.arctan2((goal[:3, 3] - centre) @ side, (goal[:3, 3] - centre) @ out)) % (2.0 * np.pi)
    turn = turn_between(start, goal, "T_start and T_goal")
    return CartesianPath((Arc(start, centre, axis, angle, turn, _radius(radius)),), radius)


def arc_about(
    T_start: ArrayLike,
    centre: ArrayLike,
    axis: ArrayLike,
    angle: float,
    *,
    orientation: Literal["carried", "fixed"] = "carried",
    radius: float = METRES_PER_RADIAN,
) -> CartesianPath:
    """An arc about an axis, more than a full turn allowed; a tip on the axis turns on the spot.

    Parameters
    ----------
    T_start : (4, 4) array
        ``T_base_tcp`` [m, -].
    centre : (3,) array
        A point of the axis, in the base frame [m].
    axis : (3,) array
        Direction of the axis, of any length but 0.
    angle : float
        How far, counter-clockwise about the axis [rad].
    orientation : {"carried", "fixed"}
        Whether the tip turns with the arc or keeps its orientation.
    radius : float
        What a radian counts in the length [m/rad].

    Returns
    -------
    CartesianPath
        Poses by length along the path [m].

    Raises
    ------
    ArrayError
        No pose, a centre or an axis of another shape, an axis of length 0, an angle or a radius that is none.
    UnknownNameError
        Another orientation than these two.

    Examples
    --------
    >>> circle = arc_about(np.eye(4), [0.0, 0.5, 0.0], [0, 0, 1], 2 * np.pi, orientation="fixed")
    >>> circle.at(circle.length / 2)[:3, 3].round(12) + 0.0
    array([0., 1., 0.])
    """
    start = _pose(T_start, "T_start")
    middle, direction = stack(centre, (3,), "centre"), stack(axis, (3,), "axis")
    if middle.ndim != 1 or direction.ndim != 1:
        raise ArrayError(f"centre and axis must have shape (3,), got {middle.shape} and {direction.shape}")
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise ArrayError("axis must not be zero: it gives the direction to turn about")
    turned = float(stack(angle, (), "angle"))
    if orientation not in ("carried", "fixed"):
        raise unknown_name("orientation", orientation, ("carried", "fixed"), "arc_about")
    unit = direction / size
    if turned < 0.0:
        unit, turned = -unit, -turned
    on_axis = middle + unit * float(unit @ (start[:3, 3] - middle))
    turn = unit * turned if orientation == "carried" else np.zeros(3)
    return CartesianPath((Arc(start, on_axis, unit, turned, turn, _radius(radius)),), radius)


def spline(Ts_base_tcp: ArrayLike, *, radius: float = METRES_PER_RADIAN) -> CartesianPath:
    """A smooth curve through poses: positions by a cubic spline, orientations by a rotation spline.

    Velocity and acceleration, linear and angular, are continuous. Its parameter at the poses grows by the distance between them in
    the measure of the length. Two poses make a line.

    Parameters
    ----------
    Ts_base_tcp : (m, 4, 4) array
        At least two poses, ``T_base_tcp`` [m, -].
    radius : float
        What a radian counts in the length [m/rad].

    Returns
    -------
    CartesianPath
        Poses by length along the path [m].

    Raises
    ------
    MotionError
        A pose that is the one before it again, or orientations half a turn apart; the message tells which.
    ArrayError
        No poses, fewer than two, or a radius that is not above 0.

    References
    ----------
    de Boor 1978, A Practical Guide to Splines, chapter 4 (natural ends). Park and Ravani 1997, Smooth invariant interpolation of
    rotations, ACM Transactions on Graphics 16(3), 277-295, as `scipy.spatial.transform.RotationSpline` computes it.
    """
    Ts = poses(Ts_base_tcp, "Ts_base_tcp")
    if Ts.ndim != 3 or len(Ts) < 2:
        raise ArrayError(f"Ts_base_tcp must have shape (m, 4, 4) with at least two poses, got {Ts.shape}")
    if len(Ts) == 2:
        return line(Ts[0], Ts[1], radius=radius)
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline

    _radius(radius)
    gaps = []
    for k in range(len(Ts) - 1):
        piece = Straight.between(Ts[k], Ts[k + 1], radius, f"poses {k} and {k + 1}")
        if np.linalg.norm(piece.step) <= SAME_POSITION and np.linalg.norm(piece.turn) <= SAME_ROTATION:
            raise MotionError(f"poses {k} and {k + 1} of the spline are the same; leave one of them out")
        gaps.append(piece.length)
    knots = np.concatenate([[0.0], np.cumsum(gaps)])
    curve = Spline(
        knots,
        CubicSpline(knots, Ts[:, :3, 3], bc_type="natural"),
        RotationSpline(knots, Rotation.from_matrix(Ts[:, :3, :3])),
    )
    return CartesianPath((Measured.of(curve, knots, radius),), radius)


# ---------------------------------------------------------------------------------------------------------------------
# one behind another


def join(paths: Sequence[CartesianPath], *, blend: float = 0.0) -> CartesianPath:
    """Paths one behind another, corners kept or rounded.

    A rounding begins and ends `blend` before and behind a corner, less where a piece is shorter than twice that. In it, the way up to the
    corner fades out while the way from it fades in: with ``S = 10 u^3 - 15 u^4 + 6 u^5`` over 0 <= u <= 1 they move at ``2 (1 - S)`` and
    ``2 S`` times `blend`, and add::

        p = p_1 + p_2 - p_corner,    R = R_1 R_corner^T R_2.

    So direction and curvature are continuous, and between two lines the tip stays in the triangle that they make.

    Parameters
    ----------
    paths : sequence of CartesianPath
        Each begins at the pose where the one before it ends, to 1e-9 m and rad. One of no length is left out.
    blend : float
        Length that a rounding takes of each side [m]; 0 keeps corners, at which a move comes to rest.

    Returns
    -------
    CartesianPath
        Poses by length along the path [m].

    Raises
    ------
    ArrayError
        No paths, different measures of a radian, or a blend below 0.
    MotionError
        A path that does not begin where the one before it ends.
    """
    given = tuple(paths)
    if not given:
        raise ArrayError("join needs at least one path, got none")
    if not (np.isfinite(blend) and blend >= 0.0):
        raise ArrayError(f"blend must be 0 or more [m], got {blend!r}")
    radius = given[0].radius
    for k, (one, other) in enumerate(itertools.pairwise(given)):
        if other.radius != radius:
            raise ArrayError(
                f"paths must count radians alike; path 0 has {radius:g} m/rad, path {k + 1} {other.radius:g}"
            )
        metres = float(np.linalg.norm(one.end[:3, 3] - other.start[:3, 3]))
        radians = float(rotation.distance(one.end[:3, :3], other.start[:3, :3]))
        if metres > SAME_POSITION or radians > 1e-7:
            raise MotionError(
                f"path {k + 1} must begin where path {k} ends; they are {metres:.3g} m and {radians:.3g} rad apart"
            )
    pieces = [piece for path in given for piece in path.pieces if piece.length > 0.0]
    if not pieces:
        return given[0]
    joined = CartesianPath(tuple(pieces), radius)
    return joined if blend == 0.0 else CartesianPath(_rounded(joined, blend), radius)


def _rounded(path: CartesianPath, blend: float) -> tuple[Piece, ...]:
    pieces, bounds, corners = path.pieces, path.bounds, path.corners
    sharp = [bool(np.isclose(bounds[k + 1], corners, rtol=0.0, atol=1e-12).any()) for k in range(len(pieces) - 1)]
    reach = [
        min(blend, 0.5 * pieces[k].length, 0.5 * pieces[k + 1].length) if sharp[k] else 0.0
        for k in range(len(pieces) - 1)
    ]
    made: list[Piece] = []
    for k, piece in enumerate(pieces):
        low = reach[k - 1] if k else 0.0
        high = piece.length - (reach[k] if k < len(reach) else 0.0)
        if high - low > 1e-9:
            made.append(piece if low == 0.0 and high == piece.length else Part(piece, low, high - low))
        if k < len(reach) and reach[k] > 0.0:
            made.append(Measured.of(Rounding(piece, pieces[k + 1], reach[k]), np.array([0.0, 1.0]), path.radius))
    return tuple(made)


def _radius(radius: float) -> float:
    if not (np.isfinite(radius) and radius > 0.0):
        raise ArrayError(f"radius must be above 0 [m/rad], got {radius!r}")
    return radius


def _pose(T: ArrayLike, name: str) -> FloatArray:
    pose = poses(T, name)
    if pose.ndim != 2:
        raise ArrayError(f"{name} must be one pose (4, 4), got {pose.shape}")
    rotations(pose[:3, :3], name)
    return pose
