"""See and reach: a camera in the cell finds coloured cans that lie anywhere on a table, in any light, and the arm picks them up.

Three steps, none of which asks the simulator where anything is:

1. `calibrate_cell`: the hand shows a board to the camera from poses that are planned, and hand-eye calibration says where the camera is.
2. `learn_cans`: boxes that somebody marked on a few pictures say what the colours are.
3. `SeeAndPick`: for each can a picture, its patch of colour, and from the outline of an upright can of known size on a table of known height its place.

The camera gives colours alone, as an ordinary one does; height of the table and size of the cans are told.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pieper.arm import load
from pieper.errors import ArrayError, VisionError, unknown_name
from pieper.model.description import Box, Cylinder
from pieper.perception.board import Board
from pieper.perception.board_views import BoardView
from pieper.perception.camera import Camera
from pieper.perception.capture_plan import plan_captures
from pieper.perception.color_learning import learn
from pieper.perception.color_regions import Region
from pieper.perception.hand_eye import HandEyeCalibration, calibrate_hand_eye_from_views
from pieper.perception.masks import color_masks
from pieper.perception.upright import Upright, cylinder_outline, locate_upright
from pieper.sim.gripper import ParallelGripper
from pieper.sim.light import SceneLight
from pieper.sim.physics import MujocoSimulator
from pieper.sim.scene import Scene, SceneCamera, SceneObject, at, open_box, table
from pieper.sim.scene_view import SceneView
from pieper.spatial import pose, rotation
from pieper.tasks.mover import DirectMover
from pieper.tasks.pick import STILL, PickAndPlace, PickTask, StageFailedError

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from typing_extensions import Self

    from pieper.perception.color import ColorModel
    from pieper.perception.color_table import ColorTable
    from pieper.tasks.mover import Mover
    from pieper.tasks.pick import Stage

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

EYE = "eye"
"""Name of the camera that looks."""

SIZE = (640, 480)
"""Of its images [px]."""

COLORS = {"red can": "#c42f2f", "green can": "#2c9a48", "blue can": "#2b5fd0"}
"""Of the cans."""

BIN = "#84888c"
"""Grey: of none of the colours that are looked for."""

LIGHT_SPREAD, CAST_SPREAD = 0.5, 0.12
"""Standard deviations of the light and of its colour that the cans are known under, as logarithms; more than a tracker needs, for here it jumps."""

_AHEAD = np.array(
    [[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)  # z along x
_DOWN = np.diag([-1.0, 1.0, -1.0, 1.0])  # a grasp from above
_ENCODER_NOISE = 5e-5  # [rad] of what the arm says of its joints while it is calibrated
_RULER = 0.05, float(np.radians(3.0))  # [m], [rad] how well the plan of captures knows where camera and board are
_DOTS = 48  # pixels of the printed board for a square
_TRIES = 4000  # to find places that are apart
_AWAY = -5.0  # [m] where a can is thought to be that is not seen: in nobody's way


@dataclass(frozen=True, eq=False)
class SeeTask:
    """What is picked by sight, and where it may lie.

    Attributes
    ----------
    pick : PickTask
        The cans, the gripper and the bin; the scene has a camera called ``eye``.
    area : (2, 2) array
        Corners, lowest and highest x and y, of where the middle of a can may stand [m].
    height : float
        Of the table [m].
    apart : float
        Least distance between the middles of two cans [m].
    board : str
        What the hand shows to the camera, see `pieper.perception.board.Board.parse`.
    T_tip_board : (4, 4) array
        Middle of the board in the hand, z out of its printed side.
    captures : int
        Poses from which it is shown.
    """

    pick: PickTask
    area: FloatArray
    height: float
    apart: float
    board: str
    T_tip_board: FloatArray
    captures: int = 14

    @property
    def scene_camera(self) -> SceneCamera:
        """The camera as it stands in the scene: the truth, which only the simulator and the judge of results may ask."""
        return next(entry for entry in self.pick.scene.cameras if entry.name == EYE)

    def can(self, name: str) -> Cylinder:
        """Size of a can."""
        solid = self.pick.scene.object(name).solid
        assert isinstance(solid, Cylinder)
        return solid


def see_task(name: str = "kr210") -> SeeTask:
    """The task of an arm: three cans on a table, taken from above.

    Raises
    ------
    UnknownNameError
        There is none for that arm.
    """
    tasks: dict[str, Callable[[], SeeTask]] = {"kr210": _kr210, "ur10e": _ur10e}
    if name.lower() not in tasks:
        raise unknown_name("see-and-reach task", name, tasks)
    return tasks[name.lower()]()


def _kr210() -> SeeTask:
    hand = ParallelGripper(
        stroke=0.16, force=150.0, reach=0.2, T_tip_mount=_AHEAD, pad=np.array([0.014, 0.05, 0.07]), speed=0.2, mass=8.0
    )  # fmt: skip
    radius, length, height = 0.05, 0.2, 0.5
    area = np.array([[1.35, -0.65], [2.05, 0.65]])
    things = (
        *table("table", center=(1.7, 0.0), size=(1.0, 1.7), height=height),
        *open_box("bin", center=(0.1, 2.3), size=(1.0, 0.9, 0.75), color=BIN),
        *_cans(area, height, radius, length, 1.0),
    )
    cameras = (
        SceneCamera.looking("corner", [4.3, -3.5, 2.9], [1.4, 0.9, 0.35]),
        SceneCamera.looking(EYE, [1.75, -1.75, 2.9], [1.7, 0.05, 0.5]),
    )
    drop = at(0.1, 2.3, 1.25) @ _DOWN @ np.linalg.inv(hand.T_tip_mount)
    postures = tuple(np.array([waist, -0.6, 0.5, 0.0, 1.2, 0.0]) for waist in (0.0, 0.6))
    pick = PickTask(
        "kr210 sees", load("kr210"), hand, Scene(things, cameras), tuple(COLORS), at(0.0, 0.0, 0.055) @ _DOWN, drop,
        np.array([[-0.4, 1.85, 0.0], [0.6, 2.75, 0.75]]), np.array([1.2, -0.6, 0.5, 0.0, 1.2, 0.0]), postures=postures, approach=0.2,
        clearance=0.2, lift=0.1, drop_step=0.1,
    )  # fmt: skip
    return SeeTask(pick, area, height, 0.3, "charuco:5x4:0.1:0.076", hand.T_tip_mount @ at(0.0, 0.0, 0.28))


def _ur10e() -> SeeTask:
    hand = ParallelGripper(stroke=0.09, force=50.0, reach=0.16, mass=1.2)
    radius, length, height, floor = 0.025, 0.1, -0.05, -0.4
    area = np.array([[0.45, -0.35], [0.8, 0.35]])
    things = (
        *table("table", center=(0.63, 0.0), size=(0.55, 0.95), height=height, floor=floor, thickness=0.02),
        *table("stand", center=(0.0, 0.0), size=(0.36, 0.36), height=-0.005, floor=floor),
        *open_box("bin", center=(0.0, 0.85), size=(0.5, 0.45, 0.3), floor=floor, color=BIN),
        *_cans(area, height, radius, length, 0.25),
    )
    cameras = (
        SceneCamera.looking("corner", [2.0, -1.75, 1.25], [0.58, 0.33, 0.02]),
        SceneCamera.looking(EYE, [0.65, -0.75, 1.05], [0.62, 0.02, -0.05]),
    )
    drop = at(0.0, 0.85, 0.15) @ _DOWN
    above = np.array([0.0, -1.5, 1.7, -1.75, -1.57, 0.0])
    waist = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    turned = tuple(above + turn * waist for turn in (-0.3, 0.4))
    pick = PickTask(
        "ur10e sees", load("ur10e"), hand, Scene(things, cameras, floor=floor), tuple(COLORS), at(0.0, 0.0, 0.025) @ _DOWN, drop,
        np.array([[-0.25, 0.625, floor], [0.25, 1.075, floor + 0.3]]), above + 1.3 * waist, postures=turned,
        approach=0.12, clearance=0.08, lift=0.05, drop_step=0.06,
    )  # fmt: skip
    return SeeTask(pick, area, height, 0.17, "charuco:5x4:0.045:0.034", at(0.0, 0.0, 0.22))


def _cans(area: FloatArray, height: float, radius: float, length: float, mass: float) -> tuple[SceneObject, ...]:
    ys = np.linspace(area[0, 1], area[1, 1], len(COLORS))
    return tuple(
        SceneObject(name, Cylinder(radius, length), at(float(area[:, 0].mean()), float(y), height + 0.5 * length), mass=mass, color=color, friction=0.9)
        for y, (name, color) in zip(ys, COLORS.items(), strict=True)
    )  # fmt: skip


# --------------------------------------------------------------------------------------------------------------------
# where the camera is


def pinhole(entry: SceneCamera, size: tuple[int, int] = SIZE) -> Camera:
    """The lens of a camera of a scene, as its maker tells it: no distortion, and the axis through the middle of the image."""
    focal = 0.5 * size[1] / np.tan(0.5 * entry.field_of_view)
    matrix = [[focal, 0.0, 0.5 * (size[0] - 1)], [0.0, focal, 0.5 * (size[1] - 1)], [0.0, 0.0, 1.0]]
    return Camera(np.array(matrix), np.zeros(0), size)


def calibrate_cell(task: SeeTask, *, seed: int = 0) -> HandEyeCalibration:
    """Find out where the camera is: the hand shows it a board.

    Poses are planned from about where camera and board are (5 cm and 3 deg off); what the arm says of its joints is off by 5e-5 rad.

    Raises
    ------
    VisionError
        The board is not seen from enough poses.
    """
    rng = np.random.default_rng((seed, 1))
    board, camera = Board.parse(task.board), pinhole(task.scene_camera)
    width, depth = ((n + 1) * board.square for n in board.squares)
    plate = SceneObject(
        "board", Box(np.array([width, depth, 0.01])), task.pick.arm.fk(task.pick.q_home) @ task.T_tip_board, mass=0.5, picture=_printed(board),
    )  # fmt: skip
    T_plate_target = at(-0.5 * board.size[0], 0.5 * board.size[1], 0.005) @ np.diag([1.0, -1.0, -1.0, 1.0])
    fixed = tuple(thing for thing in task.pick.scene.objects if not thing.moves)
    robot = MujocoSimulator(
        task.pick.arm,
        q=task.pick.q_home,
        scene=replace(task.pick.scene, objects=(*fixed, plate)),
        gripper=task.pick.gripper,
    )
    T_tip_target = task.T_tip_board @ T_plate_target
    plan = plan_captures(
        task.pick.arm, camera, board, camera_on="cell", count=task.captures, q_near=task.pick.q_home, seed=seed,
        T_mount_camera=_about(task.scene_camera.T_world_camera, rng), T_holder_target=_about(T_tip_target, rng),
        usable=lambda q: not robot.blocked(q, held="board", T_tip_held=task.T_tip_board),
    )  # fmt: skip
    views, hands = [], []
    with SceneView(robot, EYE, size=SIZE) as view:
        for k, q in enumerate(plan.q):
            found = board.find(
                np.ascontiguousarray(
                    view.image(robot.positions(q, {"board": task.pick.arm.fk(q) @ task.T_tip_board}))[..., ::-1]
                )
            )
            if found is not None:
                views.append(BoardView(f"capture {k + 1}", *found))
                hands.append(task.pick.arm.fk(q + rng.normal(0.0, _ENCODER_NOISE, q.shape)))
    if len(views) < 4:
        raise VisionError(f"the board was seen from {len(views)} of {len(plan.q)} poses, and 4 are needed")
    return calibrate_hand_eye_from_views(np.array(hands), views, board, camera, camera_on="cell")


def _printed(board: Board) -> Image:
    """The board with a margin of half a square, (rows, columns, 3)."""
    x, y = ((np.arange((n + 1) * _DOTS) + 0.5) * (board.square / _DOTS) - 0.5 * board.square for n in board.squares)
    white = board.is_white(np.stack(np.meshgrid(x, y), axis=-1))
    return np.repeat(np.where(white, 255, 20).astype(np.uint8)[..., None], 3, axis=2)


def _about(T: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A pose as a ruler measures it."""
    turn = rotation.from_rotation_vector(rng.normal(0.0, _RULER[1], 3) / np.sqrt(3.0))
    return pose.from_position_rotation(
        T[:3, 3] + rng.uniform(-1.0, 1.0, 3) * _RULER[0] / np.sqrt(3.0), T[:3, :3] @ turn
    )


