"""Frames on ``/tf``: the links of a robot as robot_state_publisher gives them, and frames of Denavit-Hartenberg rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import DescriptionError, UnknownNameError
from pieper.kinematics.fk import fk_frames
from pieper.model import catalog
from pieper.model.description import Description
from pieper.model.dh import from_dh
from pieper.ros import messages
from pieper.ros.nodes.joint_states import on_network
from pieper.spatial.rotation import as_quaternion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.arm import Arm
    from pieper.model.description import Joint

FloatArray = NDArray[np.float64]

TF_MESSAGE = "tf2_msgs/msg/TFMessage"

DH_FRAMES = {"simplified": "arm5b_link_", "full": "arm5d_link_"}
"""Frames of the tables that are on record for the youBot, by the label of the table: ``arm5b_link_1`` and so on."""


class TransformMessage:
    """A message of many transforms that is filled in again and again.

    Parameters
    ----------
    frames : sequence of (str, str)
        Parent and child of each transform.
    """

    def __init__(self, frames: Sequence[tuple[str, str]]) -> None:
        self.message = messages.make(
            TF_MESSAGE,
            transforms=[{"header": {"frame_id": parent}, "child_frame_id": child} for parent, child in frames],
        )
        self._stamp = messages.make("builtin_interfaces/msg/Time")
        for transform in self.message.transforms:
            transform.header.stamp = self._stamp
        self._parts = [(t.transform.translation, t.transform.rotation) for t in self.message.transforms]

    def fill(self, sec: int, nanosec: int, positions: FloatArray, quaternions: FloatArray) -> Any:
        """Return the message with this stamp, (k, 3) positions [m] and (k, 4) quaternions ``xyzw``."""
        self._stamp.sec, self._stamp.nanosec = sec, nanosec
        for (translation, rotation), p, q in zip(self._parts, positions.tolist(), quaternions.tolist(), strict=True):
            translation.x, translation.y, translation.z = p
            rotation.x, rotation.y, rotation.z, rotation.w = q
        return self.message


class LinkFrames:
    """Each link of a robot in the frame of its parent, for joint values by name.

    With ``T_parent_joint = (p, q_0)``, a joint that turns by v about the unit axis w gives ``p`` and
    ``q_0 (w sin(v/2), cos(v/2))``, one that slides gives ``p + R_0 w v`` and ``q_0``.

    Parameters
    ----------
    arm : Arm
        Its whole description is shown, links beside the chain and joints that mimic others included; an arm without
        one is shown by the frames of its chain.

    Attributes
    ----------
    fixed : list of (str, str, (4, 4) array)
        Parent, child and pose of what does not move.

    Examples
    --------
    >>> import pieper
    >>> frames = LinkFrames(pieper.load("mh12"))
    >>> [(parent, child) for parent, child, _ in frames.fixed]
    [('link_6_t', 'tool0')]
    >>> frames.name(["joint_6_t", "joint_1_s"])
    [('base_link', 'link_1_s'), ('link_5_b', 'link_6_t')]
    >>> positions, quaternions = frames.at(np.array([0.0, np.pi]))
    >>> positions[0].tolist(), quaternions[0].round(6).tolist()
    ([0.0, 0.0, 0.45], [0.0, 0.0, 1.0, 0.0])
    """

    def __init__(self, arm: Arm) -> None:
        description = arm.description or Description.from_chain(arm.chain)
        links = {link.name for link in description.links}
        self.fixed = [(j.parent, j.child, j.T_parent_joint) for j in description.joints if j.type == "fixed"]
        for one, other in zip(arm.chain.frames, arm.chain.frames[1:], strict=False):
            if one.after == other.after and not {one.name, other.name} <= links:  # a base or a tool that was added
                self.fixed.append((one.name, other.name, np.linalg.inv(one.home) @ other.home))
        self._joints = [joint for joint in description.joints if joint.moves]
        self._values = [_followed(description, joint) for joint in self._joints]
        self._shown: list[int] = []
        self._sources = np.empty(0, dtype=np.intp)

    def name(self, joints: Sequence[str]) -> list[tuple[str, str]]:
        """Take the values of `at` to belong to these joints; return parent and child of each frame that they move."""
        known = {name: place for place, name in enumerate(joints)}
        shown = [i for i, (master, _, _) in enumerate(self._values) if master in known]
        self._sources = np.array([known[self._values[i][0]] for i in shown], dtype=np.intp)
        self._factor = np.array([self._values[i][1] for i in shown])
        self._offset = np.array([self._values[i][2] for i in shown])
        turns = np.array([self._joints[i].type != "prismatic" for i in shown], dtype=bool).reshape(-1, 1)
        T = np.array([self._joints[i].T_parent_joint for i in shown]).reshape(-1, 4, 4)
        axes = np.array([self._joints[i].axis for i in shown]).reshape(-1, 3)
        self._p = T[:, :3, 3]
        self._q_0 = as_quaternion(T[:, :3, :3])
        self._q_1 = np.where(turns, _times_axis(self._q_0, axes), 0.0)  # what sin(v/2) multiplies
        self._half = np.where(turns[:, 0], 0.5, 0.0)
        self._slide = np.where(turns, 0.0, (T[:, :3, :3] @ axes[..., None])[..., 0])
        return [(self._joints[i].parent, self._joints[i].child) for i in shown]

    def at(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, 3) positions [m] and (k, 4) quaternions ``xyzw`` of the frames for the values of the named joints."""
        v = (self._factor * values[self._sources] + self._offset)[:, None]
        half = self._half[:, None] * v
        return self._p + self._slide * v, np.cos(half) * self._q_0 + np.sin(half) * self._q_1


