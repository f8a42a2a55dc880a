"""Two nodes: a target goes in, the inverse node moves the joints, and the forward node tells where the tip is.

They meet on a network inside this process, whose clock the example turns. On the robot's network the same nodes are made on
``pieper.ros.open_bus("forward")`` and spun, or started with ``pieper ros forward mh12`` and ``pieper ros inverse mh12``.
"""

from typing import Any

import pieper
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.forward import Forward
from pieper.ros.nodes.inverse import Inverse

network = FakeNetwork()
arm = pieper.load("mh12")
forward = network.bus("poe_mh12_node")
inverse = network.bus("inverse_mh12_node", ["--ros-args", "-p", "rate:=50.0"])
Forward(forward, arm)
Inverse(inverse, arm)

user = network.bus("user")
poses: list[Any] = []
user.subscribe("pose", "geometry_msgs/msg/PoseStamped", poses.append)
target = user.publisher("target", "geometry_msgs/msg/Point")

target.send(x=0.3, y=0.3, z=0.3)
network.advance(1.5)
target.send(x=9.0, y=0.0, z=0.0)  # no arm of this size gets there
network.advance(0.1)

print("inverse node")
for line in inverse.lines:
    print(f"  {line}")
print("forward node")
for line in forward.lines:
    print(f"  {line}")
print(f"{len(poses)} poses, from and to [m]")
for pose in (poses[0], poses[-1]):
    p = pose.pose.position
    print(f"  {p.x:.9f} {p.y:.9f} {p.z:.9f}")
