"""ROS 2 without ROS: a node's topics and services over DDS by itself, on Eclipse Cyclone DDS.

To real ROS 2 nodes, a process on this backend is one of them: the same names, types, bytes and quality of service, and it
is in their graph. Services are those of ``rmw_cyclonedds``; ``rmw_fastrtps`` identifies requests in another way, and
neither of them understands the other's services.
"""

from importlib.util import find_spec

from pieper.errors import MissingExtraError

if _missing := [package for package in ("cyclonedds", "rosbags") if find_spec(package) is None]:
    raise MissingExtraError(_missing[0], "ros", "a ROS 2 node without ROS")

from pieper.ros.bare.wire import DdsWire

__all__ = ["DdsWire"]
