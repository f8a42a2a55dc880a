"""Inverse kinematics as services: the list of poses of the pick and place report, every branch of one pose, and MoveIt's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import RosError, unknown_name
from pieper.ik import redundancy, select
from pieper.ros import messages
from pieper.ros.nodes.complaints import Complaints
from pieper.ros.qos import SENSOR
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.arm import Arm
    from pieper.model.chain import FloatArray, Frame
    from pieper.ros.bus import Bus

SUCCESS = 1
"""``moveit_msgs/msg/MoveItErrorCodes``, as those below."""
INVALID_GROUP_NAME = -15
INVALID_GOAL_CONSTRAINTS = -16
INVALID_ROBOT_STATE = -17
INVALID_LINK_NAME = -18
FRAME_TRANSFORM_FAILURE = -21
COLLISION_CHECKING_UNAVAILABLE = -22
NO_IK_SOLUTION = -31

_REASONS = 3  # how many of the poses that were not reached the log tells the reason of: each takes a search
_MOST_LINKS = 1000
_FARTHEST = 1e6  # [rad or m]: no joint is there, and angles that large have lost their digits


class _MoveItError(Exception):
    """A request that is answered with one of MoveIt's error codes."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class IkServer:
    """Answers ``calculate_ik``, ``calculate_ik_branches``, ``compute_ik`` and ``compute_fk``.

    Poses are those of the arm's tip in its base frame, unless the parameter ``frame`` names another frame that is fixed to the tip.
    Of all branches inside the joint limits the one nearest to the point before is taken; nearest to where the arm is, as heard on
    ``joint_states``, for the first. A pose that cannot be had gets an empty point, and the log says why; the others are answered.

    Parameters
    ----------
    bus : Bus
    arm : Arm

    Raises
    ------
    RosError
        The parameter ``frame`` names no frame that is fixed to the tip.

    Examples
    --------
    >>> import pieper
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> server, user = IkServer(network.bus("IK_server"), pieper.load("kuka_kr210_robond")), network.bus("user")
    >>> client = user.client("calculate_ik", "pieper_interfaces/srv/CalculateIK")
    >>> drop = {"position": {"x": 0.0, "y": 2.5, "z": 1.5}, "orientation": {"z": 0.70710678, "w": 0.70710678}}
    >>> user.call(client, 1.0, poses=[drop]).points[0].positions.round(3) + 0.0
    array([ 1.571,  0.334, -0.078,  0.   , -0.255,  0.   ])
    """

    def __init__(self, bus: Bus, arm: Arm) -> None:
        self._bus, self._arm, self._complaints = bus, arm, Complaints(bus)
        chain = arm.chain
        tips = [frame for frame in chain.frames if frame.after == len(chain.screws)]
        self._tips = {frame.name: frame for frame in tips}
        self._bases = {frame.name: frame for frame in chain.frames if frame.after == 0}
        frame = bus.parameter(
            "frame", arm.tip, description="whose pose calculate_ik is asked for, fixed to the tip", read_only=True
        ).value
        if frame not in self._tips:
            raise RosError(f"parameter frame: {unknown_name('frame', frame, self._tips, 'those fixed to the tip')}")
        self._frame = self._tips[frame]
        self._most = bus.parameter(
            "max_poses", 10_000, description="poses that one request may hold", check=_above_zero
        )
        self._group = bus.parameter("group", "", description="group name that compute_ik insists on; any, if empty")
        self._here = np.clip(np.zeros(arm.dof), *arm.limits.T)
        self._heard = False
        arm.ik(
            arm.fk(self._here)[None], self._here
        )  # what is made when first needed is made now, not in the first request
        rotation.from_quaternion([0.0, 0.0, 0.0, 1.0])
        bus.subscribe("joint_states", "sensor_msgs/msg/JointState", self._on_joint_states, qos=SENSOR)
        bus.serve("calculate_ik", "pieper_interfaces/srv/CalculateIK", self._calculate_ik)
        bus.serve("calculate_ik_branches", "pieper_interfaces/srv/CalculateIKBranches", self._calculate_branches)
        bus.serve("compute_ik", "moveit_msgs/srv/GetPositionIK", self._compute_ik)
        bus.serve("compute_fk", "moveit_msgs/srv/GetPositionFK", self._compute_fk)
        bus.log("info", f"Poses are those of {frame!r} in {arm.base!r}; joints are: {', '.join(arm.joint_names)}")
        bus.log("info", "Ready to receive an IK request")

    # The services of the report

    def _calculate_ik(self, request: Any) -> dict[str, Any]:
        poses = request.poses
        if not poses:
            self._complaints.say("warn", "No valid poses received")
            return {"points": []}
        self._bus.log("info", f"Received {len(poses)} eef-poses from the plan")
        if len(poses) > self._most.value:
            self._complaints.say("warn", f"refused: {len(poses)} poses, and max_poses is {self._most.value}")
            return {"points": []}
        began = time.perf_counter()
        q, reasons = self._solve(poses)
        took = time.perf_counter() - began
        if reasons:
            self._complaints.say(
                "warn", f"poses without a point: {len(reasons)} of {len(poses)}: {self._told(reasons)}"
            )
        self._bus.log("info", f"length of Joint Trajectory List: {len(q)}")
        self._bus.log("info", f"Solved in {1e3 * took:.3f} ms, {1e6 * took / len(poses):.1f} us per pose")
        return {"points": [{} if np.isnan(values[0]) else {"positions": values} for values in q]}

    def _calculate_branches(self, request: Any) -> dict[str, Any]:
        T, reason = self._pose_of_tip(request.pose, self._frame)
        if not reason:
            answers = select.within_limits(self._arm.ik(T, self._here))
            if answers.valid.any():
                return {
                    "points": [{"positions": values} for values in answers.q[answers.valid]],
                    "labels": list(answers.labels[answers.valid]),
                }
            reason = self._arm.ik(T, self._here).reason
        self._complaints.say("warn", f"calculate_ik_branches: {reason}")
        return {}

    def _solve(self, poses: Sequence[Any]) -> tuple[FloatArray, dict[int, str | FloatArray]]:
        """Joint values (m, n), NaN where there are none; and by index why not, or the pose that tells why."""
        q = np.full((len(poses), self._arm.dof), np.nan)
        Ts, malformed = _matrices(poses)
        reasons: dict[int, str | FloatArray] = dict(malformed)
        good = np.array([i for i in range(len(poses)) if i not in malformed], dtype=int)
        if good.size:
            Ts = Ts[good] @ self._from_frame(self._frame)
            q[good] = self._along(Ts, self._here)
            for row in np.flatnonzero(np.isnan(q[good, 0])):
                reasons[int(good[row])] = Ts[row]
        return q, reasons

    def _along(self, Ts: FloatArray, here: FloatArray) -> FloatArray:
        """Joint values (m, n) for poses in sequence, NaN where there are none within the limits."""
        if self._arm.ik_info.method == "redundancy":  # one joint held where it is, if that goes: a path without jumps
            held = here[[redundancy.prepare(self._arm.chain).joint]]
            q = select.along(select.within_limits(self._arm.ik(Ts, here, redundancy=held)), here)
            if not np.isnan(q).any():
                return q
        return select.along(select.within_limits(self._arm.ik(Ts, here)), here)

    def _told(self, reasons: dict[int, str | FloatArray]) -> str:
        """The first few reasons in words."""
        first = sorted(reasons)[:_REASONS]
        words = [f"pose {i}: {r if isinstance(r := reasons[i], str) else self._arm.ik(r).reason}" for i in first]
        return "; ".join([*words, f"and {len(reasons) - len(first)} more"] if len(reasons) > len(first) else words)

    # The services of MoveIt

    def _compute_ik(self, request: Any) -> dict[str, Any]:
        try:
            q = self._position_ik(request.ik_request)
        except _MoveItError as error:
            self._complaints.say("warn", f"compute_ik: {error}")
            return {"error_code": self._failure(error)}
        return {"solution": {"joint_state": self._joint_state(q)}, "error_code": {"val": SUCCESS}}

    def _position_ik(self, request: Any) -> FloatArray:
        group = self._group.value
        if group and request.group_name not in ("", group):
            raise _MoveItError(
                INVALID_GROUP_NAME, f"no group {request.group_name[:255]!r}; the group of this server is {group!r}"
            )
        if request.avoid_collisions:
            raise _MoveItError(
                COLLISION_CHECKING_UNAVAILABLE, "collisions cannot be checked here; ask with avoid_collisions false"
            )
        if any(messages.as_fields(request.constraints)[kind] for kind in _CONSTRAINTS):
            raise _MoveItError(INVALID_GOAL_CONSTRAINTS, "constraints are not supported; leave them empty")
        if request.ik_link_names or request.pose_stamped_vector:
            raise _MoveItError(
                INVALID_LINK_NAME, "one link and one pose are solved at a time: ik_link_name and pose_stamped"
            )
        link = request.ik_link_name or self._arm.tip
        if link not in self._tips:
            raise _MoveItError(
                INVALID_LINK_NAME, str(unknown_name("link", link[:255], self._tips, "those fixed to the tip"))
            )
        seed = self._state(request.robot_state.joint_state)
        T, reason = self._pose_of_tip(request.pose_stamped.pose, self._tips[link])
        if reason:
            raise _MoveItError(NO_IK_SOLUTION, reason)
        T = self._base(request.pose_stamped.header.frame_id).home @ T
        q: FloatArray = self._along(T[None], seed)[0]
        if np.isnan(q).any():
            raise _MoveItError(NO_IK_SOLUTION, self._arm.ik(T).reason)
        return q

    def _compute_fk(self, request: Any) -> dict[str, Any]:
        try:
            frames = [frame.name for frame in self._arm.chain.frames]
            links = list(request.fk_link_names) or [self._arm.tip]
            if len(links) > _MOST_LINKS:
                raise _MoveItError(
                    INVALID_LINK_NAME, f"{len(links)} links asked for; at most {_MOST_LINKS} are answered"
                )
            for link in links:
                if link not in frames:
                    raise _MoveItError(INVALID_LINK_NAME, str(unknown_name("link", link[:255], frames, self._arm.name)))
            frame = request.header.frame_id or self._arm.base
            T_base_header = self._base(frame).home
            q = self._state(request.robot_state.joint_state, limits=False)
        except _MoveItError as error:
            self._complaints.say("warn", f"compute_fk: {error}")
            return {"error_code": self._failure(error)}
        Ts = np.linalg.inv(T_base_header) @ self._arm.fk_frames(q, frames=links)
        header = {"stamp": self._bus.stamp(), "frame_id": frame}
        return {
            "pose_stamped": [{"header": header, "pose": _as_pose(T)} for T in Ts],
            "fk_link_names": links,
            "error_code": {"val": SUCCESS},
        }

    def _state(self, state: Any, *, limits: bool = True) -> FloatArray:
        """The joint values of a request: what it leaves out is where the arm is."""
        names, positions = list(state.name), np.asarray(state.position, dtype=float)
        if len(names) != len(positions) or len(set(names)) != len(names):
            raise _MoveItError(
                INVALID_ROBOT_STATE,
                f"a joint state has one position for each of its names, got {len(names)} names "
                f"({len(set(names))} different) and {len(positions)} positions",
            )
        if not (np.abs(positions) < _FARTHEST).all():
            raise _MoveItError(
                INVALID_ROBOT_STATE, f"a position of the joint state is not finite, or is {_FARTHEST:g} or more"
            )
        given = dict(zip(names, positions, strict=True))
        missing = [name for name in self._arm.joint_names if name not in given]
        if missing and not limits and not self._heard:
            raise _MoveItError(
                INVALID_ROBOT_STATE,
                f"the joint state lacks {', '.join(missing)}, and no joint_states were heard to take them from",
            )
        here = dict(zip(self._arm.joint_names, self._here, strict=True))
        return np.array([given.get(name, here[name]) for name in self._arm.joint_names])

    def _base(self, frame: str) -> Frame:
        """The frame of a header; nothing is known of frames that are not fixed to the base."""
        name = frame or self._arm.base
        if name not in self._bases:
            raise _MoveItError(
                FRAME_TRANSFORM_FAILURE, str(unknown_name("frame", name[:255], self._bases, "those fixed to the base"))
            )
        return self._bases[name]

    def _failure(self, error: _MoveItError) -> dict[str, Any]:
        return {"val": error.code, "message": str(error), "source": self._bus.node}

    # Beneath

    def _on_joint_states(self, message: Any) -> None:
        """Remember where the arm is; messages of other robots, and what makes no sense, are passed over."""
        if len(message.name) != len(message.position):
            return
        for name, value in zip(message.name, message.position, strict=True):
            if name in self._arm.joint_names and abs(value) < _FARTHEST:
                self._here[self._arm.joint_names.index(name)] = value
                self._heard = True

    def _from_frame(self, frame: Frame) -> FloatArray:
        """``T_frame_tip``."""
        return np.asarray(np.linalg.inv(frame.home) @ self._arm.chain.home)

    def _pose_of_tip(self, message: Any, frame: Frame) -> tuple[FloatArray, str]:
        """``T_base_tip`` for a pose of the frame, and what is wrong with it, or nothing."""
        Ts, malformed = _matrices([message])
        return Ts[0] @ self._from_frame(frame), malformed.get(0, "")

    def _joint_state(self, q: FloatArray) -> dict[str, Any]:
        header = {"stamp": self._bus.stamp(), "frame_id": self._arm.base}
        return {"header": header, "name": list(self._arm.joint_names), "position": q}


