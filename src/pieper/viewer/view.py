"""The whole window: an arm in its scene, the robot that moves it, panels, and who may use them."""

from __future__ import annotations

import html
import math
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pieper.atomic_file import write_text
from pieper.errors import PieperError
from pieper.kinematics.joints import as_joints
from pieper.motion.robot import RobotState
from pieper.viewer.arm_view import ArmView
from pieper.viewer.control import Control
from pieper.viewer.jog import JogPanel, home, turning
from pieper.viewer.scenery import SceneryPanel

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.model.chain import FloatArray
    from pieper.motion.robot import Robot
    from pieper.viewer.panel import Panel
    from pieper.viewer.server import Server

PERIOD = 1.0 / 30.0
"""Time between two pictures [s]."""

_NEAR, _FAR = (
    0.01,
    1000.0,
)  # [m]; nearer and further than these the browser draws nothing, unless the arm is of another scale
_WORD_STYLE = "padding:0.4em 0.8em;font-size:0.85em;line-height:1.35"
_LONGEST_STEP = 0.25  # [s]; a machine that was asleep does not make the arm leap


class View:
    """An arm in the browser.

    The robot is read some 30 times a second and shown; panels send it somewhere with `command`. A simulator, which has ``step``, is
    moved on with the time that has passed.

    Parameters
    ----------
    server : Server
    arm : Arm
    robot : Robot, optional
        What moves; by itself one that is wherever it is sent at once.
    panels : sequence of Panel
        Tabs after the jog panel; see `pieper.viewer.panel.Panel`.
    dark : bool
        Light or dark at the beginning.
    frames, axes : bool
        Drawn at the beginning or not.
    meshes : bool, optional
        See `pieper.viewer.mesh.bodies`.

    Attributes
    ----------
    server : Server
    arm : Arm
    robot : Robot
    arm_view : ArmView
    lock : threading.RLock
        Taken by whoever touches the robot or the arm.
    q : (n,) array
        Where the arm is [rad or m].
    target : (n,) array
        Where it has been sent [rad or m].
    size : float
        About how far it reaches [m].

    Examples
    --------
    >>> import pieper
    >>> from pieper.viewer.server import Server
    >>> with View(Server(port=0), pieper.load("mh12")) as view:
    ...     view.command([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    ...     view.step(0.1)
    ...     view.q.tolist()
    [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    """

    def __init__(
        self,
        server: Server,
        arm: Arm,
        robot: Robot | None = None,
        *,
        panels: Sequence[Panel] = (),
        dark: bool = False,
        frames: bool = False,
        axes: bool = False,
        meshes: bool | None = None,
    ) -> None:
        self.server = server
        self.arm = arm
        self.robot: Robot = AtOnce(arm) if robot is None else robot
        self.lock = threading.RLock()
        self.q: FloatArray = self.robot.read().q
        self.target: FloatArray = self.q
        self.size = reach(arm)
        self.jog = JogPanel()
        self.scenery = SceneryPanel(dark=dark, frames=frames, axes=axes)
        self.panels: tuple[Panel, ...] = (self.jog, *panels, self.scenery)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        server.gui.set_panel_label(f"{arm.name}  {arm.base} -> {arm.tip}")
        self.look(azimuth=-50.0, elevation=22.0)
        with server.atomic():
            self.arm_view = ArmView(server, "arm", arm, meshes=meshes)
            self.arm_view.update(self.q)
            self._word = server.gui.add_html("", visible=False)
            tabs = server.gui.add_tab_group()
            for panel in self.panels:
                with tabs.add_tab(panel.title):
                    panel.build(self)
        self.control = Control(server, on_lost=self.stop_motion)

    # --- for panels

    def command(self, q: ArrayLike) -> None:
        """Send the arm to joint values `q` (n,) [rad or m]; what is refused is told in the window.

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite.
        """
        with self.lock:
            values = np.array(as_joints(self.arm.chain, q))
            try:
                self.robot.command(values)
            except PieperError as error:
                self.say(str(error), bad=True)
                values = np.array(self.target)
            else:
                self.say("")
                values.setflags(write=False)
                self.target = values
            self._tell(values)

    def stop_motion(self) -> None:
        """Bring the arm to rest where it is, window or no window."""
        with self.lock:
            self.robot.stop()
            self.target = self.robot.read().q
            self._tell(self.target)

    def _tell(self, q: FloatArray) -> None:
        """Tell the panels where the arm is sent, while there is a page that they can write into."""
        if self.server.is_running:
            for panel in self.panels:
                panel.on_command(q)

    def limited(self, q: ArrayLike) -> FloatArray:
        """The joint values nearest to `q` (n,) within the limits."""
        return np.clip(np.asarray(q, dtype=np.float64), *self.arm.limits.T)

    def say(self, text: str, *, bad: bool = False) -> None:
        """Write a sentence above the tabs; an empty one takes it away."""
        if not self.server.is_running:
            return
        color = "#d63c3c" if bad else "inherit"
        content = f'<div style="color:{color};{_WORD_STYLE}">{html.escape(text)}</div>' if text else ""
        if (self._word.content, self._word.visible) != (content, bool(text)):
            self._word.content, self._word.visible = content, bool(text)

    def look(self, *, azimuth: float, elevation: float, distance: float | None = None) -> None:
        """Where the camera stands when a browser opens the view: angles [deg] about the middle of the arm, distance [m]."""
        around, up = math.radians(azimuth), math.radians(elevation)
        direction = np.array([math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)])
        middle = middle_of(self.arm, self.q)
        away = 1.9 * self.size if distance is None else distance
        camera = self.server.initial_camera
        camera.near = min(_NEAR, 1e-3 * self.size)
        camera.far = max(_FAR, 100.0 * self.size)
        camera.fov = math.radians(40.0)
        camera.look_at = middle
        camera.position = middle + away * direction

    # --- time

    def step(self, dt: float) -> None:
        """Let `dt` seconds pass: move a simulator on, read the robot, and show it."""
        with self.lock:
            move_on = getattr(self.robot, "step", None)
            if move_on is not None:
                move_on(dt)
            state = self.robot.read()
            if not self.server.is_running:
                self.q = state.q
                return
            with self.server.atomic():
                if not np.array_equal(state.q, self.q):
                    self.q = state.q
                    self.arm_view.update(state.q)
                    for panel in self.panels:
                        panel.on_state(state)
                for panel in self.panels:
                    panel.on_tick(dt)

    def start(self) -> None:
        """Let time pass by itself, in a thread."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="pieper-view", daemon=True)
            self._thread.start()

    def wait(self) -> None:
        """Return when the view is closed; Ctrl-C raises KeyboardInterrupt."""
        while not self._ended.wait(0.5):
            pass

    def _run(self) -> None:
        before = time.monotonic()
        while not self._ended.wait(PERIOD):
            now = time.monotonic()
            try:
                self.step(min(now - before, _LONGEST_STEP))
            except PieperError as error:  # a robot that has gone; the window stays, and tells
                self.say(str(error), bad=True)
            before = now

    def close(self) -> None:
        """End the panels, bring the arm to rest, and end the server."""
        with self.lock:
            if self._ended.is_set():
                return
            self._ended.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        with self.lock:
            for panel in self.panels:
                panel.close()
            self.robot.stop()
        self.server.stop()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- a page to keep

    def as_html(self) -> str:
        """The scene as one page that needs no server and no network; it can be turned and looked at, not moved."""
        with self.lock:
            return str(self.server.get_scene_serializer().as_html(dark_mode=self.scenery.dark))

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write `as_html` to a file, whole or not at all."""
        write_text(path, self.as_html())


