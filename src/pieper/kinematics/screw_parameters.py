"""What can be wrong with the screws of an arm, as a list of small numbers: the parameters of a kinematic calibration.

An arm that was built is not the arm on paper: its axes stand a little aside and a little askew, its joints read zero elsewhere, and its
tip sits elsewhere on its last link. With ``T(q) = exp([S_1] q_1) ... exp([S_m] q_m) M`` each axis is moved as a whole by a small twist,
``S_i <- Ad(exp([x_i])) S_i``, which leaves it a unit screw without pitch however large the twist is. Of the six directions of ``x_i``
those along and about a turning axis change nothing, and those that shift a sliding one change nothing either: four and two are left, and
six for the tip, ``M <- M exp([x])``. That is ``4 r + 2 p + 6`` numbers, as many as any complete model of the geometry has.

The tip then moves by the space twist::

    (Ad(P_{i-1}) - Ad(P_i)) x_i,     P_i = exp([S_1] q_1) ... exp([S_i] q_i),

since ``exp([Ad(E) S] q) = E exp([S] q) E^-1``.

References
----------
Okamura, Park, Kinematic calibration using the product of exponentials formula, Robotica 14 (1996).
Chen, Yang, Tan, Yeo, Local POE model for robot kinematic calibration, Mechanism and Machine Theory 36 (2001).
He, Zhao, Yang, Yang, Kinematic-parameter identification for serial-robot calibration based on POE formula, IEEE T-RO 26 (2010).
Everett, Hsu, The theory of kinematic parameter identification for industrial robots, ASME J. Dyn. Sys. Meas. Control 110 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pieper.model.chain import Chain, Frame, free_name
from pieper.spatial import pose, rotation
from pieper.spatial.twist import adjoint, exp

if TYPE_CHECKING:
    from collections.abc import Collection

FloatArray = NDArray[np.float64]

FreeSet: TypeAlias = Literal["screws", "home", "offsets", "base"]

SETS: tuple[FreeSet, ...] = ("screws", "home", "offsets", "base")
"""What can be set free: the axes, the tip on its link, the readings of the joints, and where the base stands."""

_ALIGNED = 0.9995  # cosine above which a direction is called by the name of a base axis


class Parameter(NamedTuple):
    """One number of a calibration.

    Attributes
    ----------
    kind : str
        One of `SETS`.
    of : str
        The joint, or the frame.
    motion : str
        ``"moved along x"``, ``"turned about y"``, ``"reads zero elsewhere"``.
    unit : str
        ``"m"`` or ``"rad"``.
    """

    kind: str
    of: str
    motion: str
    unit: str

    @property
    def name(self) -> str:
        """In words."""
        thing = {"screws": f"axis of {self.of}", "offsets": self.of}.get(self.kind, f"frame {self.of}")
        return f"{thing} {self.motion}"


@dataclass(frozen=True, eq=False)
class ScrewParameters:
    """An arm, and the directions in which it may be changed.

    Attributes
    ----------
    nominal : Chain
        The arm that was started from.
    free : tuple of str
        Of `SETS`.
    screws, home : (m, 6) and (4, 4) arrays
        As they are now.
    offsets : (n,) array
        Added to the joint values that are read [rad or m].
    T_frame_base : (4, 4) array
        Where the base stands now in the frame of the measurements.
    anchors : (m, 3) array
        The point on each axis about which it is turned [m].
    across : (m, 2, 3) array
        The two directions across each axis.
    """

    nominal: Chain
    free: tuple[str, ...]
    screws: FloatArray
    home: FloatArray
    offsets: FloatArray
    T_frame_base: FloatArray
    anchors: FloatArray
    across: FloatArray

    @classmethod
    def of(cls, chain: Chain, free: Collection[str], T_frame_base: FloatArray | None = None) -> ScrewParameters:
        """The parameters of an arm as it is on paper, its base standing at `T_frame_base`, (4, 4)."""
        T = np.eye(4) if T_frame_base is None else T_frame_base
        screws = chain.screws @ adjoint(T).T if len(chain.screws) else chain.screws.copy()
        screws[~chain.is_revolute, 3:] = 0.0
        points = _anchors(chain)
        across = np.array([_across(axis) for axis in _directions(screws)]).reshape(-1, 2, 3)
        anchors = points @ T[:3, :3].T + T[:3, 3]
        chosen = tuple(name for name in SETS if name in free)
        return cls(chain, chosen, screws, T @ chain.home, np.zeros(chain.dof), T, anchors, across)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the numbers mean, in the order of the columns of `jacobian`."""
        chain = self.nominal
        listed: list[Parameter] = []
        if "screws" in self.free:
            for axis, turns in enumerate(chain.is_revolute):
                words = [_word(direction) for direction in self.across[axis]]
                if turns:
                    listed += [
                        Parameter("screws", _joint_of(chain, axis), f"moved along {word}", "m") for word in words
                    ]
                listed += [Parameter("screws", _joint_of(chain, axis), f"turned about {word}", "rad") for word in words]
        if "home" in self.free:
            listed += _frame_parameters("home", chain.tip)
        if "offsets" in self.free:
            units = ["rad" if self._turns(joint) else "m" for joint in range(chain.dof)]
            motion = "reads zero elsewhere"
            listed += [Parameter("offsets", n, motion, u) for n, u in zip(chain.joint_names, units, strict=True)]
        if "base" in self.free:
            listed += _frame_parameters("base", chain.base)
        return tuple(listed)

    def _turns(self, joint: int) -> bool:
        moves = self.nominal.coupling[:, joint] != 0.0
        return bool(self.nominal.is_revolute[moves].all())

    def _angles(self, q: FloatArray) -> FloatArray:
        return (q + self.offsets) @ self.nominal.coupling.T

    def partial_products(self, q: FloatArray) -> FloatArray:
        """``P_0 ... P_m``, (k, m + 1, 4, 4), of joint values (k, n)."""
        steps = exp(self._angles(q)[:, :, None] * self.screws)
        products = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for axis in range(len(self.screws)):
            products.append(products[-1] @ steps[:, axis])
        return np.stack(products, axis=1)

    def poses(self, q: FloatArray) -> FloatArray:
        """``T_frame_tip`` of joint values (k, n), (k, 4, 4)."""
        return np.asarray(self.partial_products(q)[:, -1] @ self.home)

    def jacobian(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Poses (k, 4, 4), and how the tip moves by each parameter: space twists (k, 6, parameters)."""
        products = self.partial_products(q)
        T = products[:, -1] @ self.home
        carried = adjoint(products)  # (k, m + 1, 6, 6)
        columns = [np.empty((len(q), 6, 0))]
        if "screws" in self.free:
            for axis, directions in enumerate(self._directions_of_axes()):
                columns.append((carried[:, axis] - carried[:, axis + 1]) @ directions)
        if "home" in self.free:
            columns.append(adjoint(T))
        if "offsets" in self.free and len(self.screws):
            moving = np.stack([carried[:, i] @ screw for i, screw in enumerate(self.screws)], axis=-1)
            columns.append(moving @ self.nominal.coupling)
        if "base" in self.free:
            columns.append(np.broadcast_to(adjoint(self._base_point()), (len(q), 6, 6)))
        return T, np.concatenate(columns, axis=-1)

    def _base_point(self) -> FloatArray:
        """The base is turned about its own origin, along the axes of the measurements."""
        T = np.eye(4)
        T[:3, 3] = self.T_frame_base[:3, 3]
        return T

    def _directions_of_axes(self) -> list[FloatArray]:
        """Of each axis the twists that change it: (6, 4), or (6, 2) where it slides."""
        found = []
        for point, across, turns in zip(self.anchors, self.across, self.nominal.is_revolute, strict=True):
            turn = np.hstack([np.cross(point, across), across])
            shift = np.hstack([across, np.zeros((2, 3))])
            found.append((np.vstack([shift, turn]) if turns else turn).T)
        return found

    def moved(self, step: FloatArray) -> ScrewParameters:
        """The arm after a step (p,) of all parameters; axes stay unit screws without pitch."""
        at = 0
        screws, home, anchors = self.screws.copy(), self.home, self.anchors.copy()
        offsets, T_base = self.offsets, self.T_frame_base
        if "screws" in self.free:
            for axis, directions in enumerate(self._directions_of_axes()):
                E = exp(directions @ step[at : at + directions.shape[1]])
                at += directions.shape[1]
                screws[axis] = adjoint(E) @ screws[axis]
                anchors[axis] = E[:3, :3] @ anchors[axis] + E[:3, 3]
        if "home" in self.free:
            home = pose.nearest(home @ exp(step[at : at + 6]))
            at += 6
        if "offsets" in self.free:
            offsets = offsets + step[at : at + len(offsets)]
            at += len(offsets)
        if "base" in self.free:
            E = exp(adjoint(self._base_point()) @ step[at : at + 6])
            T_base, home = pose.nearest(E @ T_base), pose.nearest(E @ home)
            anchors = anchors @ E[:3, :3].T + E[:3, 3]
            if len(screws):
                screws = screws @ adjoint(E).T
        screws = _unit(screws, self.nominal.is_revolute)
        if len(screws):
            anchors[-1] = _foot(screws[-1], home[:3, 3])  # where a turn of the last axis moves the tip least
        across = np.array([_across(w, like) for w, like in zip(_directions(screws), self.across, strict=True)])
        return replace(
            self,
            screws=screws,
            home=home,
            offsets=offsets,
            T_frame_base=T_base,
            anchors=anchors,
            across=across.reshape(-1, 2, 3),
        )

    def since_nominal(self) -> FloatArray:
        """How far the arm has come from the one on paper, (p,), in the units of the parameters.

        To first order the sum of all steps; an axis that was moved along itself, which changes nothing, has not moved.
        """
        start = ScrewParameters.of(self.nominal, self.free, self.T_frame_base)
        parts: list[FloatArray] = []
        if "screws" in self.free:
            for axis, turns in enumerate(self.nominal.is_revolute):
                way = self._way_of_axis(start, axis)
                if turns:
                    w = self.screws[axis, 3:]
                    on_axis = np.cross(w, self.screws[axis, :3])
                    plane = _directions(start.screws)[axis]
                    on_axis = on_axis + w * float(plane @ (start.anchors[axis] - on_axis)) / float(plane @ w)
                    parts.append(start.across[axis] @ (on_axis - start.anchors[axis]))
                parts.append(start.across[axis] @ way)
        if "home" in self.free:
            parts.append(_small_twist(pose.inverse(start.home) @ self.home))
        if "offsets" in self.free:
            parts.append(self.offsets)
        if "base" in self.free:
            parts.append(_small_twist(self.T_frame_base))
        return np.concatenate([np.empty(0), *parts])

    def _way_of_axis(self, start: ScrewParameters, axis: int) -> FloatArray:
        """Rotation vector that takes the direction on paper to the one now, the shortest way, (3,)."""
        old, new = _directions(start.screws)[axis], _directions(self.screws)[axis]
        normal = np.cross(old, new)
        sine = float(np.linalg.norm(normal))
        if sine == 0.0:
            return np.zeros(3)
        return np.asarray(normal / sine * np.arctan2(sine, float(old @ new)))

    def chain(self) -> Chain:
        """The arm with these screws; offsets of joints are part of them, so that it takes the values that are read.

        A frame on a link goes with the axis that moves the link, those after the last axis with the tip.
        """
        nominal = self.nominal
        start = ScrewParameters.of(nominal, self.free, self.T_frame_base)
        moved, screws = np.eye(4), []
        carries = [self.T_frame_base]
        for axis, angle in enumerate(self._angles(np.zeros((1, nominal.dof)))[0]):
            screws.append(adjoint(moved) @ self.screws[axis])
            E = np.eye(4)
            E[:3, :3] = rotation.from_rotation_vector(self._way_of_axis(start, axis))
            E[:3, 3] = self.anchors[axis] - E[:3, :3] @ start.anchors[axis]
            if angle != 0.0:
                moved = moved @ exp(self.screws[axis] * angle)
            carries.append(moved @ E @ self.T_frame_base)
        home = pose.nearest(moved @ self.home)
        carries[-1] = home @ pose.inverse(nominal.home)
        frames = [Frame(f.name, f.after, pose.nearest(carries[f.after] @ f.home)) for f in nominal.frames]
        base = nominal.base
        if not np.array_equal(self.T_frame_base, np.eye(4)):
            base = free_name("measured", [f.name for f in frames])
            frames.insert(0, Frame(base, 0, np.eye(4)))
        rows = _unit(np.array(screws).reshape(-1, 6), nominal.is_revolute)
        frames = [replace(f, home=home) if f.name == nominal.tip else f for f in frames]
        return replace(nominal, screws=rows, home=home, base=base, frames=tuple(frames))


def _frame_parameters(kind: str, name: str) -> list[Parameter]:
    moves = [Parameter(kind, name, f"moved along {axis}", "m") for axis in "xyz"]
    return moves + [Parameter(kind, name, f"turned about {axis}", "rad") for axis in "xyz"]


def _joint_of(chain: Chain, axis: int) -> str:
    """The joint that moves the axis; a mimic axis is told apart by its place."""
    joints = np.flatnonzero(chain.coupling[axis])
    if not joints.size:
        return f"axis {axis + 1}"
    name = chain.joint_names[int(joints[0])]
    shared = np.count_nonzero(chain.coupling[:, int(joints[0])]) > 1
    return f"{name} (axis {axis + 1})" if shared else name


def _directions(screws: FloatArray) -> FloatArray:
    """(m, 3) unit directions: of turning or of sliding."""
    turns = np.any(screws[:, 3:] != 0.0, axis=1)
    return np.where(turns[:, None], screws[:, 3:], screws[:, :3])


def _unit(screws: FloatArray, turns: NDArray[np.bool_]) -> FloatArray:
    """Screws cleaned of rounding: unit directions, no pitch, and exactly no angular part where they slide."""
    v, w = screws[:, :3].copy(), screws[:, 3:].copy()
    w[~turns] = 0.0
    w[turns] /= np.linalg.norm(w[turns], axis=1, keepdims=True)
    v[turns] -= w[turns] * np.sum(v[turns] * w[turns], axis=1, keepdims=True)
    v[~turns] /= np.linalg.norm(v[~turns], axis=1, keepdims=True)
    return np.hstack([v, w])


def _anchors(chain: Chain) -> FloatArray:
    """(m, 3): of each axis the point nearest to the one before, of the last one that nearest to the tip.

    Of a sliding axis it is the point before itself. Turned about a tip on it, the last axis leaves the tip where it is.
    """
    points, at = [], np.zeros(3)
    for axis, screw in enumerate(chain.screws):
        at = _foot(screw, chain.home[:3, 3] if axis == len(chain.screws) - 1 else at)
        points.append(at)
    return np.array(points).reshape(-1, 3)


def _foot(screw: FloatArray, point: FloatArray) -> FloatArray:
    """The point of an axis nearest to a point, (3,); a sliding axis has no place, so the point itself."""
    v, w = screw[:3], screw[3:]
    if not w.any():
        return point
    foot = np.cross(w, v)
    return np.asarray(foot + w * float(w @ (point - foot)))


def _across(axis: FloatArray, like: FloatArray | None = None) -> FloatArray:
    """Two directions across an axis: base axes where it is parallel to one, or those nearest to `like`, (2, 3)."""
    hint = np.eye(3)[int(np.argmin(np.abs(axis)))] if like is None else like[0]
    first = hint - axis * float(axis @ hint)
    first = first / np.linalg.norm(first)
    second = np.cross(axis, first)
    second = second / np.linalg.norm(second)
    if like is not None:
        return np.array([first, second if float(second @ like[1]) > 0.0 else -second])
    return np.array([d if d[int(np.argmax(np.abs(d)))] > 0.0 else -d for d in (first, second)])


def _word(direction: FloatArray) -> str:
    k = int(np.argmax(np.abs(direction)))
    if abs(float(direction[k])) > _ALIGNED:
        return "xyz"[k]
    return f"({', '.join(f'{value + 0.0:.2f}' for value in direction)})"


def _small_twist(T: FloatArray) -> FloatArray:
    """Displacement and rotation vector, (6,)."""
    return np.concatenate([T[:3, 3], rotation.as_rotation_vector(T[:3, :3])])
