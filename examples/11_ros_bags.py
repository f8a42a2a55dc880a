"""Record what an arm says, and read the bag into arrays."""

import tempfile
from pathlib import Path

import numpy as np

import pieper
from pieper.ros.bags import Bag, record
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.controller import Controller
from pieper.ros.topics import Topic
from pieper.sim.kinematic import KinematicSimulator

arm = pieper.load("ur5e")
network = FakeNetwork()  # a network in this process; pieper.ros.open_bus("recorder") joins the real one
node = Controller(network.bus("controller"), KinematicSimulator(arm.chain))
user = network.bus("user")

commands = user.publisher("set_joint_states", "sensor_msgs/msg/JointState")
commands.send(name=["shoulder_pan_joint"], position=[0.8])

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "move"  # an MCAP bag, as `ros2 bag` reads it
    counts = record(network.bus("recorder"), [Topic.parse("/joint_states")], path, seconds=0.5)
    print(f"recorded {counts['/joint_states']} joint states")

    with Bag(path) as bag:
        heard = list(bag.messages(["/joint_states"]))

t = np.array([m.time for m in heard]) * 1e-9
q = np.array([m.message.position for m in heard])
poses = arm.fk(q)  # all of them at once
print(f"{t[-1] - t[0]:.2f} s, shoulder from {q[0, 0]:.3f} to {q[-1, 0]:.3f} rad")
print(f"the tip went {np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum():.3f} m")
