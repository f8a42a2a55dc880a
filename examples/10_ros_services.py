"""Nodes that other nodes ask: a plan of poses through the IK service, carried out by the controller, on a network in this process."""

from typing import Any

import numpy as np

import pieper
from pieper.ros.actions import ActionClient
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.controller import Controller
from pieper.ros.nodes.ik_server import IkServer
from pieper.ros.nodes.rotations import Rotations
from pieper.sim.kinematic import KinematicSimulator

network = FakeNetwork()  # on a real network: with pieper.ros.open_bus("controller") as bus: ...; bus.spin()
arm = pieper.load("kuka_kr210_robond")
controller, server, rotations = (network.bus(name) for name in ("controller", "IK_server", "rotations"))
robot = KinematicSimulator(arm.chain)
Controller(controller, robot)
IkServer(server, arm)
Rotations(rotations)
user = network.bus("user")

print("Ten poses of the gripper, 2 cm apart")
plan = [{"position": {"x": 2.2 + 0.02 * i, "y": 0.9, "z": 0.81}} for i in range(10)]
points = user.call(user.client("calculate_ik", "pieper_interfaces/srv/CalculateIK"), 1.0, poses=plan).points
steps = np.abs(np.diff([point.positions for point in points], axis=0))
print("\n".join(f"  IK_server: {line}" for line in server.lines))
print(f"  largest step of a joint: {steps.max():.3f} rad")

print("\nFollowed by the controller")
trajectory = {
    "joint_names": list(arm.joint_names),
    "points": [
        {"positions": point.positions, "time_from_start": {"sec": 2, "nanosec": 100_000_000 * i}}
        for i, point in enumerate(points)
    ],
}
feedback: list[Any] = []
follow = ActionClient(user, "follow_joint_trajectory", "control_msgs/action/FollowJointTrajectory")
goal = follow.run({"trajectory": trajectory}, timeout=10.0, on_feedback=feedback.append)
print(f"  {goal.status.name}: {goal.result.error_string}, after {len(feedback)} messages of feedback")
print(f"  gripper at {arm.fk(robot.read().q)[:3, 3].round(6)} m")

print("\nRefused, and the arm stays where it is")
user.publisher("set_joint_states", "sensor_msgs/msg/JointState").send(name=["joint_1"], position=[4.0])
network.settle()
print(f"  {controller.lines[-1]}")

print("\nA quaternion of a quarter turn about z, not normalised")
client = user.client("quat2zyx", "pieper_interfaces/srv/QuatToZYX")
answer = user.call(client, 1.0, q={"x": 0.0, "y": 0.0, "z": 2.0, "w": 2.0})
print(f"  yaw {answer.z.data:.6f}, pitch {answer.y.data:.6f}, roll {answer.x.data:.6f} rad")
