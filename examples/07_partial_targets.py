"""Five joints, and targets that leave some freedom: every answer where they are isolated, the nearest where they are not."""

import numpy as np

import pieper
from pieper.ik.partial import solve_partial
from pieper.ik.projection import project
from pieper.ik.target import ignore_orientation, position_and_axis
from pieper.spatial.rotation import from_rotation_vector

so101 = pieper.load("so101")
print("SO-101, five joints: a pose that it can take, and the same pose turned by 0.1 rad")
T_base_tip = so101.fk([0.3, -0.5, 0.6, 0.4, -0.2])
for turn in (0.0, 0.1):
    wanted = T_base_tip.copy()
    wanted[:3, :3] = from_rotation_vector([0.0, 0.0, turn]) @ T_base_tip[:3, :3]
    nearest = project(so101.chain, wanted)
    print(f"  turned by {turn:.1f} rad:")
    for q, angle, metres in zip(nearest.q, nearest.rotation_error, nearest.position_error, strict=True):
        if not np.isnan(angle):
            print(f"    q {q.round(3)} rad   {angle:.4f} rad and {metres:.0e} m left")

print("\nSO-101: a position and one axis, every answer")
jaw = position_and_axis(T_base_tip[:3, 3], T_base_tip[:3, 0], axis_tip=[1.0, 0.0, 0.0])
answers = solve_partial(so101.chain, jaw)
print(f"  {answers.words}")
for q in answers.q[answers.valid]:
    print(f"    q {q.round(3)} rad")

youbot = pieper.load("youbot")
print("\nyouBot: its tool axis is its last joint axis")
q_now = np.array([2.0, 1.3, -1.9, 2.4, 1.0])
T_base_tip = youbot.fk(q_now)
answers = solve_partial(youbot.chain, position_and_axis(T_base_tip[:3, 3], T_base_tip[:3, 2]), seed=q_now)
print(f"  {answers.words}")
print(f"    {int(answers.valid.sum())} answers, the first {answers.q[0].round(3)} rad")

ur5e = pieper.load("ur5e")
print("\nUR5e: a position alone, and the answer nearest to where the arm is")
q_now = np.array([0.3, -1.5, 1.8, -1.8, -1.5, 0.7])
answers = solve_partial(ur5e.chain, ignore_orientation([0.4, 0.2, 0.3]), seed=q_now)
sampled = solve_partial(ur5e.chain, ignore_orientation([0.4, 0.2, 0.3]))
best = np.linalg.norm(sampled.q[sampled.valid] - q_now, axis=-1).min()
print(f"  {answers.words}")
print(f"    nearest of {int(sampled.valid.sum())} samples   {best:.4f} rad away")
print(f"    moved along the family   {np.linalg.norm(answers.q[0] - q_now):.4f} rad away")
print(f"    q {answers.q[0].round(3)} rad, {answers.position_error[0]:.0e} m left")