class AtOnce:
    """A robot that is wherever it is sent, at once."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._q = home(arm)
        self._since = time.monotonic()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self._arm.joint_names

    def read(self) -> RobotState:
        """Where it is."""
        return RobotState(time.monotonic() - self._since, self._q, np.zeros(self._arm.dof))

    def command(self, q: ArrayLike | Mapping[str, float]) -> None:
        """Be at joint values (n,) [rad or m] at once."""
        chain = self._arm.chain
        values = dict(zip(self.joint_names, self._q.tolist(), strict=True)) | dict(q) if isinstance(q, Mapping) else q
        self._q = chain.named(values) if isinstance(values, dict) else np.array(as_joints(chain, values))

    def stop(self) -> None:
        """It never moves."""


def reach(arm: Arm) -> float:
    """About how far an arm reaches [m]: the way along its joints, and half the strokes of those that slide."""
    chain = arm.chain
    origins = np.array([frame.home[:3, 3] for frame in chain.frames])
    links = float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
    strokes = np.diff(arm.limits[~turning(arm)], axis=1)
    return max(links + 0.5 * float(strokes[np.isfinite(strokes)].sum()), 1e-3)


def middle_of(arm: Arm, q: FloatArray) -> FloatArray:
    """The middle of an arm at `q`, (3,) [m]."""
    points = arm.fk_frames(q)[:, :3, 3]
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))
