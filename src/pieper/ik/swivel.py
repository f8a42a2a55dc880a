"""The swivel angle of an arm with a spherical shoulder and a spherical wrist: where its elbow is on its circle.

Axes 1, 2 and 3 meet in the shoulder S, axes 5, 6 and 7 in the wrist W, and the elbow E is the point of axis 4 nearest to the
shoulder. The tip holds W, so E keeps its distances from S and W and goes round the line SW. With the unit vector
``e_SW`` along that line, the angle psi of E about it is counted from a reference direction ``e_x`` across it::

    E = C + r (cos(psi) e_x + sin(psi) e_SW x e_x),        C the point of the line SW nearest to E, r the distance of E from it.

Two references are known. The *conventional* one is the part of a fixed direction ``e_r`` across the line,
``e_x ~ (e_SW x e_r) x e_SW``: it is lost wherever the wrist is on the line through the shoulder along ``e_r``, in front or behind. The
*stereographic* one::

    e_x ~ ((e_SW - e_t) x e_r) x e_SW,        e_r across e_t,

is lost on a half line only, where ``e_SW = e_t``. By default ``e_t`` points from the shoulder down axis 1, into the pedestal.

References
----------
Elias, Wen, Redundancy parameterization and inverse kinematics of 7-DOF revolute manipulators, Mechanism and Machine Theory
204 (2024), arXiv:2307.13122: sections 3.1 (conventional), 3.3 (stereographic), and the solution for the kuka-like arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.family import LEVELS, size_of
from pieper.kinematics.fk import fk
from pieper.kinematics.joints import as_joints
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

Kind = Literal["stereographic", "conventional"]

_CLEARLY_APART = (
    0.02  # [rad] neighbouring axes of a shoulder or a wrist at a smaller angle cannot turn to all directions
)
_ON_THE_LINE = 1e-9  # of the size of the arm: an elbow as near to the line SW has no direction from it


@dataclass(frozen=True, eq=False)
class Swivel:
    """Shoulder, elbow and wrist of an arm, and what its swivel angle is counted from. Made by `find_swivel`.

    Attributes
    ----------
    chain : Chain
    shoulder, elbow, wrist : (3,) arrays
        S, E and W at the home pose, in the base frame [m].
    kind : str
        ``"stereographic"`` or ``"conventional"``.
    e_t, e_r : (3,) arrays
        Unit vectors in the base frame: the direction of the wrist from the shoulder where the stereographic reference is
        lost, and the reference direction.
    """

    chain: Chain
    shoulder: FloatArray
    elbow: FloatArray
    wrist: FloatArray
    kind: Kind
    e_t: FloatArray
    e_r: FloatArray

    def reference(self, e_SW: FloatArray) -> FloatArray:
        """Directions (..., 3) that the angle is counted from, for unit vectors from shoulder to wrist; NaN where it is lost."""
        k = np.cross(e_SW, self.e_r) if self.kind == "conventional" else np.cross(e_SW - self.e_t, self.e_r)
        return _units(np.cross(k, e_SW))


def find_swivel(
    chain: Chain, *, kind: Kind = "stereographic", e_t: ArrayLike | None = None, e_r: ArrayLike | None = None
) -> Swivel:
    """Shoulder, elbow and wrist of an arm with seven joints.

    Parameters
    ----------
    chain : Chain
    kind : str
        ``"stereographic"`` or ``"conventional"``.
    e_t : (3,) array_like, optional
        Direction from the shoulder, in the base frame, where the stereographic reference is lost. Default: along axis 1, away
        from the wrist at the home pose.
    e_r : (3,) array_like, optional
        Reference direction in the base frame; of the stereographic one the part across `e_t` counts. Default: for the conventional
        reference the direction of `e_t` turned round (up, for an arm that stands), for the stereographic one the base axis that is farthest from `e_t`.

    Returns
    -------
    Swivel

    Raises
    ------
    ArrayError
        The arm has no swivel angle; the message says why.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> find_swivel(catalog.describe("kuka_iiwa14").chain()).shoulder.round(6) + 0.0
    array([0.  , 0.  , 0.36])
    """
    why = "a swivel angle needs seven revolute joints, of which the first three meet in a point and the last three meet in one"
    if chain.is_coupled or len(chain.screws) != 7 or not chain.is_revolute.all():
        raise ArrayError(
            f"{why}; {chain.name!r} has {int(chain.is_revolute.sum())} axes that turn, of {len(chain.screws)}"
        )
    if kind not in ("stereographic", "conventional"):
        raise ArrayError(f"kind must be 'stereographic' or 'conventional', got {kind!r}")
    scale = size_of(chain)
    w = chain.screws[:, 3:]
    points = np.cross(w, chain.screws[:, :3])
    ends = []
    for words, axes in (("first", (0, 1, 2)), ("last", (4, 5, 6))):
        centre = _meeting_point(w[list(axes)], points[list(axes)])
        off = max(float(np.linalg.norm(np.cross(centre - points[i], w[i]))) for i in axes)
        if off > LEVELS["exact"] * scale:
            raise ArrayError(f"{why}; the {words} three axes of {chain.name!r} miss each other by {off:.3g} m")
        if min(np.linalg.norm(np.cross(w[i], w[i + 1])) for i in axes[:2]) < _CLEARLY_APART:
            raise ArrayError(f"{why}; two of the {words} three axes of {chain.name!r} are parallel")
        ends.append(centre)
    shoulder, wrist = ends
    elbow = points[3] + w[3] * float(w[3] @ (shoulder - points[3]))
    if min(np.linalg.norm(elbow - shoulder), np.linalg.norm(np.cross(wrist - elbow, w[3]))) < 1e-3 * scale:
        raise ArrayError(f"axis 4 of {chain.name!r} runs through its shoulder or its wrist, so that it has no elbow")
    if e_t is None:
        lost = -w[0] if float(w[0] @ (wrist - shoulder)) >= 0.0 else w[0].copy()
    else:
        lost = _direction(e_t, "e_t")
    if e_r is None:
        reference = -lost if kind == "conventional" else np.eye(3)[int(np.argmin(np.abs(lost)))]
    else:
        reference = _direction(e_r, "e_r")
    if kind == "stereographic":
        across = reference - lost * float(lost @ reference)
        if np.linalg.norm(across) < 1e-6:
            raise ArrayError("e_r must not be parallel to e_t, where the stereographic reference is lost")
        reference = across / np.linalg.norm(across)
    return Swivel(chain, shoulder, elbow, wrist, kind, lost, reference)


def swivel_of(chain: Chain, q: ArrayLike, *, swivel: Swivel | None = None) -> FloatArray:
    """The swivel angle that an arm has at some joint values.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad].
    swivel : Swivel, optional
        What to count from; `find_swivel` with its defaults when not given.

    Returns
    -------
    (...) array
        Angles in (-pi, pi] [rad]; NaN where the elbow is on the line from shoulder to wrist (a straight arm), or the reference is lost.

    Raises
    ------
    ArrayError
        The arm has no swivel angle, or `q` is malformed.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_iiwa14").chain()
    >>> float(swivel_of(arm, [0.3, 0.5, 0.0, 1.0, 0.2, -0.4, 0.1]).round(6) + 0.0)
    0.3
    """
    points = find_swivel(chain) if swivel is None else swivel
    values = as_joints(chain, q)
    T_inverse = np.linalg.inv(chain.home)
    to_wrist = T_inverse[:3, :3] @ points.wrist + T_inverse[:3, 3]
    T = fk(chain, values)
    to_W = T[..., :3, :3] @ to_wrist + T[..., :3, 3] - points.shoulder
    turned = _exponential(chain.screws[0, 3:], values[..., 0]) @ _exponential(chain.screws[1, 3:], values[..., 1])
    turned = turned @ _exponential(chain.screws[2, 3:], values[..., 2])
    to_E = turned @ (points.elbow - points.shoulder)
    e_SW = _units(to_W)
    x = points.reference(e_SW)
    off = to_E - e_SW * (to_E * e_SW).sum(axis=-1, keepdims=True)
    angle = np.arctan2((np.cross(e_SW, x) * off).sum(axis=-1), (x * off).sum(axis=-1))
    lost = np.linalg.norm(off, axis=-1) <= _ON_THE_LINE * size_of(chain)
    return np.asarray(np.where(lost, np.nan, angle))


def solve_swivel(swivel: Swivel, T_base_tip: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Joint values of every branch with the tip at a pose and the elbow at a swivel angle, in closed form.

    The law of cosines gives joint 4, the triangle SEW the turn of the upper arm, which joints 1, 2 and 3 make in two ways, and
    what is left of the rotation joints 5, 6 and 7, in two ways again.

    Parameters
    ----------
    swivel : Swivel
    T_base_tip : (..., 4, 4) array
        Poses [m, -].
    angles : (...) array
        Swivel angles [rad], of the same leading axes.

    Returns
    -------
    q : (..., 8, 7) array
        Joint values in (-pi, pi] [rad]; NaN where there are none. The place is ``4 elbow + 2 shoulder + wrist``.
    angles : (..., 8) array
        The swivel angles repeated.

    Notes
    -----
    With a straight arm all swivel angles are the same place of the elbow; the two elbow branches are then those that the arm would
    bend to on either side.
    """
    chain = swivel.chain
    w = chain.screws[:, 3:]
    S, E = swivel.shoulder, swivel.elbow
    home = np.linalg.inv(chain.home)
    R, p = T_base_tip[..., :3, :3], T_base_tip[..., :3, 3]
    to_W = R @ (home[:3, :3] @ swivel.wrist + home[:3, 3]) + p - S
    distance = np.linalg.norm(to_W, axis=-1)
    e_SW = _units(to_W)
    # joint 4: |S W|^2 = |S E|^2 + |E W|^2 + 2 SE . R4 EW
    SE, EW = E - S, swivel.wrist - E
    along = float(SE @ w[3]) * float(EW @ w[3])
    a, b = float(SE @ EW) - along, float(SE @ np.cross(w[3], EW))
    wanted = 0.5 * (distance**2 - float(SE @ SE) - float(EW @ EW)) - along
    q4 = _two_angles(a, b, wanted)  # (..., 2)
    R4 = _exponential(w[3], q4)
    # the upper arm: both triangles as frames
    W0 = SE + R4 @ EW
    e0 = _units(W0)
    off0 = SE - e0 * (e0 @ SE)[..., None]
    far = np.linalg.norm(off0, axis=-1, keepdims=True)
    bends = np.cross(e0, w[3]) * np.array([1.0, -1.0])[:, None] * np.sign(e0 @ EW)[..., None]
    off0 = _units(np.where(far > _ON_THE_LINE * size_of(chain), off0, bends))
    off0 = _units(
        off0 - e0 * (off0 * e0).sum(axis=-1, keepdims=True)
    )  # once more: a short one is not across to the last digit
    frame0 = np.stack([e0, off0, np.cross(e0, off0)], axis=-1)
    x = swivel.reference(e_SW)
    y = np.cross(e_SW, x)
    off = np.cos(angles)[..., None] * x + np.sin(angles)[..., None] * y
    frame = np.stack([e_SW, off, np.cross(e_SW, off)], axis=-1)
    R03 = frame[..., None, :, :] @ np.swapaxes(frame0, -1, -2)
    shoulder = _three_turns(w[:3], R03)  # (..., 2, 2, 3)
    left = np.swapaxes(R03 @ R4, -1, -2) @ R[..., None, :, :] @ chain.home[:3, :3].T
    wrist = _three_turns(w[4:], left)
    q = np.empty((*angles.shape, 2, 2, 2, 7))
    q[..., :3] = shoulder[..., :, None, :]
    q[..., 3] = q4[..., None, None]
    q[..., 4:] = wrist[..., None, :, :]
    q = q.reshape(*angles.shape, 8, 7)
    q[np.isnan(q).any(axis=-1)] = np.nan
    return q, np.repeat(angles[..., None], 8, axis=-1)


