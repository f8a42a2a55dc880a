"""What a camera sees in a simulated scene, without a screen; and films of what happened there."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError, unknown_name
from pieper.kinematics.joints import as_joints
from pieper.sim import film
from pieper.sim.font import font_for
from pieper.sim.ghost import laid_over
from pieper.sim.mujoco_arm import SOLIDS, body_name
from pieper.sim.offscreen import Offscreen, import_mujoco, import_pillow
from pieper.sim.stage import rgb

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

    from typing_extensions import Self

    from pieper.sim.ghost import Ghost
    from pieper.sim.offscreen import Pixels
    from pieper.sim.physics import MujocoSimulator

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_NOT_DRAWN = 5  # a group of MuJoCo's

LARGEST = (1920, 1440)
"""Pixels that the model of a scene has room for."""


class SceneView:
    """Draws the scene of a simulator as one of its cameras sees it. A context manager.

    Parameters
    ----------
    robot : MujocoSimulator
        What is drawn; drawing does not disturb it.
    camera : str, optional
        The first one of the scene by default.
    size : (int, int)
        Width and height in pixels, each even.
    smooth : bool
        Draw at twice the size and shrink; not above 960 x 720.

    Raises
    ------
    ArrayError
        The scene has no camera, or the size is none.
    UnknownNameError
        No camera of that name.
    MissingExtraError, MissingLibraryError
        Nothing to draw with.
    """

    def __init__(
        self,
        robot: MujocoSimulator,
        camera: str | None = None,
        *,
        size: tuple[int, int] = (640, 480),
        smooth: bool = False,
    ) -> None:
        names = [entry.name for entry in robot.scene.cameras]
        if not names:
            raise ArrayError("the scene has no camera; give it one, see pieper.sim.scene.SceneCamera.looking")
        if camera is not None and camera not in names:
            raise unknown_name("camera", camera, names, "the scene")
        factor = 2 if smooth else 1
        if not all(16 <= side * factor <= most for side, most in zip(size, LARGEST, strict=True)):
            most = " x ".join(str(side // factor) for side in LARGEST)
            raise ArrayError(f"size must be from 16 x 16 to {most} pixels, got {size}")
        self.robot, self.size, self._factor = robot, size, factor
        self._camera = int(robot.model.camera(camera or names[0]).id)

    def __enter__(self) -> Self:
        mujoco = import_mujoco()
        with ExitStack() as undo:
            width, height = (side * self._factor for side in self.size)
            self._target = undo.enter_context(Offscreen(self.robot.model, width, height))
            self._data = mujoco.MjData(self.robot.model)
            self._option = mujoco.MjvOption()
            self._option.geomgroup[SOLIDS] = self._option.geomgroup[_NOT_DRAWN] = 0
            self._seen = mujoco.MjvCamera()
            self._seen.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._seen.fixedcamid = self._camera
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()

    def image(self, positions: FloatArray | None = None, *, ghosts: Sequence[Ghost] = ()) -> Image:
        """(height, width, 3) of what is there now, or of recorded `positions` of MuJoCo.

        Parameters
        ----------
        positions : array, optional
            See `MujocoSimulator.positions` and `Recording.moments`.
        ghosts : sequence of Ghost
            The arm with its gripper at other joint values, to look through.

        Returns
        -------
        (height, width, 3) array
            Red, green and blue from 0 to 255.

        Raises
        ------
        ArrayError
            Joint values that do not fit the arm, an opacity that is not from 0 to 1, or a colour that is none.
        """
        drawn = self._drawn(positions)
        layers = [(_opacity(ghost), self._alone(ghost)) for ghost in ghosts]
        return self._shrunk(laid_over(drawn.colors.astype(np.float32), drawn.depth, layers))

    def depth(self, positions: FloatArray | None = None) -> FloatArray:
        """(height, width) distance along the axis of the camera [m]; infinite where nothing is."""
        model = self.robot.model
        extent = float(model.stat.extent)
        near, far = float(model.vis.map.znear) * extent, float(model.vis.map.zfar) * extent
        z = self._drawn(positions).depth[:: self._factor, :: self._factor].astype(np.float64)
        with np.errstate(divide="ignore"):
            distance = near / (1.0 - z * (1.0 - near / far))
        return np.where(z >= 1.0, np.inf, distance)

    def _drawn(self, positions: FloatArray | None, paint: FloatArray | None = None) -> Pixels:
        mujoco = import_mujoco()
        model = self.robot.model
        self._data.qpos[:] = self.robot.data.qpos if positions is None else positions
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        mujoco.mj_camlight(model, self._data)
        mujoco.mjv_updateScene(
            model,
            self._data,
            self._option,
            mujoco.MjvPerturb(),
            self._seen,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._target.scene,
        )
        self._target.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        if paint is not None:
            for shape in self._target.scene.geoms[: self._target.scene.ngeom]:
                shape.rgba[:3] = paint
        pixels: Pixels = self._target.draw()
        return pixels

    def _alone(self, ghost: Ghost) -> Pixels:
        """A ghost with nothing around it."""
        mujoco = import_mujoco()
        model, flags = self.robot.model, self._target.scene.flags
        paint = None if ghost.color is None else rgb(ghost.color)
        q = as_joints(self.robot.chain, ghost.q, name="the joint values of a ghost")
        if q.ndim != 1:
            raise ArrayError(f"the joint values of a ghost must have shape ({self.robot.chain.dof},), got {q.shape}")
        groups, before = np.array(model.geom_group), np.array(flags)
        root = int(model.body(body_name(0)).id)
        try:
            model.geom_group[model.body_rootid[model.geom_bodyid] != root] = _NOT_DRAWN
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_SKYBOX, mujoco.mjtRndFlag.mjRND_FOG):
                flags[flag] = False
            return self._drawn(self.robot.positions(q), paint)
        finally:
            model.geom_group[:], flags[:] = groups, before

    def _shrunk(self, colors: NDArray[np.float32]) -> Image:
        f = self._factor
        small = (
            colors.reshape(colors.shape[0] // f, f, colors.shape[1] // f, f, 3).mean(axis=(1, 3)) if f > 1 else colors
        )
        return np.clip(np.rint(small), 0, 255).astype(np.uint8)


def _opacity(ghost: Ghost) -> float:
    if not 0.0 <= ghost.opacity <= 1.0:
        raise ArrayError(f"the opacity of a ghost must be from 0 to 1, got {ghost.opacity}")
    return ghost.opacity


class Moment(NamedTuple):
    """What a film shows at a time: `positions` of MuJoCo, and a `caption`."""

    positions: FloatArray
    caption: str


class Recording:
    """Positions of everything, kept while the simulator runs, so that the film can be drawn later.

    Parameters
    ----------
    robot : MujocoSimulator
    fps : float
        Frames per second of the film.
    speed : float
        2 plays twice as fast as the simulation.

    Attributes
    ----------
    caption : str
        Written into the frames from now on.
    moments : list of Moment
    is_full : bool
        Whether there was more to keep than a film may have.
    """

    def __init__(self, robot: MujocoSimulator, *, fps: float = 25.0, speed: float = 1.0) -> None:
        for name, value in {"fps": fps, "speed": speed}.items():
            if not (np.isfinite(value) and value > 0.0):
                raise ArrayError(f"{name} must be a positive number, got {value}")
        self.robot, self.fps, self._period = robot, fps, speed / fps
        self.caption = ""
        self.moments: list[Moment] = []
        self.is_full = False
        self._next = robot.time
        robot.observers.append(self._observe)

    def _observe(self) -> None:
        if self.robot.time >= self._next - 1e-9:
            if len(self.moments) >= film.MOST_FRAMES:
                self.is_full = True
                return
            self.moments.append(Moment(self.robot.data.qpos.copy(), self.caption))
            self._next += self._period

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        camera: str | None = None,
        size: tuple[int, int] = (640, 480),
        smooth: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> int:
        """Write a film, ``.mp4`` or ``.gif``; returns the number of frames. Errors as from `pieper.sim.film.save`.

        Raises
        ------
        ArrayError
            Nothing was recorded.
        """
        if not self.moments:
            raise ArrayError("nothing was recorded: let time pass first")
        film.check_ready(path, self.fps)
        with SceneView(self.robot, camera, size=size, smooth=smooth) as view:
            film.save_images(
                self._images(view), path, count=len(self.moments), fps=self.fps, size=size, progress=progress
            )
        return len(self.moments)

    def _images(self, view: SceneView) -> Iterator[Image]:
        for moment in self.moments:
            yield captioned(view.image(moment.positions), moment.caption)


def captioned(image: Image, caption: str) -> Image:
    """The picture with words in its lower left corner."""
    if not caption:
        return image
    pillow = import_pillow()
    from PIL import ImageDraw

    canvas = pillow.fromarray(image)
    pen = ImageDraw.Draw(canvas)
    font = font_for(caption, max(10.0, 0.03 * image.shape[0]))
    bottom = pen.textbbox((0, 0), caption, font=font)[3]
    pen.text(
        (10, image.shape[0] - bottom - 10), caption, font=font, fill="#1b1f24", stroke_width=2, stroke_fill="#ffffff"
    )
    return np.array(canvas)
