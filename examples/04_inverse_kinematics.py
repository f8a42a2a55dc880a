"""Joint values for a pose, a position, a tool axis; all answers and the nearest; and a target that is out of reach."""

import numpy as np

import pieper
from pieper.ik import select, target
from pieper.ik.solve import solve

arm = pieper.load("ur5e")
q_now = np.array([0.0, -1.0, 1.0, -1.5, -1.5, 0.0])
T_base_tip = arm.fk([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])

answers = arm.ik(T_base_tip, seed=q_now)
print("A pose: every answer, the nearest to where the arm is first")
print(f"  {arm.ik_info.structure}")
for q, label, margin in zip(answers.q, answers.labels, answers.limit_margin, strict=True):
    print(f"  {np.rad2deg(q).round(1)!s:50} deg   {label:26} {np.rad2deg(margin):5.1f} deg from the limits")
print(f"  {answers.reason}")

up = select.by_branch(answers, "front, elbow up")
print(f"  of these, front and elbow up: {up.count}")

print("\nLess than a pose")
p = T_base_tip[:3, 3]
wanted = {
    "position only": target.ignore_orientation(p),
    "position, tool axis down": target.position_and_axis(p, [0.0, 0.0, -1.0]),
    "height, and not tilted": target.components(T_base_tip, "z rx ry"),
}
for name, what in wanted.items():
    q = solve(arm.chain, what, seed=q_now).q[0]
    T = arm.fk(q)
    print(f"  {name:25} tip at {T[:3, 3].round(3)} m, tool axis {T[:3, 2].round(3) + 0.0}")

print("\nOut of reach")
far = T_base_tip.copy()
far[:3, 3] = [1.2, 0.0, 0.3]
answers = arm.ik(far)
print(f"  {answers.reason}")
print(f"  nearest q [rad]   {answers.nearest.q.round(4)}")
light = solve(arm.chain, target.weight_orientation(far, 0.01))
print(f"  orientation weighs 0.01 m/rad: {light.reason}")
