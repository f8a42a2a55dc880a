"""Figures as papers print them: the straight line that an iteration leaves, and two models of one arm."""

import tempfile
from pathlib import Path

import numpy as np

import pieper
from pieper.ik.iteration import iterate
from pieper.viewer import plot

arm = pieper.load("ur5e")
q_start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
goal = np.array([0.50, -0.60, 0.20])
runs = {
    f"$k_1 = {k1:g}$": list(iterate(arm.chain, goal, q_start, orientation="hold", k1=k1, position_stop=1e-3))
    for k1 in (0.1, 1.0)
}
paths = {label: np.array([step.T[:3, 3] for step in steps]) for label, steps in runs.items()}
for label, points in paths.items():
    print(f"{label.strip('$')}: {len(points) - 1} steps, {plot.straight_line(points, goal).largest:.4f} m off the line")

report, exact = pieper.load("mh12-report"), pieper.load("mh12")  # the screws as printed, and from the URDF
figures = {
    "path.png": plot.path(paths, target=goal, title="UR5e, Jacobian iteration"),
    "error.pdf": plot.error(runs, stop=1e-3),
    "models.svg": plot.compare(report, exact, theme="dark"),
}
with tempfile.TemporaryDirectory() as folder:
    for name, figure in figures.items():
        size = plot.save(figure, Path(folder) / name).stat().st_size
        print(f"{name}: {size // 1000} kB")
