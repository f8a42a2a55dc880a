"""What the tests of nodes have in common: somebody on the network who sends, listens and reads the log."""

from __future__ import annotations

from typing import Any

import numpy as np

from pieper.ros.qos import ROSOUT, QoS
from tests.ros.networks import Network

JOINT_STATE = "sensor_msgs/msg/JointState"
POINT = "geometry_msgs/msg/Point"
POSE = "geometry_msgs/msg/PoseStamped"

MANY = QoS(depth=2000)


class User:
    """Somebody else on the network."""

    def __init__(self, network: Network, name: str = "user", *arguments: str) -> None:
        self.network = network
        self.bus = network.join(name, *arguments)
        self._log: list[Any] = []
        self._publishers: dict[str, Any] = {}
        self.bus.subscribe("/rosout", "rcl_interfaces/msg/Log", self._log.append, qos=ROSOUT)

    def log(self, node: str) -> list[str]:
        """What a node has logged, but for the line that names the backend."""
        self.network.rest(0.02)
        return [m.msg for m in self._log if m.name == node and "ROS 2 network" not in m.msg]

    def hears(self, topic: str, type_name: str, qos: QoS = MANY) -> list[Any]:
        """Every message of a topic from now on."""
        heard: list[Any] = []
        subscription = self.bus.subscribe(topic, type_name, heard.append, qos=qos)
        assert self.network.until(lambda: subscription.publishers > 0), topic
        return heard

    def sends(self, topic: str, type_name: str, **fields: Any) -> None:
        """Send once somebody is there to hear it."""
        if topic not in self._publishers:
            self._publishers[topic] = self.bus.publisher(topic, type_name, qos=MANY)
            assert self.network.until(lambda: self._publishers[topic].subscribers > 0), topic
        self._publishers[topic].send(**fields)

    def joint_states(self, names: Any, position: Any, **fields: Any) -> None:
        self.sends("joint_states", JOINT_STATE, name=list(names), position=position, **fields)

    def target(self, x: float, y: float, z: float) -> None:
        self.sends("target", POINT, x=float(x), y=float(y), z=float(z))

    def target_pose(self, T: np.ndarray, frame_id: str = "", factor: float = 1.0) -> None:
        from pieper.spatial.rotation import as_quaternion

        q = factor * as_quaternion(T[:3, :3])
        self.sends(
            "target_pose",
            POSE,
            header={"frame_id": frame_id},
            pose={
                "position": dict(zip("xyz", T[:3, 3], strict=True)),
                "orientation": dict(zip("xyzw", q, strict=True)),
            },
        )


def as_matrix(pose: Any) -> np.ndarray:
    """(4, 4) matrix of a Pose or a Transform."""
    from pieper.spatial.rotation import from_quaternion

    p, q = (pose.position, pose.orientation) if hasattr(pose, "position") else (pose.translation, pose.rotation)
    T = np.eye(4)
    T[:3, :3] = from_quaternion([q.x, q.y, q.z, q.w])
    T[:3, 3] = p.x, p.y, p.z
    return T


def frames_of(messages: list[Any]) -> dict[str, tuple[str, np.ndarray]]:
    """The newest transform of each child frame: its parent, and its pose there."""
    return {t.child_frame_id: (t.header.frame_id, as_matrix(t.transform)) for m in messages for t in m.transforms}


def pose_in(frames: dict[str, tuple[str, np.ndarray]], child: str, base: str) -> np.ndarray:
    """Pose of a frame in another one above it, as tf2 finds it."""
    T = np.eye(4)
    while child != base:
        child, T_parent_child = frames[child]
        T = T_parent_child @ T
    return T
