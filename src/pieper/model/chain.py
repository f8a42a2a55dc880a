"""A serial arm as data: the screws of its joints at the home pose, and the home pose of its tip.

The forward kinematics of a chain is the product of exponentials (Brockett 1984; Lynch and Park, Modern Robotics, eq. 4.14)

    T_base_tip(q) = exp([S_1] q_1) exp([S_2] q_2) ... exp([S_n] q_n) home.

Screws are unit screws written *linear part first*, ``(v, w)``; a prismatic joint is a screw with ``w = 0`` and ``|v| = 1``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError, unknown_name
from pieper.model._arrays import ROTATION_TOLERANCE, pose_fault

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from pieper._native import kernels

FloatArray = NDArray[np.float64]

_UNIT_TOLERANCE = ROTATION_TOLERANCE  # of a unit screw


def _frozen(
    value: ArrayLike, shape: tuple[int, ...], name: str, *, finite: bool = True, empty: FloatArray | None = None
) -> FloatArray:
    """A read-only float64 copy of `value`, refused unless it has `shape` (-1 for any size) and is finite.

    `empty` stands in for a list without elements.
    """
    wanted = "(" + ", ".join("m" if size < 0 else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    try:
        array = np.asarray(value)
    except ValueError as cause:
        raise ArrayError(f"{name} must have shape {wanted}, got rows of different lengths") from cause
    if array.shape == (0,) and empty is not None:
        array = empty
    if array.dtype.kind not in "fiu":
        got = type(value).__name__ if array.dtype == object and array.shape == () else f"dtype {array.dtype}"
        raise ArrayError(f"{name} must be real numbers of shape {wanted}, got {got}")
    if array.ndim != len(shape) or any(size not in (-1, got) for size, got in zip(shape, array.shape, strict=True)):
        raise ArrayError(f"{name} must have shape {wanted}, got {array.shape}")
    array = np.array(array, dtype=np.float64)
    if np.isnan(array).any() or (finite and not np.isfinite(array).all()):
        raise ArrayError(f"{name} must be finite, got {array.tolist()}")
    array.setflags(write=False)
    return array


def _frozen_pose(value: ArrayLike, name: str) -> FloatArray:
    """A read-only pose, refused unless its rotation is orthonormal to 1e-9 and its last row is 0 0 0 1."""
    T = _frozen(value, (4, 4), name)
    fault = pose_fault(T)
    if fault is not None:
        raise ArrayError(f"{name} {fault}")
    return T


def _not_given() -> FloatArray:
    """An empty array: the constructor fills in what it stands for."""
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame carried by the chain.

    Attributes
    ----------
    name : str
        Link name.
    after : int
        Number of axes that move it: it turns with ``screws[:after]``.
    home : (4, 4) array
        Its pose in the base frame at the home pose [m, -].
    """

    name: str
    after: int
    home: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "home", _frozen_pose(self.home, f"home of frame {self.name!r}"))

    def __reduce__(self) -> tuple[type[Frame], tuple[str, int, FloatArray]]:
        return type(self), (self.name, self.after, self.home)


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial arm. Arrays are copied and read-only; every change returns a new chain.

    Attributes
    ----------
    name : str
    screws : (m, 6) array
        Unit screws of the axes at the home pose in the base frame, linear part first [m, -]. ``m == n`` unless mimic
        joints couple several axes to one joint.
    home : (4, 4) array
        Pose of the tip in the base frame at ``q = 0``.
    limits : (n, 2) array
        Lower and upper joint limits [rad or m]; infinite for continuous joints.
    joint_names : tuple of n str
    base, tip : str
        Frame names.
    frames : tuple of Frame
        Every frame from base to tip in order, fixed ones included. Made from the screws when not given.
    max_velocity, max_effort : (n,) arrays
        Speed limit [rad/s or m/s] and effort limit [N m or N]; infinite where the description gives none.
    coupling : (m, n) array
        Axis angles from joint values, ``q_axes = coupling @ q``; the identity unless there are mimic joints.
    """

    name: str
    screws: FloatArray
    home: FloatArray
    limits: FloatArray
    joint_names: tuple[str, ...]
    base: str = "base"
    tip: str = "tip"
    frames: tuple[Frame, ...] = ()
    max_velocity: FloatArray = field(default_factory=_not_given)
    max_effort: FloatArray = field(default_factory=_not_given)
    coupling: FloatArray = field(default_factory=_not_given)

    def __post_init__(self) -> None:
        def put(key: str, value: Any) -> None:
            object.__setattr__(self, key, value)

        put("joint_names", tuple(self.joint_names))
        n = len(self.joint_names)
        if len(set(self.joint_names)) != n:
            raise ArrayError(f"joint names must be unique, got {', '.join(self.joint_names)}")
        put("coupling", _frozen(self.coupling, (-1, n), "coupling", empty=np.eye(n)))
        m = len(self.coupling)
        put("screws", _frozen(self.screws, (m, 6), "screws", empty=np.empty((0, 6))))
        put("home", _frozen_pose(self.home, "home"))
        put("limits", _frozen(self.limits, (n, 2), "limits", finite=False, empty=np.empty((0, 2))))
        for key in ("max_velocity", "max_effort"):
            put(key, _frozen(getattr(self, key), (n,), key, finite=False, empty=np.full(n, np.inf)))
        for axis, screw in enumerate(self.screws):
            self._check_screw(axis, screw)
        wrong = np.flatnonzero(self.limits[:, 0] > self.limits[:, 1])
        if wrong.size:
            i = int(wrong[0])
            raise ArrayError(
                f"limits of joint {self.joint_names[i]!r} must be lower <= upper, got {self.limits[i].tolist()}"
            )
        put("frames", tuple(self.frames) or self._frames_from_screws())

    @staticmethod
    def _check_screw(axis: int, screw: FloatArray) -> None:
        v, w = screw[:3], screw[3:]
        length = float(np.linalg.norm(w))
        if length == 0.0:
            if abs(float(np.linalg.norm(v)) - 1.0) > _UNIT_TOLERANCE:
                raise ArrayError(
                    f"screw {axis} is prismatic (w = 0) and needs |v| = 1, got |v| = {np.linalg.norm(v):.6g}"
                )
            return
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise ArrayError(f"screw {axis} needs |w| = 1 (revolute) or w = 0 (prismatic), got |w| = {length:.6g}")
        pitch = float(v @ w)
        if abs(pitch) > _UNIT_TOLERANCE * max(1.0, float(np.linalg.norm(v))):
            raise ArrayError(
                f"screw {axis} has pitch {pitch:.6g} m/rad; only revolute and prismatic joints are supported"
            )

    def _frames_from_screws(self) -> tuple[Frame, ...]:
        """One frame per axis: origin on the axis nearest the previous origin, z along the axis."""
        frames = [Frame(self.base, 0, np.eye(4))]
        origin = np.zeros(3)
        for i, screw in enumerate(self.screws):
            v, w = screw[:3], screw[3:]
            z = w if w.any() else v
            if w.any():
                point = np.cross(w, v)
                origin = point + w * float(w @ (origin - point))
            x = np.cross([0.0, 0.0, 1.0], z) if abs(z[2]) < 0.9 else np.cross([0.0, 1.0, 0.0], z)
            x = x / np.linalg.norm(x)
            T = np.eye(4)
            T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
            T[:3, 3] = origin
            frames.append(Frame(f"{self.base}_{i + 1}", i + 1, T))
        frames.append(Frame(self.tip, len(self.screws), self.home))
        return tuple(frames)

    @property
    def dof(self) -> int:
        """Number of joints n (length of ``q``)."""
        return len(self.joint_names)

    @property
    def is_revolute(self) -> NDArray[np.bool_]:
        """(m,) mask of the axes that turn; the others slide."""
        mask: NDArray[np.bool_] = np.any(self.screws[:, 3:] != 0.0, axis=1)
        return mask

    @property
    def is_coupled(self) -> bool:
        """True when mimic joints move more than one axis with one joint."""
        return self.coupling.shape[0] != self.coupling.shape[1] or not np.array_equal(self.coupling, np.eye(self.dof))

    def joint_index(self, name: str) -> int:
        """Position of a joint in ``q``."""
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise unknown_name("joint", name, self.joint_names, f"chain {self.name!r}") from None

    def frame(self, which: str | int) -> Frame:
        """A frame by link name, or by joint count: 0 is the base, i the link that the first i axes move.

        Raises
        ------
        UnknownNameError
            No frame of that name; the message lists those there are.
        ArrayError
            A number of joints that the chain does not have.
        """
        if isinstance(which, str):
            for frame in self.frames:
                if frame.name == which:
                    return frame
            raise unknown_name("frame", which, [f.name for f in self.frames], f"chain {self.name!r}")
        if isinstance(which, bool) or which not in range(len(self.screws) + 1):
            raise ArrayError(f"up_to must be a frame name or a joint count from 0 to {len(self.screws)}, got {which!r}")
        return next(f for f in self.frames if f.after == which)

    def named(self, q: dict[str, float]) -> FloatArray:
        """(n,) joint vector from a mapping by joint name; joints left out are 0."""
        values = np.zeros(self.dof)
        for name, value in q.items():
            values[self.joint_index(name)] = value
        return values

    def with_tool(self, T_tip_tool: ArrayLike, *, name: str = "tool") -> Chain:
        """A chain whose tip is the tool frame, ``home @ T_tip_tool``; (4, 4) [m, -]."""
        T = _frozen_pose(T_tip_tool, "T_tip_tool")
        home = self.home @ T
        name = free_name(name, [f.name for f in self.frames])
        return replace(self, home=home, tip=name, frames=(*self.frames, Frame(name, len(self.screws), home)))

    def with_base(self, T_world_base: ArrayLike, *, name: str = "world") -> Chain:
        """The same arm described from another base frame, ``T_world_base @ home``; (4, 4) [m, -]."""
        T = _frozen_pose(T_world_base, "T_world_base")
        R, p = T[:3, :3], T[:3, 3]
        w = self.screws[:, 3:] @ R.T
        v = self.screws[:, :3] @ R.T + np.cross(p, w)
        name = free_name(name, [f.name for f in self.frames])
        frames = (Frame(name, 0, np.eye(4)), *(Frame(f.name, f.after, T @ f.home) for f in self.frames))
        return replace(self, screws=np.hstack([v, w]), home=T @ self.home, base=name, frames=frames)

    def lock(self, /, **q: float) -> Chain:
        """A smaller arm with the named joints held at the given values [rad or m].

        The screws that follow a locked axis move with it (Modern Robotics, eq. 3.102, adjoint of its exponential).

        Raises
        ------
        UnknownNameError
            No joint of that name; the message lists those there are.
        ArrayError
            A value that is not finite.
        """
        from pieper.spatial.twist import adjoint, exp

        held = {self.joint_index(name): float(value) for name, value in q.items()}
        for index, value in held.items():
            if not np.isfinite(value):
                raise ArrayError(f"joint {self.joint_names[index]!r} must be locked at a finite value, got {value}")
        fixed = np.array([held.get(i, 0.0) for i in range(self.dof)])
        keep_joint = np.array([i not in held for i in range(self.dof)], dtype=bool)
        offset = self.coupling @ fixed
        keep_axis = np.any(self.coupling[:, keep_joint] != 0.0, axis=1)
        moved = np.eye(4)
        screws, after = [], [0]
        frames_T = [moved]
        for axis, screw in enumerate(self.screws):
            if keep_axis[axis]:
                screws.append(adjoint(moved) @ screw)
            if offset[axis] != 0.0:
                moved = moved @ exp(screw * offset[axis])
            after.append(len(screws))
            frames_T.append(moved)
        frames = tuple(Frame(f.name, after[f.after], frames_T[f.after] @ f.home) for f in self.frames)
        return replace(
            self,
            screws=np.array(screws).reshape(-1, 6),
            home=moved @ self.home,
            limits=self.limits[keep_joint],
            joint_names=tuple(n for n, k in zip(self.joint_names, keep_joint, strict=True) if k),
            frames=frames,
            max_velocity=self.max_velocity[keep_joint],
            max_effort=self.max_effort[keep_joint],
            coupling=self.coupling[np.ix_(keep_axis, keep_joint)],
        )

    @cached_property
    def native(self) -> kernels.NativeChain:
        """The chain in the form that the compiled kernels take; made once."""
        from pieper._native import kernels

        return kernels.NativeChain(self.screws, self.home, self.coupling, self.limits)

    def __reduce__(self) -> tuple[type[Chain], tuple[Any, ...]]:
        return type(self), tuple(getattr(self, f.name) for f in fields(self))

    def __repr__(self) -> str:
        return f"Chain({self.name!r}, {self.dof} joints, {self.base!r} -> {self.tip!r})"


def free_name(name: str, taken: Collection[str]) -> str:
    """`name`, or `name_2`, `name_3`, ... when it is taken."""
    candidate, count = name, 1
    while candidate in taken:
        count += 1
        candidate = f"{name}_{count}"
    return candidate


def default_joint_names(n: int) -> Sequence[str]:
    """``joint_1`` ... ``joint_n``."""
    return tuple(f"joint_{i + 1}" for i in range(n))
