"""Joint values for a pose, a position, a tool axis; all answers and the nearest; and a target that is out of reach."""

import numpy as np

import pieper
from pieper.ik import select, target
from pieper.ik.solve import solve

arm = pieper.load("ur5e")
q_now = np.array([0.0, -1.0, 1.0, -1.5, -1.5, 0.0])
T_base_tip = arm.fk([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])

answers = arm.ik(T_base_tip, seed=q_now)
print("A pose, starting from where the arm is")
print(f"  q [rad]   {answers.q[0].round(6)}")
print(f"  {answers.reason}")

answers = arm.ik(T_base_tip, count=8)
print(f"\nIts other answers: {answers.count} found")
for q in answers.q[answers.valid]:
    print(f"  q [deg]   {np.rad2deg(q).round(2)}")
nearest = select.nearest(select.within_limits(answers, arm.chain), q_now)
print(f"  nearest to the arm [deg]   {np.rad2deg(nearest).round(2)}")

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
