"""``tracker``: what a camera tells of robots, balls and markers, as poses and frames.

The node is handed what was tracked, one frame after another, by whoever tracks; it knows nothing of images.
"""

from __future__ import annotations

import re
from collections import deque
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pieper.errors import RosError
from pieper.ros.nodes.complaints import Complaints
from pieper.ros.nodes.transforms import TF_MESSAGE, TransformMessage
from pieper.ros.qos import LATCHED, TF

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.ros.bus import Bus, Publisher

POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POINT = "geometry_msgs/msg/PointStamped"
POSES = "geometry_msgs/msg/PoseArray"
STRING = "std_msgs/msg/String"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

_LOOK_EVERY = 0.004  # seconds between looks at what was handed over
_REPORT_EVERY = 1.0
_WAITING = 16  # steps; who tracks is not held up by the network, and what is old is dropped first
_DAY = 86400.0
_FLAT = 1e-9  # variance of what a thing on a plane cannot do [m^2, rad^2]
_ANY_HEADING = float(np.pi**2 / 3.0)  # variance of a heading of which nothing is known
_OK, _WARN = 0, 1


class Tracked(Protocol):
    """An object at one time; an ``Estimate`` of the perception is one."""

    @property
    def track(self) -> int:
        """Number of the track."""
        ...

    @property
    def kind(self) -> str:
        """``"robot"``, ``"ball"`` or ``"marker"``."""
        ...

    @property
    def name(self) -> str | None:
        """Which one."""
        ...

    @property
    def position(self) -> Any:
        """``(2,)`` [m]."""
        ...

    @property
    def heading(self) -> float | None:
        """[rad]."""
        ...

    @property
    def covariance(self) -> Any:
        """``(4, 4)`` of x, y and their rates, or ``(6, 6)`` of x, y, heading and their rates."""
        ...

    @property
    def state(self) -> str:
        """``"seen"``, ``"hidden"`` or ``"lost"``."""
        ...

    @property
    def unseen(self) -> float:
        """Seconds since the last sight of it."""
        ...


