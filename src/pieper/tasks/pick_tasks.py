"""The pick-and-place tasks that come with the package: the KR210 at its shelf, and the same for other arms by other numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.arm import Arm, load
from pieper.errors import unknown_name
from pieper.model.description import Cylinder
from pieper.sim.gripper import ParallelGripper
from pieper.sim.scene import CLAY, Scene, SceneCamera, SceneObject, at, open_box, shelf, table
from pieper.tasks.mover import DirectMover
from pieper.tasks.pick import PickTask

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

AHEAD = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(4, 4): z of the hand along x of the thing, y along y: a grasp from the front."""

DOWN = np.diag([-1.0, 1.0, -1.0, 1.0])
"""(4, 4): z of the hand down: a grasp from above."""

COLORS = (CLAY, "#2f7fd1", "#3aa655", "#c9a227", "#8a63c7", "#d9773b", "#4fb3bf", "#b5485d", "#6b8e23")


def names() -> tuple[str, ...]:
    """Names of the arms that have a task."""
    return tuple(_TASKS)


def task(name: str = "kr210") -> PickTask:
    """The task of an arm.

    Parameters
    ----------
    name : str
        One of `names`.

    Raises
    ------
    UnknownNameError
        There is none for that arm.

    Examples
    --------
    >>> kr210 = task("kr210")
    >>> len(kr210.targets), kr210.grasp_at(at(2.6, 0.9, 0.811))[:3, 3].round(3)
    (9, array([2.4  , 0.9  , 0.811]))
    """
    key = name.lower()
    if key not in _TASKS:
        raise unknown_name("pick task", name, _TASKS)
    return _TASKS[key]()


def _kr210() -> PickTask:
    """Nine slots and a bin as in the teaching scene: a can's place there is 0.1 m above where it is gripped."""
    arm = load("kr210")
    radius, length = 0.05, 0.3
    hand = ParallelGripper(
        stroke=0.16, force=150.0, reach=0.2, T_tip_mount=AHEAD, pad=np.array([0.014, 0.05, 0.07]), speed=0.2, mass=8.0
    )  # fmt: skip
    slots = [(2.6, y, z - 0.1) for z in (0.911, 1.681, 2.445) for y in (0.9, 0.0, -0.9)]
    boards = sorted({z - 0.5 * length for _, _, z in slots})
    things = (
        *shelf("shelf", x=(2.48, 2.95), edges=(-1.35, -0.45, 0.45, 1.35), boards=boards, top=2.95),
        *open_box("bin", center=(0.05, 2.5), size=(1.0, 0.9, 0.75)),
        *_cans(slots, radius, length, 1.0),
    )
    cameras = (SceneCamera.looking("corner", [-3.2, -3.8, 3.1], [1.2, 0.62, 1.2]),)
    drop = at(-0.1, 2.5, 1.6)
    tucked = tuple(np.array([waist, -0.5, 0.4, 0.0, -0.3, 0.0]) for waist in (-0.5, 0.0, 0.6, 1.2))
    return PickTask(
        "kr210", arm, hand, Scene(things, cameras), _names(slots), AHEAD, drop, np.array([[-0.45, 2.05, 0.0], [0.55, 2.95, 0.75]]),
        np.array([0.0, 0.0, 0.0, 0.0, -0.6, 0.0]), postures=tucked, approach=0.2, clearance=0.5, lift=0.03,
    )  # fmt: skip


def _small_shelf(
    name: str, arm_name: str, T_tip_mount: FloatArray, q_near: FloatArray, *, x: float, floor: float
) -> PickTask:
    arm = load(arm_name)
    radius, length = 0.025, 0.12
    hand = ParallelGripper(stroke=0.09, force=50.0, reach=0.16, T_tip_mount=T_tip_mount, mass=1.2)
    slots = [(x, y, z) for z in (0.3, 0.6, 0.9) for y in (0.3, 0.0, -0.3)]
    boards = sorted({z - 0.5 * length - floor for _, _, z in slots})
    upright = [
        (o.name, o)
        for o in shelf(
            "shelf",
            x=(x - 0.05, x + 0.17),
            edges=(-0.45, -0.15, 0.15, 0.45),
            boards=boards,
            top=1.1 - floor,
            thickness=0.02,
        )
    ]
    lowered = tuple(SceneObject(n, o.solid, at(0.0, 0.0, floor) @ o.T_world_object, color=o.color) for n, o in upright)
    things = (
        *lowered,
        *open_box("bin", center=(0.0, 0.8), size=(0.5, 0.45, 0.3), floor=floor),
        *_cans(slots, radius, length, 0.25),
    )
    if floor < 0.0:
        things = (*things, *table("stand", center=(0.0, 0.0), size=(0.36, 0.36), height=-0.005, floor=floor))
    drop = at(0.0, 0.8, 0.6 + max(floor, -0.3)) @ DOWN @ np.linalg.inv(hand.T_tip_mount)
    cameras = (SceneCamera.looking("corner", [-1.6, -1.9, 1.5], [0.4, 0.25, 0.4]),)
    home = _reaching(arm, at(x - 0.4, 0.0, 0.7) @ AHEAD @ np.linalg.inv(hand.T_tip_mount), q_near)
    return PickTask(
        name, arm, hand, Scene(things, cameras, floor=floor), _names(slots), AHEAD, drop,
        np.array([[-0.25, 0.575, floor], [0.25, 1.025, floor + 0.3]]), home, approach=0.14, clearance=0.2, lift=0.02,
    )  # fmt: skip


