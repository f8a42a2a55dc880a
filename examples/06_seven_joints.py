"""Seven joints at a pose: every solution for values of one joint, the curves of all solutions, and the nearest one."""

import numpy as np

import pieper
from pieper.ik.redundancy import nearest_on_self_motion, prepare, self_motion, solve_redundant, track_branches
from pieper.ik.swivel import swivel_of

arm = pieper.load("franka_panda").chain
q_now = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7])
T_base_tip = pieper.load("franka_panda").fk([0.4, -0.3, 0.1, -2.1, 0.2, 1.9, 0.5])

print("How the arm is solved")
print(f"  {prepare(arm).reason}")

answers = solve_redundant(arm, T_base_tip, values=0.5)
print(f"\nWith joint 7 at 0.5 rad: {answers.valid.sum()} solutions")
for q in answers.q[answers.valid]:
    print(f"  q [rad]   {q.round(3)}")

answers = solve_redundant(arm, T_base_tip)
print(
    f"\nFor 16 values of joint 7: {answers.valid.sum()} solutions, largest error {np.nanmax(answers.position_error):.1e} m"
)

curves = self_motion(arm, T_base_tip)
print(f"\nAll solutions are on {len(curves)} closed curves")
for curve in curves:
    inside = ", ".join(f"{start:.3f} to {end:.3f}" for start, end in curve.intervals) or "nowhere"
    print(f"  length {curve.length:6.3f} rad, within the joint limits: {inside}")

branch = track_branches(answers, curves)
print(f"\nThe sampled solutions belong to {branch.max() + 1} branches between folds")

point = nearest_on_self_motion(arm, T_base_tip, q_now)
print("\nThe solution nearest to where the arm is, within its limits")
print(f"  q [rad]   {point.q.round(6)}")
print(f"  {point.distance:.6f} rad away; the nearest of the 16 samples is ", end="")
within = answers.valid & ((answers.q >= arm.limits[:, 0]) & (answers.q <= arm.limits[:, 1])).all(axis=-1)
print(f"{np.linalg.norm(answers.q[within] - q_now, axis=-1).min():.6f} rad away")

iiwa = pieper.load("kuka_iiwa14").chain
T_base_tip = pieper.load("kuka_iiwa14").fk([0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
answers = solve_redundant(iiwa, T_base_tip, values={"swivel": 0.3})
print(f"\nAn iiwa with its elbow at a swivel angle of 0.3 rad: {answers.valid.sum()} solutions")
print(f"  swivel angle of each [rad]   {swivel_of(iiwa, answers.q[answers.valid]).round(6)}")