# --------------------------------------------------------------------------------------------------------------------
# what the cans look like


def learn_cans(task: SeeTask, *, seed: int = 0, pictures: int = 6) -> ColorModel:
    """Learn the colours of the cans from boxes on a few pictures, each in another light, as ``pieper learn-colour`` does.

    The boxes are those that a person would draw around the cans.

    Parameters
    ----------
    task : SeeTask
    seed : int
        Of the light and of where the cans stand.
    pictures : int
        How many.

    Returns
    -------
    ColorModel
    """
    rng = np.random.default_rng((seed, 2))
    robot = MujocoSimulator(task.pick.arm, q=task.pick.q_home, scene=task.pick.scene, gripper=task.pick.gripper)
    truth, camera = task.scene_camera.T_world_camera, pinhole(task.scene_camera)
    frames: list[Image] = []
    regions: list[Region] = []
    with SceneView(robot, EYE, size=SIZE) as view:
        for k in range(pictures):
            (SceneLight() if k == 0 else SceneLight.random(rng)).shine(robot)
            for name, T in random_places(task, rng).items():
                robot.put(name, T)
            frames.append(np.ascontiguousarray(view.image()[..., ::-1]))
            for name in task.pick.targets:
                can = task.can(name)
                outline = cylinder_outline(camera, truth, robot.pose(name)[:3, 3], can.radius, can.length)
                low, high = np.floor(outline.min(axis=0)).astype(int), np.ceil(outline.max(axis=0)).astype(int)
                regions.append(Region(name, k, int(low[0]), int(low[1]), *map(int, high - low)))
    return learn(frames.__getitem__, regions, light=LIGHT_SPREAD, cast=CAST_SPREAD).model