_CONSTRAINTS = ("joint_constraints", "position_constraints", "orientation_constraints", "visibility_constraints")


def _matrices(poses: Sequence[Any]) -> tuple[FloatArray, dict[int, str]]:
    """(m, 4, 4) of ``geometry_msgs/msg/Pose``, quaternions normalised; the identity and the reason by index for what is no pose."""
    values = np.array(
        [
            (
                p.position.x,
                p.position.y,
                p.position.z,
                p.orientation.x,
                p.orientation.y,
                p.orientation.z,
                p.orientation.w,
            )
            for p in poses
        ]
    )
    malformed = {}
    finite = np.isfinite(values).all(axis=1)
    for i in np.flatnonzero(~finite | ~values[:, 3:].any(axis=1)):
        what = "its quaternion is zero" if finite[i] else "a number is not finite"
        malformed[int(i)] = f"not a pose: {what}"
        values[i] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return pose.from_position_rotation(values[:, :3], rotation.from_quaternion(values[:, 3:])), malformed


def _as_pose(T: FloatArray) -> dict[str, Any]:
    x, y, z, w = rotation.as_quaternion(T[:3, :3])
    return {
        "position": dict(zip("xyz", T[:3, 3], strict=True)),
        "orientation": {"x": x, "y": y, "z": z, "w": w},
    }


def _above_zero(value: int) -> None:
    if value <= 0:
        raise ValueError(f"max_poses must be above 0, got {value}")
