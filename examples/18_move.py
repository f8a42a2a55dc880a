"""A path of lines and an arc, joint values along it on one branch, a motion within every limit, and a stream that follows the hand."""

import numpy as np

import pieper
from pieper.motion import files
from pieper.motion.limits import JointLimits
from pieper.motion.path import arc_through, join, line
from pieper.motion.path_ik import follow_path
from pieper.motion.servo import Servo
from pieper.motion.timing import TcpLimits, time_path, usage

ur5e = pieper.load("ur5e")
q_start = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
limits = {"max_velocity": 2.0, "max_acceleration": 8.0, "max_jerk": 80.0}


def beside(T: np.ndarray, *by: float) -> np.ndarray:
    """The same orientation, somewhat beside [m]."""
    moved = T.copy()
    moved[:3, 3] += by
    return moved


A = ur5e.fk(q_start)
B = beside(A, 0.1, -0.2, 0.0)
C = beside(B, 0.0, -0.1, 0.1)
path = join([line(A, B), arc_through(B, beside(B, 0.05, -0.07, 0.05)[:3, 3], C)], blend=0.04)
way = follow_path(ur5e.chain, path, q_start=q_start)
print(f"{path.length:.3f} m, {len(way.q)} poses, on the branch {way.branch[0]!r}")

tip = TcpLimits(velocity=0.25)
move = time_path(way, tcp=tip, **limits)
used = usage(move, JointLimits.of(ur5e.chain, **limits), tip)
print(f"{move.duration:.3f} s; used: " + ", ".join(f"{name} {share:.0%}" for name, share in used._asdict().items()))
files.write(move.at_rate(250.0), "move.csv")

print("\nOut of reach on the way, and told where")
print(f"  {follow_path(ur5e.chain, line(A, beside(A, 0.9, -0.3, 0.1)), q_start=q_start).broken}")

print("\nStreaming: down at 5 cm/s for a second, then stop")
servo = Servo(ur5e, q=q_start, rate=500.0)
for _ in range(500):
    q, dq = servo.step(np.array([0.0, 0.0, -0.05, 0.0, 0.0, 0.0]))
servo.stop()
while not servo.at_rest:
    q, dq = servo.step()
print(f"  the tip went {(ur5e.fk(q) - A)[:3, 3].round(4)} m and rests")