def random_places(task: SeeTask, rng: np.random.Generator) -> dict[str, FloatArray]:
    """Where the cans of a round stand: anywhere in the area, apart, turned anyhow; (4, 4) by name.

    Raises
    ------
    ArrayError
        The area has no room for as many cans so far apart.
    """
    low, high = task.area
    for _ in range(_TRIES):
        spots = rng.uniform(low, high, (len(task.pick.targets), 2))
        between = np.linalg.norm(spots[:, None] - spots, axis=-1)[np.triu_indices(len(spots), 1)]
        if not len(between) or between.min() >= task.apart:
            break
    else:
        raise ArrayError(f"the area has no room for {len(task.pick.targets)} cans that are {task.apart} m apart")
    return {
        name: at(float(x), float(y), task.height + 0.5 * task.can(name).length, yaw=float(rng.uniform(-np.pi, np.pi)))
        for name, (x, y) in zip(task.pick.targets, spots, strict=True)
    }


# --------------------------------------------------------------------------------------------------------------------
# looking and picking


class Look(NamedTuple):
    """One look for a thing: `time` [s], `name`, the camera's `image` (red, green, blue), what was `found`, the `light`, and `error` [m].

    The error is that of the place on the table against the simulator's truth, which the arm never hears of; NaN when nothing was found.
    """

    time: float
    name: str
    image: Image
    found: Upright | None
    light: SceneLight
    error: float