def _meeting_point(directions: FloatArray, points: FloatArray) -> FloatArray:
    """The point with the least sum of squared distances from lines."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    right = (across @ points[..., None])[..., 0].sum(axis=0)
    return np.asarray(np.linalg.lstsq(across.sum(axis=0), right, rcond=1e-12)[0])


def _direction(value: ArrayLike, name: str) -> FloatArray:
    v = stack(value, (3,), name)
    if v.shape != (3,) or not np.linalg.norm(v) > 0.0:
        raise ArrayError(f"{name} must be a direction of shape (3,), got {v.tolist()}")
    return np.asarray(v / np.linalg.norm(v))


def _units(v: FloatArray) -> FloatArray:
    """Unit vectors (..., 3); NaN for vectors of no length."""
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(size > 1e-12, size, np.nan))


def _exponential(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) about a unit vector (Rodrigues)."""
    x, y, z = axis
    A = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[..., None, None], 2.0 * np.sin(0.5 * angle)[..., None, None] ** 2
    return np.asarray(np.eye(3) + sine * A + versine * (A @ A))


def _two_angles(a: float, b: float, wanted: FloatArray) -> FloatArray:
    """Both angles (..., 2) with ``a cos + b sin = wanted``; NaN where there are none but for rounding."""
    size = float(np.hypot(a, b))
    cosine = wanted / size
    reached = np.abs(cosine) <= 1.0 + 1e-12
    half = np.where(reached, np.arccos(np.clip(cosine, -1.0, 1.0)), np.nan)
    return _wrapped(np.arctan2(b, a) + np.stack([half, -half], axis=-1))