class DhFrames:
    """Frames of the tables of Denavit-Hartenberg rows that are on record for an arm, each in the base frame.

    Attributes
    ----------
    frames : list of (str, str)
        Parent and child; empty for arms other than the youBot.

    Examples
    --------
    >>> import pieper
    >>> frames = DhFrames(pieper.load("youbot"))
    >>> frames.frames[0], frames.frames[-1]
    (('base_link', 'arm5b_link_1'), ('base_link', 'arm5d_link_5'))
    >>> frames.at(np.zeros(5))[0][4].round(6).tolist()  # the simplified table stands upright at zero
    [0.0, 0.0, 0.478]
    """

    def __init__(self, arm: Arm) -> None:
        self.frames: list[tuple[str, str]] = []
        self._chains: list[tuple[Any, list[str]]] = []
        try:
            tables = catalog.dh_tables(arm.name)
        except UnknownNameError:
            return
        for label, table in tables.items():
            if label in DH_FRAMES and table.joint_names == arm.joint_names:
                chain = from_dh(table)
                rows = [chain.frames[1 + row].name for row in table.moving]
                self._chains.append((chain, rows))
                self.frames += [(table.base, f"{DH_FRAMES[label]}{i}") for i in range(1, len(rows) + 1)]

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, 3) positions [m] and (k, 4) quaternions ``xyzw`` of the frames for the joint values of the arm."""
        T = np.concatenate([fk_frames(chain, q, frames=rows) for chain, rows in self._chains])
        return T[:, :3, 3], as_quaternion(T[:, :3, :3])


def link_frames(arm: Arm) -> LinkFrames | None:
    """The links of an arm; None where no tree of links can say what its chain says."""
    try:
        return LinkFrames(arm)
    except DescriptionError:
        return None


def _followed(description: Description, joint: Joint) -> tuple[str, float, float]:
    """Name on the network of the joint whose value moves this one, and ``value = factor * that + offset``."""
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = description.joint(joint.mimic.joint)
    name, sign = on_network(joint.name)
    return name, sign * factor, offset


def _times_axis(q: FloatArray, axes: FloatArray) -> FloatArray:
    """(k, 4) products of quaternions ``xyzw`` with ``(axis, 0)``."""
    v, w = q[:, :3], q[:, 3:]
    return np.concatenate([w * axes + np.cross(v, axes), -np.sum(v * axes, axis=1, keepdims=True)], axis=1)