class SeeAndPick(PickAndPlace):
    """Pick and place by sight. A context manager: the camera needs somewhere to draw.

    Parameters
    ----------
    task : SeeTask
    seed : int
        Of places and light. Those of a round depend on the seed and the number of its first cycle alone.
    calibration : HandEyeCalibration, optional
        Where the camera is; `calibrate_cell` by default.
    colors : ColorModel, optional
        What the cans look like; `learn_cans` by default.
    mover, log
        As for `pieper.tasks.pick.PickAndPlace`.

    Attributes
    ----------
    looks : list of Look
        What was seen.
    seen : dict of str to (4, 4) array
        Where the cans are that the last picture shows.
    calibration : HandEyeCalibration
    """

    def __init__(
        self, task: SeeTask, *, seed: int = 0, calibration: HandEyeCalibration | None = None, colors: ColorModel | None = None,
        mover: Mover | None = None, log: Callable[[Stage], None] | None = None,
    ) -> None:  # fmt: skip
        pick = task.pick
        way = mover or DirectMover(
            pick.arm, speed=pick.speed, blocked=self.blocked, postures=(pick.q_home, *pick.postures)
        )
        super().__init__(pick, seed=seed, mover=way, look=self.see, log=log)
        self.sight = task
        self.calibration = calibrate_cell(task, seed=seed) if calibration is None else calibration
        self.table: ColorTable = (learn_cans(task, seed=seed) if colors is None else colors).table()
        self.camera = pinhole(task.scene_camera)
        self.light = SceneLight()
        self.looks: list[Look] = []
        self.seen: dict[str, FloatArray] = {}
        self._belief = MujocoSimulator(pick.arm, q=pick.q_home, scene=pick.scene, gripper=pick.gripper)

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            self._view = undo.enter_context(SceneView(self.robot, EYE, size=SIZE))
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()

    def see(self, name: str) -> FloatArray | None:
        """Where a can is, (4, 4), from one picture; None when it is not seen. What else is seen in it is kept in mind.

        Raises
        ------
        ArrayError
            It is not in a ``with`` statement, which has the camera.
        """
        if not hasattr(self, "_view"):
            raise ArrayError("SeeAndPick looks through a camera: use it in a with statement")
        image = self._view.image()
        masks = color_masks(image, self.table, order="rgb")
        found = {other: self._located(masks[other], other) for other in self.task.targets}
        self.seen = {other: _upright(entry.p_base) for other, entry in found.items() if entry is not None}
        for k, other in enumerate(self.task.targets):
            self._belief.put(other, self.seen.get(other, at(_AWAY - k, _AWAY, _AWAY)))
        mine = found[name]
        error = np.nan if mine is None else float(np.linalg.norm((mine.p_base - self.robot.pose(name)[:3, 3])[:2]))
        self.looks.append(Look(self.robot.time, name, image, mine, self.light, error))
        return self.seen.get(name)

    def _located(self, mask: NDArray[np.uint8], name: str) -> Upright | None:
        can = self.sight.can(name)
        return locate_upright(
            mask,
            self.camera,
            self.calibration.T_base_camera(),
            radius=can.radius,
            length=can.length,
            height=self.sight.height,
        )

    def blocked(self, q: FloatArray) -> str:
        """What the arm would touch at joint values (n,), of what was seen and what always stands there."""
        if self._held is None:
            return self._belief.blocked(q)
        return self._belief.blocked(q, held=self._held.name, T_tip_held=self._held.T_tip_object)

    def fill_slots(self, number: int) -> None:
        """Put the cans anywhere on the table, in another light, as the round that begins with cycle `number` has it."""
        rng = np.random.default_rng((self.seed, number))
        self.light = SceneLight.random(rng)
        self.light.shine(self.robot)
        for name, T in random_places(self.sight, rng).items():
            self.robot.put(name, T)
        self._wait(
            lambda: max(map(self.robot.speed, self.task.targets)) < STILL, "the cans do not come to rest", guard=False
        )

    def _in_slot(self) -> bool:
        """Whether the hand is nearer to where the target was seen than the approach is long."""
        T = self.seen.get(self._target)
        if T is None:
            return False
        return bool(np.linalg.norm(self.robot.tip()[:3, 3] - self.task.grasp_at(T)[:3, 3]) < self.task.approach)

    def _recover(self, *, again: bool) -> bool:
        """As ever, and out of the view when nothing was seen."""
        done = super()._recover(again=again)
        if done and again and self.looks[-1].found is None:
            try:
                with self._stage("out of the view"):
                    self._follow_home()
            except StageFailedError:
                return False
        return done


def _upright(p: FloatArray) -> FloatArray:
    """A can looks the same from all around: turned so that the fingers come across the arm."""
    x, y, z = (float(part) for part in p)
    return at(x, y, z, yaw=float(np.arctan2(y, x)))
