"""The pseudo-inverse iteration of two course reports: MH12 to (0.3, 0.3, 0.3), and a UR5e with three gains."""

import numpy as np

import pieper
from pieper.ik.iteration import iterate, run

mh12 = pieper.load("mh12-report").chain
steps = list(
    iterate(mh12, [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=255, target_offset=(0.0003, 0.0003, 0.0004))
)
print("MH12, five screws, 255 steps of 0.06 * pinv(J) @ e from zeros")
print("  step   error [m]")
for line in (1, 50, 100, 150, 200, 255):
    print(f"  {line:4d}   {steps[line - 1].norm:.3g}")
print(f"  joints [rad]     {steps[-1].q.round(6)}")
print(f"  position [m]     {steps[-1].T[:3, 3].round(6)} (the report shifts its targets)")

exact = pieper.load("mh12", nominal=True).lock(joint_4_r=0.0).chain
last = run(exact, [0.3, 0.3, 0.3], np.zeros(5), alpha=0.06, iterations=255)
print(f"  with exact constants and no shift {last.norm:.2g} m are left")

ur5e = pieper.load("ur5e").chain
q_start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
goal = np.array([0.50, -0.60, 0.20])
print("\nUR5e to (0.50, -0.60, 0.20) m until 1 mm is left, orientation held")
print("  k1     steps   off the straight line [m]   turned [rad]")
for k1 in (1.0, 0.1, 0.01):
    path = list(iterate(ur5e, goal, q_start, orientation="hold", k1=k1, position_stop=1e-3))
    points = np.array([step.T[:3, 3] for step in path])
    along = (goal - points[0]) / np.linalg.norm(goal - points[0])
    across = points - points[0] - np.outer((points - points[0]) @ along, along)
    R = path[0].T[:3, :3].T @ path[-1].T[:3, :3]
    turned = np.arccos(min(1.0, (np.trace(R) - 1.0) / 2.0))
    print(
        f"  {k1:<5}  {path[-1].iteration:4d}    {np.linalg.norm(across, axis=1).max():.4f}                      {turned:.5f}"
    )

print("\nIgnoring the orientation is not the same as holding it: 50 random positions, 500 steps of k1 = 0.1")
positions = pieper.load("ur5e").fk(np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6)))[:, :3, 3]
ignored = [run(ur5e, p, q_start, k1=0.1, iterations=500, position_stop=1e-3).norm < 1e-3 for p in positions]
held = [
    run(ur5e, p, q_start, orientation="hold", k1=0.1, iterations=500, position_stop=1e-3).norm < 1e-3 for p in positions
]
print(f"  three rows (ignored) reach {sum(ignored)}, six rows with omega = 0 (held) reach {sum(held)}")