def _three_turns(axes: FloatArray, R: FloatArray) -> FloatArray:
    """Angles (..., 2, 3) with ``R = exp(w1 a) exp(w2 b) exp(w3 c)``, two ways; NaN where there are none."""
    w1, w2, w3 = axes
    v = R @ w3
    A = float(w1 @ w2) * float(w2 @ w3)
    B, C = float(w1 @ w3) - A, float(w1 @ np.cross(w2, w3))
    b = _two_angles(B, C, v @ w1 - A)
    if (
        abs(float(np.hypot(B, C)) - 1.0) < 1e-9
    ):  # right angles: the sine is known too, and small angles keep their digits
        half = np.arctan2(np.linalg.norm(np.cross(w1, v), axis=-1), v @ w1)
        b = _wrapped(np.arctan2(C, B) + np.stack([half, -half], axis=-1))
    at = _exponential(w2, b) @ w3
    v = v[..., None, :]
    before, after = np.cross(w1, at), np.cross(w1, v)  # both across w1, and with all their digits where they are short
    a = np.arctan2(np.cross(before, after) @ w1, (before * after).sum(axis=-1))
    rest = np.swapaxes(_exponential(w1, a) @ _exponential(w2, b), -1, -2) @ R[..., None, :, :]
    u = np.cross(w3, np.eye(3)[int(np.argmin(np.abs(w3)))])
    u = u / np.linalg.norm(u)
    turned = rest @ u
    c = np.arctan2(turned @ np.cross(w3, u), turned @ u)
    return np.stack([a, b, c], axis=-1)


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray(angle - 2.0 * np.pi * np.ceil(angle / (2.0 * np.pi) - 0.5))