def _ur10e() -> PickTask:
    return _small_shelf("ur10e", "ur10e", np.eye(4), np.array([-0.2, -2.0, 2.2, -0.2, 1.4, 0.0]), x=0.95, floor=-0.4)


def _mh12() -> PickTask:
    return _small_shelf("mh12", "mh12", np.eye(4), np.zeros(6), x=1.1, floor=0.0)


def _youbot() -> PickTask:
    """Nine cans on a low table in front, taken from above: an arm of five joints, which reaches down only near itself."""
    arm = load("youbot")
    radius, length, top, ground = 0.012, 0.04, -0.05, -0.30
    axis_x = 0.024  # of the first joint
    hand = ParallelGripper(
        stroke=0.045, force=15.0, reach=0.06, mass=0.2, pad=np.array([0.005, 0.014, 0.024]), speed=0.1
    )
    near, far = [(0.21, a) for a in (40.0, 20.0, 0.0, -20.0, -40.0)], [(0.252, a) for a in (30.0, 10.0, -10.0, -30.0)]
    slots = [
        (axis_x + r * float(np.cos(np.radians(a))), r * float(np.sin(np.radians(a))), top + 0.5 * length)
        for r, a in (*near, *far)
    ]
    things = (
        *table("table", center=(0.27, 0.0), size=(0.28, 0.5), height=top, floor=ground, thickness=0.02),
        *table("stand", center=(-0.03, 0.0), size=(0.2, 0.2), height=-0.002, floor=ground, thickness=0.02),
        *open_box("bin", center=(axis_x, 0.235), size=(0.18, 0.18, 0.2), floor=ground, wall=0.006),
        *_cans(slots, radius, length, 0.05),
    )
    cameras = (SceneCamera.looking("corner", [-0.35, -0.75, 0.55], [0.14, 0.03, -0.02]),)
    drop = at(axis_x, 0.22, 0.11) @ DOWN
    home = _reaching(arm, at(axis_x + 0.23, 0.0, 0.13) @ DOWN, np.array([2.95, 1.35, -2.6, 1.8, 2.9]), spin_free=True)
    return PickTask(
        "youbot", arm, hand, Scene(things, cameras, floor=ground), _names(slots), at(0.0, 0.0, 0.004) @ DOWN, drop,
        np.array([[axis_x - 0.09, 0.145, ground], [axis_x + 0.09, 0.325, ground + 0.2]]), home, approach=0.045, clearance=0.01, lift=0.01,
        spin_free=True, drop_step=0.03,
    )  # fmt: skip


def _reaching(arm: Arm, T: FloatArray, q_near: FloatArray, *, spin_free: bool = False) -> FloatArray:
    """(n,) joint values for a pose, near others."""
    return np.asarray(DirectMover(arm, axis_tip=np.array([0.0, 0.0, 1.0]) if spin_free else None).answers(T, q_near)[0])


_TASKS: dict[str, Callable[[], PickTask]] = {"kr210": _kr210, "ur10e": _ur10e, "mh12": _mh12, "youbot": _youbot}


def _names(slots: list[tuple[float, float, float]]) -> tuple[str, ...]:
    return tuple(f"can {k + 1}" for k in range(len(slots)))


def _cans(
    slots: list[tuple[float, float, float]], radius: float, length: float, mass: float
) -> tuple[SceneObject, ...]:
    return tuple(
        SceneObject(name, Cylinder(radius, length), at(*slot), mass=mass, color=COLORS[k % len(COLORS)], friction=0.9)
        for k, (name, slot) in enumerate(zip(_names(slots), slots, strict=True))
    )
