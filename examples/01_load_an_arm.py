"""Load an arm, ask where its tip is, and find joint values that bring it elsewhere."""

import numpy as np

import pieper

arm = pieper.load("mh12")  # a built-in name; a URDF file or its text works as well
print(f"{arm.name}: {arm.dof} joints from {arm.base} to {arm.tip}")
for name, (lower, upper) in zip(arm.joint_names, np.degrees(arm.limits), strict=True):
    print(f"  {name}  {lower:7.1f} to {upper:6.1f} deg")

q = np.radians([10.0, -5.0, 20.0, 0.0, 30.0, 0.0])
T_base_tip = arm.fk(q)
print(f"\nat q = {np.degrees(q).round(1)} deg the tip is at {T_base_tip[:3, 3].round(4)} m")

T_wanted = T_base_tip.copy()
T_wanted[:3, 3] += [0.0, 0.1, -0.2]  # the same orientation, 10 cm to the left and 20 cm down
answers = arm.ik(T_wanted, seed=q)
q_new = answers.q[0]
print(f"\n10 cm to the left and 20 cm down: q = {np.degrees(q_new).round(3)} deg")
print(f"  {answers.reason}")

steps = np.linspace(q, q_new, 5)  # many configurations are one array
print("\non the way there, straight in the joints, the tip is at")
for p in arm.fk(steps)[:, :3, 3]:
    print(f"  {p.round(4)} m")
