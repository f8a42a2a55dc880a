"""The links and joints that say the same as a chain."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import DescriptionError
from pieper.model._joint_motion import ON_AXIS, inverse
from pieper.model.chain import Chain, Frame, free_name
from pieper.model.joint import Joint, Link, Mimic

if TYPE_CHECKING:
    from pieper.model._arrays import FloatArray


def links_and_joints(chain: Chain) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """The links and joints that say the same as a chain."""
    return _Links(chain).build()


class _Links:
    """Collects the links and joints that say the same as a chain."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.links = [chain.base]
        self.joints: list[Joint] = []
        self.taken_joints = set(chain.joint_names)
        self.taken_links = {chain.base, chain.tip, *(frame.name for frame in chain.frames)}
        self.owner: dict[int, int] = {}  # joint index -> the axis that bears its name; the other axes mimic it
        for axis, row in enumerate(chain.coupling):
            if np.count_nonzero(row) > 1:
                raise DescriptionError(
                    chain.name,
                    f"axis {axis + 1}",
                    f"depends on {np.count_nonzero(row)} joints at once, and a joint can mimic one joint only",
                )
            joint = int(np.argmax(row != 0.0))
            if row[joint] == 1.0:
                self.owner.setdefault(joint, axis)

    def build(self) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
        chain = self.chain
        at, T_at, after = chain.base, np.eye(4), 0
        written = {chain.base}
        frames = sorted(chain.frames, key=lambda frame: frame.after)
        if frames[-1].name != chain.tip:
            frames.append(Frame(chain.tip, len(chain.screws), chain.home))
        for frame in frames:
            if frame.name in written:  # the base itself
                continue
            written.add(frame.name)
            while after < frame.after:
                point = self._nearest_on_axis(after, frame.home[:3, 3])
                apart = float(np.linalg.norm(point - frame.home[:3, 3]))
                T_next, child = np.array(frame.home), frame.name
                if after + 1 < frame.after or apart > ON_AXIS * max(1.0, float(np.linalg.norm(point))):
                    T_next[:3, 3] = point
                    child = self._new_link(f"{self._joint_name(after)}_axis")
                self._add(at, child, T_at, T_next, after)
                at, T_at, after = child, T_next, after + 1
            if at != frame.name:
                self._add(at, frame.name, T_at, np.array(frame.home), None)
                at, T_at = frame.name, np.array(frame.home)
        for joint in range(chain.dof):
            if joint not in self.owner:
                self._add_lone_master(joint)
        return tuple(Link(name) for name in self.links), tuple(self.joints)

    def _nearest_on_axis(self, axis: int, point: FloatArray) -> FloatArray:
        v, w = self.chain.screws[axis, :3], self.chain.screws[axis, 3:]
        if not w.any():
            return point  # a sliding axis has a direction only
        foot = np.cross(w, v)
        return np.asarray(foot + w * float(w @ (point - foot)))

    def _joint_name(self, axis: int) -> str:
        return self.chain.joint_names[int(np.argmax(self.chain.coupling[axis] != 0.0))]

    def _new_link(self, name: str) -> str:
        name = free_name(name, self.taken_links)
        self.taken_links.add(name)
        return name

    def _add(self, parent: str, child: str, T_parent: FloatArray, T_child: FloatArray, axis: int | None) -> None:
        """A joint between two frames given at home; fixed when no axis moves it."""
        self.links.append(child)
        T = inverse(T_parent) @ T_child
        T[3] = [0.0, 0.0, 0.0, 1.0]
        if axis is None or not self.chain.coupling[axis].any():
            name = free_name(f"{parent}-{child}", self.taken_joints)
            self.taken_joints.add(name)
            self.joints.append(Joint(name, "fixed", parent, child, T))
            return
        screw = self.chain.screws[axis]
        turns = bool(screw[3:].any())
        direction = T_child[:3, :3].T @ (screw[3:] if turns else screw[:3])
        index = int(np.argmax(self.chain.coupling[axis] != 0.0))
        if self.owner.get(index) == axis:
            self._add_moving(self.chain.joint_names[index], parent, child, T, direction, turns, index)
            return
        name = free_name(f"{self.chain.joint_names[index]}_mimic", self.taken_joints)
        self.taken_joints.add(name)
        mimic = Mimic(self.chain.joint_names[index], float(self.chain.coupling[axis, index]))
        self._add_moving(name, parent, child, T, direction, turns, index, mimic)

    def _add_moving(
        self,
        name: str,
        parent: str,
        child: str,
        T: FloatArray,
        direction: FloatArray,
        turns: bool,
        index: int,
        mimic: Mimic | None = None,
    ) -> None:
        factor = 1.0 if mimic is None else mimic.multiplier
        lower, upper = sorted(float(value) * factor for value in self.chain.limits[index])
        endless = turns and lower == -inf and upper == inf
        self.joints.append(
            Joint(
                name,
                "continuous" if endless else "revolute" if turns else "prismatic",
                parent,
                child,
                T,
                direction,
                lower,
                upper,
                float(self.chain.max_velocity[index]) * abs(factor),
                float(self.chain.max_effort[index]),
                mimic,
            )
        )

    def _add_lone_master(self, index: int) -> None:
        """A joint beside the chain that bears the name and the limits which axes on the chain mimic."""
        axes = np.flatnonzero(self.chain.coupling[:, index])
        turns = bool(self.chain.screws[axes[0], 3:].any()) if axes.size else True
        name = self.chain.joint_names[index]
        child = self._new_link(f"{name}_link")
        self.links.append(child)
        self._add_moving(name, self.chain.base, child, np.eye(4), np.array([0.0, 0.0, 1.0]), turns, index)
