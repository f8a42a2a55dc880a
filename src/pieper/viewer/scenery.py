"""What stands around the arm, and how it is shown: ground, scale, frames, axes, the trace of the tip, light and dark."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.viewer.panel import Panel, Window

if TYPE_CHECKING:
    from pieper.model.chain import FloatArray
    from pieper.motion.robot import RobotState

MOST_TRACE_POINTS = 2000
_TRACE_PERIOD = 0.1  # [s]
_TRACE_COLOR = (220, 50, 70)
_GROUND_LIGHT, _SKY_LIGHT = (140, 142, 150), 3.5
_GRID = {False: ((214, 218, 224), (160, 166, 176)), True: ((60, 64, 70), (96, 102, 110))}


class Trace:
    """Where the tip has been: points no closer than `apart` [m], the newest `most` of them.

    Examples
    --------
    >>> trace = Trace(apart=0.1, most=3)
    >>> [trace.add(np.array([x, 0.0, 0.0])) for x in (0.0, 0.05, 0.1, 0.3, 0.5)]
    [True, False, True, True, True]
    >>> trace.segments[:, :, 0].tolist()
    [[0.1..., 0.3...], [0.3..., 0.5]]
    """

    def __init__(self, *, apart: float, most: int = MOST_TRACE_POINTS) -> None:
        self._apart = apart
        self._most = most
        self._points: list[FloatArray] = []

    def add(self, point: FloatArray) -> bool:
        """Take a point (3,) [m] up, unless it is next to the last one."""
        if self._points and float(np.linalg.norm(point - self._points[-1])) < self._apart:
            return False
        self._points = [*self._points[1 - self._most :], np.array(point)]
        return True

    def clear(self) -> None:
        """Forget every point."""
        self._points = []

    @property
    def segments(self) -> Any:
        """(k, 2, 3) float32 array [m]."""
        if len(self._points) < 2:
            return np.empty((0, 2, 3), np.float32)
        points = np.array(self._points, np.float32)
        return np.stack([points[:-1], points[1:]], axis=1)


def round_length(length: float) -> float:
    """The greatest of 1, 2, 5 times a power of ten that is not above `length`.

    >>> round_length(0.37), round_length(1.9), round_length(7.0)
    (0.2, 1.0, 5.0)
    """
    power = 10.0 ** math.floor(math.log10(length))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= length * (1.0 + 1e-9))


class SceneryPanel(Panel):
    """How the arm is shown.

    Parameters
    ----------
    dark : bool
    frames, axes, trace : bool
        What is drawn at the beginning.
    """

    title = "View"

    def __init__(self, *, dark: bool = False, frames: bool = False, axes: bool = False, trace: bool = True) -> None:
        self.dark = dark
        self._begin = {"frames": frames, "axes": axes, "trace": trace}
        self._since = 0.0
        self._stale = False

    def build(self, view: Window) -> None:
        """Make the ground and the controls."""
        self._view = view
        self.trace = Trace(apart=0.002 * view.size)
        scene, gui = view.server.scene, view.server.gui
        scene.configure_default_lights(cast_shadow=False)  # shadows of the arm on itself are drawn in stripes
        scene.configure_environment_map(hdri=None)  # without a graphics card a browser works on one for seconds
        scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=_GROUND_LIGHT, intensity=_SKY_LIGHT)
        self._grid: Any = None
        self._line: Any = None
        self._dark = gui.add_checkbox("Dark", self.dark)
        self._frames = gui.add_checkbox("Frames", self._begin["frames"])
        self._names = gui.add_checkbox("Names of frames", True)
        self._axes = gui.add_checkbox("Joint axes", self._begin["axes"])
        self._traced = gui.add_checkbox("Trace of the tip", self._begin["trace"])
        self._ground = gui.add_checkbox("Ground and scale", True)
        self._opacity = gui.add_slider("Opacity", 0.1, 1.0, 0.05, 1.0)
        for control in (self._dark, self._frames, self._names, self._axes, self._traced, self._ground, self._opacity):
            control.on_update(self._changed)
        gui.add_button("Clear the trace").on_click(self._clear)
        self._draw_ground()
        self._apply()

    def _changed(self, event: Any) -> None:
        with self._view.lock:
            if event.target is self._dark:
                self.dark = self._dark.value
                self._draw_ground()
            self._apply()

    def _apply(self) -> None:
        view = self._view
        view.arm_view.show_frames(self._frames.value, names=self._names.value)
        view.arm_view.show_axes(self._axes.value)
        view.arm_view.opacity = self._opacity.value
        for node in self._ground_nodes:
            node.visible = self._ground.value
        if self._line is not None:
            self._line.visible = self._traced.value

    def _draw_ground(self) -> None:
        """A grid whose lines are a round length apart, with that length written beside it."""
        view = self._view
        scene = view.server.scene
        view.server.gui.configure_theme(dark_mode=self.dark, show_logo=False, show_share_button=False)
        cell = round_length(0.25 * view.size)
        cells, sections = _GRID[self.dark]
        width = 2.0 * math.ceil(1.6 * view.size / cell) * cell
        grid = scene.add_grid(
            "/ground/grid",
            width,
            width,
            cell_size=cell,
            cell_color=cells,
            section_size=5.0 * cell,
            section_color=sections,
            cell_thickness=0.8,
            section_thickness=1.2,
        )
        at = -0.5 * width
        ends = np.array([[[at, at, 0.0], [at + cell, at, 0.0]]], np.float32)
        bar = scene.add_line_segments("/ground/scale", ends, (230, 120, 30), thickness=0.01 * view.size)
        label = scene.add_label("/ground/scale_name", f"{cell:g} m", position=(at + cell, at, 0.0))
        self._ground_nodes = [grid, bar, label]

    def _clear(self, _: Any) -> None:
        with self._view.lock:
            self.trace.clear()
            self._stale = True

    def on_state(self, state: RobotState) -> None:
        """The tip is somewhere else."""
        if self._traced.value and self.trace.add(self._view.arm.fk(state.q)[:3, 3]):
            self._stale = True

    def on_tick(self, dt: float) -> None:
        """Draw the trace, some ten times a second."""
        self._since += dt
        if not self._stale or self._since < _TRACE_PERIOD:
            return
        self._stale, self._since = False, 0.0
        segments = self.trace.segments
        if self._line is None:
            if len(segments):
                self._line = self._view.server.scene.add_line_segments(
                    "/trace", segments, _TRACE_COLOR, thickness=2.0, thickness_units="screen"
                )
        else:
            self._line.points = segments
            self._line.visible = self._traced.value and len(segments) > 0
