"""A move within velocity and acceleration limits, and a simulated arm that makes it, stops, and refuses what it must not do."""

import numpy as np

import pieper
from pieper.errors import MotionError
from pieper.motion.joint_move import joint_move
from pieper.sim.kinematic import KinematicSimulator

mh12 = pieper.load("mh12")
q_start = np.zeros(6)
goal = mh12.ik(mh12.fk([0.6, 0.3, -0.2, 0.5, -0.8, 1.0]), seed=q_start)
move = joint_move(mh12.chain, q_start, goal.q[0], max_velocity=1.0, max_acceleration=3.0)
print(f"MH12 to {goal.q[0].round(3)} rad in {move.duration:.3f} s")

robot = KinematicSimulator(mh12.chain, q=q_start)
robot.follow(move)
print("  time [s]   fastest joint [rad/s]   tip [m]")
while robot.is_moving:
    state = robot.step(0.25)
    print(f"  {state.time:8.2f}   {np.abs(state.dq).max():21.3f}   {mh12.fk(state.q)[:3, 3].round(4)}")
print(f"  left to the goal: {np.abs(robot.read().q - goal.q[0]).max():.1g} rad")

print("\nBack again, stopped on the way")
robot.command(q_start)
robot.step(0.05)
robot.stop()
stopped = robot.read()
assert np.array_equal(robot.step(1.0).q, stopped.q)
print(f"  rests at {stopped.q.round(3)} rad")

print("\nRefused, and the arm stays as it was")
try:
    robot.command({"joint_1_s": 3.2})
except MotionError as reason:
    print(f"  {reason}")
