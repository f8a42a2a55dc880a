"""Where an arm can reach, with how many of all orientations, and where to put it for a task."""

import numpy as np

import pieper
from pieper.spatial import rotation
from pieper.workspace.place import grid_of_bases, place
from pieper.workspace.run import run
from pieper.workspace.survey import survey

arm = pieper.load("ur5e")
found = run(survey(arm, voxel=0.1, orientations=60))
told = found.summary()
print(f"{arm.name} reaches {told.reachable:.2f} m^3, {told.dexterous:.2f} m^3 of it with every one of 60 orientations")
print(
    f"a reachable voxel has {100 * told.mean_dexterity:.0f} % of them, and poses up to {told.most_solutions} solutions"
)

share, x = found.layer("dexterity", "y", 0.0), found.grid.axis("x")
height = found.grid.layer("z", 0.3)
print("share of orientations along x, at y = 0 and z = 0.3 m:")
for k in range(0, len(x), 2):
    print(f"  x {x[k]:5.2f} m  {share[k, height]:5.2f}  {'#' * round(40 * share[k, height])}")

centres, margin = found.points("limit_margin", at_least=0.0)
print(f"farthest from its limits at {centres[np.argmax(margin)]} m: {margin.max():.2f} rad")

task = np.tile(np.eye(4), (3, 1, 1))  # from above, at three places of a table
task[:, :3, :3] = rotation.from_rpy([np.pi, 0.0, 0.0])
task[:, :3, 3] = [[0.5, 0.4, 0.1], [0.5, -0.4, 0.1], [1.1, 0.0, 0.2]]
tried = place(arm, task, grid_of_bases([0.0, 1.2], [-0.6, 0.6], [0.0, 0.0], step=0.1, yaws=4))
x_base, y_base, _, yaw = tried.bases[tried.best]
print(
    f"{(tried.reached == len(task)).sum()} of {len(tried.bases)} base poses reach all of the task; the best is at "
    f"{x_base:.1f} {y_base:.1f} m, {np.degrees(yaw):.0f} deg, {tried.margin[tried.best]:.2f} rad from every limit"
)
