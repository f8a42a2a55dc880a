"""Pick and place in the browser, while it runs: the arm, its hand, and the things, on this machine alone."""

from __future__ import annotations

import html
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.model.description import Box, Sphere
from pieper.sim.mujoco_arm import quaternion
from pieper.sim.stage import rgb
from pieper.viewer.arm_view import ArmView
from pieper.viewer.server import Server

if TYPE_CHECKING:
    from pieper.model.chain import FloatArray
    from pieper.sim.scene import Solid
    from pieper.tasks.pick import PickAndPlace

_FRAME = 1.0 / 25.0  # [s]
_LINES = 12  # of the log that are shown
_LOADING = 1.5  # [s] that a page takes to be there
_GROUND = ((222, 225, 230), (190, 195, 202))


class PickView:
    """Shows a run from now on, in real time: the simulator waits for the clock. A context manager.

    Parameters
    ----------
    run : PickAndPlace
    port : int, optional
        See `pieper.viewer.server.Server`.

    Attributes
    ----------
    url : str
        What to open in a browser.

    Raises
    ------
    MissingExtraError
        viser is not installed.
    """

    def __init__(self, run: PickAndPlace, *, port: int | None = None) -> None:
        self._run, self._robot = run, run.robot
        self.server = Server(port, label=run.task.name)
        self.url = self.server.url
        self._lines: list[str] = []
        scene, task = self.server.scene, run.task
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map(hdri=None)
        scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(140, 142, 150), intensity=3.5)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._log = self.server.gui.add_html("")
        self._arm = ArmView(self.server, "arm", task.arm)
        self._hand = scene.add_frame("/hand", show_axes=False)
        self._parts = {
            name: self._add(f"/hand/{name}", solid, task.gripper.color if name == "palm/plate" else "#8d99a6", T)
            for name, (solid, T) in task.gripper.solids().items()
        }
        self._things = {
            thing.name: self._add(f"/things/{thing.name}", thing.solid, thing.color, thing.T_world_object)
            for thing in task.scene.objects
        }
        if task.scene.floor is not None:
            scene.add_grid(
                "/floor", 12.0, 12.0, cell_size=0.5, section_size=0.5, cell_color=_GROUND[0], section_color=_GROUND[1],
                position=(0.0, 0.0, task.scene.floor),
            )  # fmt: skip
        if task.scene.cameras:
            first = task.scene.cameras[0]
            where, ahead = first.T_world_camera[:3, 3], first.T_world_camera[:3, 2]
            camera = self.server.initial_camera
            camera.position, camera.fov = where, first.field_of_view
            camera.look_at = where + ahead * float(np.linalg.norm(where))
        self._began, self._shown = time.monotonic() - self._robot.time, -np.inf
        self.show()
        self._robot.observers.append(self._observe)

    def _add(self, name: str, solid: Solid, color: str, T: FloatArray) -> Any:
        scene: Any = self.server.scene
        paint = tuple(int(255 * part) for part in rgb(color))
        place: dict[str, Any] = {"position": T[:3, 3], "wxyz": quaternion(T[:3, :3])}
        if isinstance(solid, Box):
            return scene.add_box(name, paint, tuple(map(float, solid.size)), **place)
        if isinstance(solid, Sphere):
            return scene.add_icosphere(name, solid.radius, paint, **place)
        return scene.add_cylinder(name, solid.radius, solid.length, paint, **place)

    def show(self) -> None:
        """Draw everything where it is now."""
        robot, task = self._robot, self._run.task
        with self.server.atomic():
            self._arm.update(robot.read().q)
            T = robot.tip() @ task.gripper.T_tip_mount
            self._hand.position, self._hand.wxyz = T[:3, 3], quaternion(T[:3, :3])
            for name, (_, T_part) in task.gripper.solids(self._run.gripper.width).items():
                if name.startswith("finger/"):
                    self._parts[name].position = T_part[:3, 3]
            for thing in task.scene.objects:
                if thing.moves:
                    T = robot.pose(thing.name)
                    self._things[thing.name].position = T[:3, 3]
                    self._things[thing.name].wxyz = quaternion(T[:3, :3])

    def say(self, line: str) -> None:
        """Write a line below the others."""
        self._lines = [*self._lines[1 - _LINES :], html.escape(line)]
        self._log.content = f'<pre style="font-size:0.7em;white-space:pre-wrap">{chr(10).join(self._lines)}</pre>'

    @property
    def is_watched(self) -> bool:
        """Whether a page is open."""
        return bool(self.server.get_clients())

    def wait_for_page(self, *, longest: float) -> bool:
        """Wait until a page is open, so many seconds at most; whether one is. Time in the simulation stands still meanwhile."""
        end = time.monotonic() + longest
        while not self.is_watched and time.monotonic() < end and not self._run.cancelled:
            time.sleep(0.1)
        if self.is_watched:
            time.sleep(_LOADING)
        self._began = time.monotonic() - self._robot.time
        return self.is_watched

    def _observe(self) -> None:
        if self._robot.time < self._shown + _FRAME:
            return
        self._shown = self._robot.time
        self.show()
        late = time.monotonic() - self._began - self._robot.time
        if late < 0.0:
            time.sleep(-late)
        elif late > _FRAME:  # planning took a while, or the machine is slow: what is lost is not made up for
            self._began += late

    def close(self) -> None:
        """End the page."""
        if self._observe in self._robot.observers:
            self._robot.observers.remove(self._observe)
        self.server.stop()

    def __enter__(self) -> PickView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
