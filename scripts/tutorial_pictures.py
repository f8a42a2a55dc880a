"""Draw the pictures of docs/tutorials. Run from a clone: ``python scripts/tutorial_pictures.py``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

import pieper
from pieper.ik.iteration import iterate
from pieper.model import catalog
from pieper.model.dh import from_dh
from pieper.perception.overlay import Overlay
from pieper.perception.pass_marks import learned, report_colors
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.report import ReportTracker
from pieper.perception.scene_presets import preset
from pieper.perception.synthetic import Renderer
from pieper.sim.picture import Picture
from pieper.spatial import rotation
from pieper.viewer import plot

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SOLID, GHOST = "#f28c28", "#2f7fd1"
SMALL = (640, 480)


def mh12_figure_2() -> None:
    """The pose of the report's Figure 2 and its other answer."""
    arm = pieper.load("mh12", nominal=True)
    picture = Picture(size=SMALL, view=(-1.9, 0.22))
    picture.add_arm(arm, [-0.049253, -1.282161, 0.975023, 0.0, -0.320916, -2.363734], color=SOLID)
    picture.add_arm(arm, [-0.049253, -0.975636, 1.562056, 0.0, -0.601424, -2.363734], color=GHOST, opacity=0.35)
    picture.save(IMAGES / "tutorial_mh12_figure_2.png")


def mh12_error() -> None:
    """What is left, step by step."""
    report = pieper.load("mh12-report").chain
    steps = list(iterate(report, [0.3] * 3, np.zeros(5), alpha=0.06, iterations=255, target_offset=(3e-4, 3e-4, 4e-4)))
    plot.save(plot.error({"0.06 of a step": steps}, rate=0.94), IMAGES / "tutorial_mh12_error.png", dpi=110)


def kr210_answers() -> None:
    """Every answer for one pose."""
    arm = pieper.load("kr210")
    q = np.random.default_rng(0).uniform(*arm.limits.T, (2000, 6))
    answers = arm.ik(arm.fk(q))
    x, y, z = arm.fk(q)[:, :3, 3].T
    beside = (np.abs(y) < 0.3) & (x > 0.6) & (z < 2.0)  # in the plane of the picture, and low
    k = int(np.flatnonzero((answers.valid.sum(axis=1) == 8) & (answers.within_limits.sum(axis=1) >= 4) & beside)[0])
    picture = Picture(size=SMALL, view=(-1.35, 0.18))
    for number, angles in enumerate(answers.q[k]):
        picture.add_arm(arm, angles, color=GHOST if number else SOLID, opacity=0.22 if number else 1.0)
    picture.save(IMAGES / "tutorial_kr210_answers.png")


def youbot_candle() -> None:
    """Upright, with the frames of its rows, and folded as a ghost."""
    arm = from_dh(catalog.dh_tables("youbot")["full"])
    picture = Picture(size=SMALL, view=(-1.2, 0.2))
    picture.add_arm(arm, np.zeros(5), color=GHOST, opacity=0.3)
    picture.add_arm(arm, np.radians([170.0, 65.0, -146.0, 102.5, 167.5]), color=SOLID, frames=True)
    picture.save(IMAGES / "tutorial_youbot_candle.png")


def gimbal_lock() -> None:
    """Yaw on ways that pass the lock at two distances."""
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    turn = np.radians(np.linspace(60.0, 120.0, 6001))
    for degrees, color in ((10.0, "#9aa3ad"), (1.0, GHOST), (0.1, SOLID)):
        R = rotation.from_euler("XYZ", np.stack([np.full_like(turn, np.radians(degrees)), turn, 0 * turn], axis=-1))
        yaw = np.unwrap(rotation.as_euler("ZYX", R)[:, 0])
        axes.plot(np.degrees(turn), np.degrees(yaw), color=color, label=f"{degrees:g}° off the lock")
    axes.set(xlabel="turn about y [°]", ylabel="yaw [°]", yticks=[0, 45, 90, 135, 180])
    axes.grid(alpha=0.3)
    axes.legend()
    plot.save(figure, IMAGES / "tutorial_gimbal_lock.png", dpi=110)


def ur_ways() -> None:
    """The way of the tip for three gains."""
    arm, target = pieper.load("ur5e").chain, [0.5, -0.6, 0.2]
    start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
    ways = {}
    for k1 in (1.0, 0.1, 0.01):
        steps = iterate(arm, target, start, orientation="hold", k1=k1, position_stop=1e-3)
        ways[f"k1 = {k1:g}"] = np.array([step.T[:3, 3] for step in steps])
    plot.save(plot.path(ways, target=target), IMAGES / "tutorial_ur_ways.png", dpi=110)


def markers() -> None:
    """The report's way and ours where the robot comes out from under the bar."""
    scene = preset("report-occlusion")
    model = learned(scene)
    theirs, tracker = ReportTracker(report_colors(scene)), MarkerTracker(model, view=scene.view, patterns="report")
    overlay = Overlay(scene.view, height=0.12)
    shown = None
    for frame, truth in Renderer(scene):
        theirs.update(frame)
        ours = overlay.draw(frame, tracker.step(frame))
        if frame.index > 90 and truth.objects[0].visible > 0.0:
            shown = np.hstack([part[150:330, 120:560] for part in (theirs.drawn(frame.image), ours)])
            break
    assert shown is not None
    shown = cv2.resize(shown, None, fx=1.2, fy=1.2, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(IMAGES / "tutorial_markers.jpg"), shown, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    for draw in (mh12_figure_2, mh12_error, kr210_answers, youbot_candle, gimbal_lock, ur_ways, markers):
        draw()
    for picture in sorted(IMAGES.glob("tutorial_*")):
        print(f"{picture.name}: {picture.stat().st_size / 1e3:.0f} kB")
