"""ROS 2: a node on the robot's network, with a ROS installation or without one.

:func:`open_bus` joins the network; :mod:`pieper.ros.nodes` has the nodes.
"""

from pieper.ros.backends import open_bus
from pieper.ros.bus import Bus, Reply
from pieper.ros.qos import QoS

__all__ = ["Bus", "QoS", "Reply", "open_bus"]
