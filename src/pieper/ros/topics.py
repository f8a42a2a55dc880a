"""Topics by their conventional names: type and quality of service, so that nobody has to type them.

A topic that is not here is named with its type: ``/poses:geometry_msgs/msg/PoseArray``, and, where it is not reliable and
volatile as topics are by default, with its quality of service: ``/camera:sensor_msgs/msg/Image:sensor``.
"""

from __future__ import annotations

from dataclasses import dataclass

from pieper.errors import RosError
from pieper.ros.qos import CLOCK, DEFAULT, LATCHED, PARAMETER_EVENTS, ROSOUT, SENSOR, TF, QoS

QUALITIES = {"default": DEFAULT, "latched": LATCHED, "sensor": SENSOR}

_KNOWN: dict[str, tuple[str, QoS]] = {
    "joint_states": ("sensor_msgs/msg/JointState", DEFAULT),
    "set_joint_states": ("sensor_msgs/msg/JointState", DEFAULT),
    "joint_trajectory": ("trajectory_msgs/msg/JointTrajectory", DEFAULT),
    "target": ("geometry_msgs/msg/Point", DEFAULT),
    "target_pose": ("geometry_msgs/msg/PoseStamped", DEFAULT),
    "pose": ("geometry_msgs/msg/PoseStamped", DEFAULT),
    "robot_description": ("std_msgs/msg/String", LATCHED),
    "robot_description_latch": ("std_msgs/msg/String", LATCHED),
    "/tf": ("tf2_msgs/msg/TFMessage", TF),
    "/tf_static": ("tf2_msgs/msg/TFMessage", QoS(transient_local=True, depth=100)),
    "/clock": ("rosgraph_msgs/msg/Clock", CLOCK),
    "/rosout": ("rcl_interfaces/msg/Log", ROSOUT),
    "/parameter_events": ("rcl_interfaces/msg/ParameterEvent", PARAMETER_EVENTS),
}


@dataclass(frozen=True)
class Topic:
    """A topic, what it carries, and how.

    Attributes
    ----------
    name, type : str
        For example ``"/joint_states"`` and ``"sensor_msgs/msg/JointState"``.
    qos : QoS
        Quality of service.
    """

    name: str
    type: str
    qos: QoS = DEFAULT

    @classmethod
    def parse(cls, text: str) -> Topic:
        """Read ``NAME``, ``NAME:TYPE`` or ``NAME:TYPE:QUALITY``.

        Raises
        ------
        RosError
            The type is not given and not known from the name, or there is no such quality.

        Examples
        --------
        >>> Topic.parse("/cell2/joint_states").type
        'sensor_msgs/msg/JointState'
        >>> Topic.parse("/camera:sensor_msgs/msg/Image:sensor").qos.reliable
        False
        """
        name, _, rest = text.partition(":")
        type_name, _, quality = rest.partition(":")
        if quality and quality not in QUALITIES:
            raise RosError(f"{text!r}: no quality of service {quality!r}; there are: {', '.join(QUALITIES)}")
        usual_type, usual_qos = usual(name) or ("", DEFAULT)
        if not (type_name or usual_type):
            raise RosError(
                f"the type of topic {name!r} is not known; write it behind the name: {name}:geometry_msgs/msg/Point"
            )
        return cls(name, type_name or usual_type, QUALITIES[quality] if quality else usual_qos)


def usual(name: str) -> tuple[str, QoS] | None:
    """Type and quality of service that topics of this name have; None where the name says nothing.

    Examples
    --------
    >>> usual("/cell2/target")[0], usual("/weather")
    ('geometry_msgs/msg/Point', None)
    """
    full = name if name.startswith("/") else f"/{name}"
    return _KNOWN.get(full) or _KNOWN.get(full.rpartition("/")[2])
