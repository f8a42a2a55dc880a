"""``forward``: joint states in, the pose of the arm and the frames of its links out.

It does what the forward nodes of two course reports do: the one on the MH12 (node ``poe_mh12_node``, whose lines of log it
writes) and the one on the youBot (frames ``arm5b_link_i`` and ``arm5d_link_i``). Unlike those it matches joints by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import PieperError, RosError
from pieper.ros import messages
from pieper.ros.nodes.checks import between, seconds
from pieper.ros.nodes.complaints import Complaints
from pieper.ros.nodes.joint_states import JOINT_STATE, JointStates
from pieper.ros.nodes.transforms import TF_MESSAGE, DhFrames, TransformMessage, link_frames
from pieper.ros.qos import LATCHED, TF, QoS
from pieper.spatial.quaternion import quaternion_from_matrix
from pieper.spatial.rotation import as_quaternion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.ros.bus import Bus

    FloatArray = NDArray[np.float64]

POSE = "geometry_msgs/msg/PoseStamped"

_LOOK_EVERY = 0.1  # seconds between looks at what is to be printed and at who else publishes


def node_name(arm: Arm) -> str:
    """Name of the node for an arm: that of the reports for theirs.

    >>> import pieper
    >>> [node_name(pieper.load(name)) for name in ("mh12", "youbot", "ur5e")]
    ['poe_mh12_node', 'forward_kinematic_node', 'forward']
    """
    names = {"yaskawa_mh12": "poe_mh12_node", "mh12-report": "poe_mh12_node", "kuka_youbot": "forward_kinematic_node"}
    return names.get(arm.name, "forward")


class Forward:
    r"""Publishes where an arm is, from its joint states.

    Subscribes ``joint_states``; publishes ``pose`` in the base frame with the stamp of the joint states (of the arrival where that
    is 0), every moving link on ``/tf`` and every fixed one on ``/tf_static``, latched, with the names of the description.
    A message that cannot be used changes nothing; the reason goes to the log, at most once a second.

    Parameters of the node: ``frame`` (link whose pose is given, by default the tip), ``print_every`` (a pose that has changed
    is printed at most once in so many seconds; 0: at every message, as the reports do), ``publish_tf``, ``queue``, ``reliable`` (false: best-effort
    publishers of joint states are heard, too).

    Parameters
    ----------
    bus : Bus
        The network.
    arm : Arm
        The arm whose joints are looked for in the joint states.

    Examples
    --------
    >>> import pieper
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> arm, bus = pieper.load("mh12"), network.bus("poe_mh12_node")
    >>> node = Forward(bus, arm)
    >>> sender = network.bus("sender")
    >>> sender.publisher("joint_states", JOINT_STATE).send(name=list(arm.joint_names), position=[0.0] * 6)
    >>> network.advance(0.2)
    >>> print(*bus.lines, sep="\n")
    Nodo PoE RRR iniciado. Suscrito a: /joint_states
    Posición: x=0.895000, y=0.000000, z=1.264000
    Cuaternión: x=0.707107 y=0.000000 z=0.707107 w=0.000000
    """

    def __init__(self, bus: Bus, arm: Arm) -> None:
        self._bus, self._arm = bus, arm
        self._joints = JointStates(arm.chain)
        self._complaints = Complaints(bus)
        self._frame = bus.parameter(
            "frame", arm.tip, description="link whose pose is published and printed", check=self._check_frame
        )
        self._print_every = bus.parameter(
            "print_every",
            1.0,
            description="print a changed pose at most once in so many seconds; 0: at every message",
            check=seconds,
        )
        self._publish_tf = bus.parameter(
            "publish_tf", True, description="send the frames of the links to /tf and /tf_static", read_only=True
        )
        queue = bus.parameter(
            "queue",
            10,
            description="joint states that wait while the node is busy; more push out the oldest",
            check=between(1, 10_000),
            read_only=True,
        )
        reliable = bus.parameter(
            "reliable",
            True,
            description="false: hear best-effort publishers of joint states, too; what is lost is not sent again then",
            read_only=True,
        )
        self._pose = messages.make(POSE, header={"frame_id": arm.base})
        self._pose_publisher = bus.publisher("pose", POSE)
        self._to_print: tuple[FloatArray, FloatArray] | None = None
        self._printed: tuple[str, str] | None = None
        self._printed_at = -(2**63)
        self._crowded = False
        self._links = link_frames(arm)
        self._dh = DhFrames(arm)
        self._named: list[str] | None = None
        self._transforms = TransformMessage([])
        if self._publish_tf.value:
            self._tf = bus.publisher("/tf", TF_MESSAGE, qos=TF)
            self._tf_static = bus.publisher("/tf_static", TF_MESSAGE, qos=LATCHED)
            self._send_fixed()
        self._joint_states = bus.subscribe(
            "joint_states", JOINT_STATE, self._on_joint_states, qos=QoS(reliable=reliable.value, depth=queue.value)
        )
        bus.timer(_LOOK_EVERY, self._look)
        bus.log("info", f"Nodo PoE RRR iniciado. Suscrito a: {self._joint_states.topic}")

    def _on_joint_states(self, message: Any) -> None:
        frame = self._frame.value
        try:
            q = self._joints.read(message)
        except RosError as error:
            self._complaints.say("warn", str(error))
            return
        try:
            T = self._arm.fk(q) if frame == self._arm.tip else self._arm.fk(q, up_to=frame)
        except PieperError as error:
            self._complaints.say("error", f"Error al evaluar fk_func: {error}")
            return
        try:
            quaternion = quaternion_from_matrix(T[:3, :3])
        except PieperError as error:
            self._complaints.say("error", f"Error al convertir matriz a cuaternión: {error}")
            return
        stamp = message.header.stamp
        if not (stamp.sec or stamp.nanosec):
            stamp.sec, stamp.nanosec = self._bus.stamp().values()
        self._send_pose(stamp, T[:3, 3], quaternion)
        if self._publish_tf.value and self._tf.subscribers:
            self._send_moving(stamp, message, q)
        self._to_print = T[:3, 3], quaternion
        if self._print_every.value == 0.0:
            self._print()

    def _send_pose(self, stamp: Any, position: FloatArray, quaternion: FloatArray) -> None:
        message = self._pose
        message.header.stamp = stamp
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = position.tolist()
        q.x, q.y, q.z, q.w = quaternion.tolist()
        self._pose_publisher.send(message)

    def _send_moving(self, stamp: Any, message: Any, q: FloatArray) -> None:
        if self._named is None or message.name != self._named:
            self._named = list(message.name)
            moving = self._links.name(self._named or self._joints.names) if self._links else []
            self._transforms = TransformMessage(moving + self._dh.frames)
        parts = []
        if self._links:
            if not np.isfinite(message.position).all():
                self._complaints.say(
                    "warn", "no transforms sent: a joint that is not of the arm has no finite position"
                )
                return
            parts.append(self._links.at(message.position))
        if self._dh.frames:
            parts.append(self._dh.at(q))
        if parts:
            positions, quaternions = (np.concatenate(part) for part in zip(*parts, strict=True))
            self._tf.send(self._transforms.fill(stamp.sec, stamp.nanosec, positions, quaternions))

    def _send_fixed(self) -> None:
        fixed = self._links.fixed if self._links else []
        if fixed:
            Ts = np.array([T for _, _, T in fixed])
            message = TransformMessage([(parent, child) for parent, child, _ in fixed])
            stamp = self._bus.stamp()
            self._tf_static.send(
                message.fill(stamp["sec"], stamp["nanosec"], Ts[:, :3, 3], as_quaternion(Ts[:, :3, :3]))
            )

    def _look(self) -> None:
        if not 0 <= self._bus.now() - self._printed_at < self._print_every.value * 1e9:
            self._print(only_if_changed=True)
        others = self._joint_states.publishers
        if others > 1 and not self._crowded:
            self._bus.log(
                "warn",
                f"{others} nodes publish {self._joint_states.topic}: the pose jumps between what they say; stop all but one",
            )
        self._crowded = others > 1

    def _print(self, *, only_if_changed: bool = False) -> None:
        if self._to_print is None:
            return
        (x, y, z), (qx, qy, qz, qw) = (np.round(part, 6) + 0.0 for part in self._to_print)
        self._to_print = None
        lines = (
            f"Posición: x={x:.6f}, y={y:.6f}, z={z:.6f}",
            f"Cuaternión: x={qx:.6f} y={qy:.6f} z={qz:.6f} w={qw:.6f}",
        )
        if only_if_changed and lines == self._printed:
            return
        self._printed, self._printed_at = lines, self._bus.now()
        for line in lines:
            self._bus.log("info", line)

    def _check_frame(self, name: str) -> None:
        if name not in self._arm.frame_names:
            raise ValueError(f"no frame {name!r} of {self._arm.name!r}; frames are: {', '.join(self._arm.frame_names)}")