class Tracker:
    """Publishes what is tracked.

    For each robot ``robot_NAME/pose``, ``robot_NAME/pose_with_covariance`` and a frame ``robot_NAME`` on ``/tf``; ``ball``; for lone markers all of a
    colour on ``markers_COLOR``; the names of what is tracked on ``tracked``, latched; ``/diagnostics`` every second. What is hidden is published where
    it should be, with the covariance of that, until it is given up.

    Parameters of the node: ``frame`` (parent of all poses, ``field`` by default), ``publish_tf``, ``publish_hidden`` (false: only what the last
    image showed).

    Parameters
    ----------
    bus : Bus
        The network.
    unit : str
        Of positions: ``"m"``, or ``"px"``, which is said to the log, because ROS has metres.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> node, heard = Tracker(network.bus("tracker")), []
    >>> user = network.bus("user")
    >>> blue = SimpleNamespace(track=1, kind="robot", name="blue", position=np.array([0.5, 0.25]), heading=np.pi, covariance=np.eye(6),
    ...                        state="seen", unseen=0.0)
    >>> node.put(0.0, [blue])
    >>> network.advance(0.01)
    >>> listening = user.subscribe("robot_blue/pose", POSE, heard.append)
    >>> node.put(0.02, [blue])
    >>> network.advance(0.01)
    >>> heard[0].header.frame_id, heard[0].pose.position.x, round(heard[0].pose.orientation.z, 6)
    ('field', 0.5, 1.0)
    """

    def __init__(self, bus: Bus, *, unit: str = "m") -> None:
        self._bus = bus
        self._complaints = Complaints(bus)
        self._frame = bus.parameter("frame", "field", description="frame of all poses", read_only=True)
        self._publish_tf = bus.parameter(
            "publish_tf", True, description="send a frame for each robot to /tf", read_only=True
        )
        self._publish_hidden = bus.parameter(
            "publish_hidden", True, description="also what is predicted because nothing shows it"
        )
        self._waiting: deque[tuple[float, tuple[Tracked, ...]]] = deque(maxlen=_WAITING)
        self._publishers: dict[str, Publisher] = {}
        self._offset: float | None = None
        self._last = -np.inf
        self._names: str | None = None
        self._latest: tuple[Tracked, ...] = ()
        self._frames = 0
        self._tf = bus.publisher("/tf", TF_MESSAGE, qos=TF) if self._publish_tf.value else None
        self._tracked = bus.publisher("tracked", STRING, qos=LATCHED)
        self._diagnostics = bus.publisher("/diagnostics", DIAGNOSTICS)
        if unit != "m":
            bus.log("warn", "positions are pixels, and not metres; calibrate the field: pieper calibrate-field")
        bus.timer(_LOOK_EVERY, self.send)
        bus.timer(_REPORT_EVERY, self._report)

    def put(self, time: float, tracked: Sequence[Tracked]) -> None:
        """Hand over what was found in one frame; from any thread.

        Parameters
        ----------
        time : float
            Of its capture [s]: since 1970, or on any other clock, whose first time is then that of its arrival.
        tracked : sequence of Tracked
        """
        self._waiting.append((float(time), tuple(tracked)))

    @property
    def waiting(self) -> int:
        """Frames that were handed over and are not yet sent."""
        return len(self._waiting)

    def send(self) -> None:
        """Publish what was handed over; the bus does it by itself while it spins."""
        while self._waiting:
            time, tracked = self._waiting.popleft()
            self._send(self._stamp(time), tracked)

    def _send(self, stamp: dict[str, int], tracked: tuple[Tracked, ...]) -> None:
        self._frames += 1
        header = {"stamp": stamp, "frame_id": self._frame.value}
        hidden = self._publish_hidden.value
        alive = tuple(t for t in tracked if t.state == "seen" or (hidden and t.state == "hidden"))
        sound = tuple(t for t in alive if np.isfinite(t.position).all())
        if len(sound) < len(alive):
            self._complaints.say("warn", "not sent: a position that is not a finite number")
        self._latest = sound
        robots = [t for t in sound if t.kind == "robot"]
        for robot in robots:
            self._send_robot(header, robot)
        for ball in (t for t in sound if t.kind == "ball"):
            x, y = (float(v) for v in ball.position)
            self._publisher("ball", POINT).send(header=header, point={"x": x, "y": y, "z": 0.0})
        self._send_markers(header, [t for t in sound if t.kind not in ("robot", "ball")])
        if self._tf is not None and robots:
            message = TransformMessage([(self._frame.value, link_name(t)) for t in robots])
            positions = np.array([[*t.position, 0.0] for t in robots], dtype=np.float64)
            quaternions = np.array([list(_quaternion(t.heading).values()) for t in robots])
            self._tf.send(message.fill(stamp["sec"], stamp["nanosec"], positions, quaternions))
        names = " ".join(sorted(link_name(t) for t in sound))
        if names != self._names:
            self._names = names
            self._tracked.send(data=names)

    def _send_robot(self, header: dict[str, Any], robot: Tracked) -> None:
        name = link_name(robot)
        x, y = (float(v) for v in robot.position)
        pose = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": _quaternion(robot.heading)}
        self._publisher(f"{name}/pose", POSE).send(header=header, pose=pose)
        covariance = np.diag([0.0, 0.0, _FLAT, _FLAT, _FLAT, _ANY_HEADING])
        P = np.asarray(robot.covariance, dtype=np.float64)
        rows = [0, 1] if robot.heading is None else [0, 1, 5]
        covariance[np.ix_(rows, rows)] = P[: len(rows), : len(rows)]
        self._publisher(f"{name}/pose_with_covariance", POSE_WITH_COVARIANCE).send(
            header=header, pose={"pose": pose, "covariance": covariance.reshape(-1)}
        )

    def _send_markers(self, header: dict[str, Any], markers: list[Tracked]) -> None:
        colors: dict[str, list[Any]] = {}
        for marker in markers:
            x, y = (float(v) for v in marker.position)
            colors.setdefault(_word(marker.name or "unnamed"), []).append({"position": {"x": x, "y": y, "z": 0.0}})
        for color, poses in colors.items():
            self._publisher(f"markers_{color}", POSES).send(header=header, poses=poses)

    def _publisher(self, topic: str, type_name: str) -> Publisher:
        if topic not in self._publishers:
            self._publishers[topic] = self._bus.publisher(topic, type_name)
        return self._publishers[topic]

    def _stamp(self, time: float) -> dict[str, int]:
        """The time of capture on the clock of the bus; a clock of its own is tied to that when it starts, and when it goes back."""
        if not np.isfinite(time):
            raise RosError(f"the time of a frame must be a finite number of seconds, got {time}")
        now = self._bus.now() * 1e-9
        if self._offset is None or time < self._last:
            self._offset = 0.0 if abs(now - time) < _DAY else now - time
        self._last = time
        nanoseconds = max(round((time + self._offset) * 1e9), 0)
        return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}

    def _report(self) -> None:
        """Frames a second, and what became of each object."""
        status = [
            {
                "level": _OK if self._frames else _WARN,
                "name": f"{self._bus.node}: frames",
                "message": f"{self._frames / _REPORT_EVERY:.0f} frames a second",
            }
        ]
        self._frames = 0
        for t in self._latest:
            seen = t.state == "seen"
            status.append(
                {
                    "level": _OK if seen else _WARN,
                    "name": f"{self._bus.node}: {link_name(t)}",
                    "message": "seen" if seen else f"hidden for {t.unseen:.2f} s",
                }
            )
        self._diagnostics.send(header={"stamp": self._bus.stamp()}, status=status)


def link_name(tracked: Tracked) -> str:
    """Name of the frame of an object, and of its topics.

    >>> from types import SimpleNamespace
    >>> link_name(SimpleNamespace(kind="robot", name="yellow-3", track=7))
    'robot_yellow_3'
    >>> link_name(SimpleNamespace(kind="robot", name=None, track=7))
    'robot_track_7'
    """
    if tracked.kind == "ball":
        return "ball"
    return f"{_word(tracked.kind)}_{_word(tracked.name or f'track_{tracked.track}')}"


def _word(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") or "unnamed"


def _quaternion(heading: float | None) -> dict[str, float]:
    """About the axis up."""
    half = 0.5 * (heading or 0.0)
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(half)), "w": float(np.cos(half))}


def feed(node: Tracker, steps: Any, *, sleep: Callable[[float], object] | None = None) -> int:
    """Hand over steps that have a ``time`` and ``estimates``, and return how many.

    Parameters
    ----------
    node : Tracker
    steps : iterable
        Such as of `pieper.perception.pipeline.Step`.
    sleep : callable, optional
        Called after each step with its time, to keep the pace of a recording.
    """
    count = 0
    for step in steps:
        node.put(step.time, step.estimates)
        count += 1
        if sleep is not None:
            sleep(step.time)
    return count
