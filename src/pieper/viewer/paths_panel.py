"""Motions in the browser: arms that go along their paths, traces, a time to play and to run through, and plots beside the scene."""

from __future__ import annotations

import html
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.viewer.arm_view import ArmView
from pieper.viewer.panel import Panel, Window, on_event
from pieper.viewer.paths import Player, Plot, Track

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from viser import GuiApi

    from pieper.spatial._checks import FloatArray
    from pieper.viewer.surface import Color

_PLAY, _PAUSE, _BACK = "play", "pause", "to the start"
_PLOTS = ("joints", "tip", "error")
_OF_SLIDER = 1000  # steps of the slider of time
_DIGITS = 3  # of the time that is shown [s]
_NOW_PERIOD = 0.2  # [s] between two marks of the time in the plot
_SPEEDS = (0.01, 100.0)
_WIDTH = 340  # of the window of plots [px]
_CURVES: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666")


class PathsPanel(Panel):
    """A tab of the viewer that plays motions, and a window beside the scene with their curves.

    Each motion has an arm of its own; the arm of the other panels is hidden meanwhile, and comes back when it is sent somewhere.

    Parameters
    ----------
    tracks : sequence of Track
        At least one.
    playing : bool
        Whether it plays from the beginning.

    Attributes
    ----------
    player : Player
    arm_views : list of ArmView
        One for each motion.
    buttons, time, loop, speed, send, shown, plotted, curves, summary, plot
        The controls of viser; `shown` is one for each motion.

    Raises
    ------
    ArrayError
        There is no motion.
    """

    title = "Paths"

    def __init__(self, tracks: Sequence[Track], *, playing: bool = False) -> None:
        if not tracks:
            raise ArrayError("tracks must hold at least one motion to be played")
        self.player = Player(tracks)
        self._plays_first = playing
        self._quiet = False  # while the panel itself writes into its boxes
        self._closed = False
        self._drawn: float | None = None
        self._since_mark = 0.0
        self._plot: Plot | None = None

    def build(self, view: Window) -> None:
        """Make the arms, their traces and the controls."""
        self._view = view
        several = len(self.player.tracks) > 1
        self.arm_views: list[ArmView] = []
        self._traces: list[list[Any]] = []
        for number, track in enumerate(self.player.tracks):
            name = f"paths/{number}"
            own = track.color if several else None
            self.arm_views.append(ArmView(view.server, name, track.arm, color=own, opacity=0.75 if several else 1.0))
            self._traces.append(self._trace(f"/{name}_trace", track))
        view.arm_view.visible = False
        self._build_controls(view.server.gui)
        self._build_plots(view.server.gui)
        if self._plays_first:
            self.player.play()
        self._write()
        self._draw()

    def _trace(self, name: str, track: Track) -> list[Any]:
        """The path of the tip: a line, and for an iteration a dot for each step."""
        scene = self._view.server.scene
        tips = track.tips(track.times).astype(np.float32)
        nodes: list[Any] = []
        if len(tips) > 1:
            ends = np.stack([tips[:-1], tips[1:]], axis=1)
            nodes.append(scene.add_line_segments(name, ends, track.color, thickness=3.0, thickness_units="screen"))
        if track.errors is not None or len(tips) == 1:
            size = 0.004 * self._view.size
            nodes.append(
                scene.add_point_cloud(f"{name}_steps", tips, track.color, point_size=size, point_shape="circle")
            )
        return nodes

    def _build_controls(self, gui: GuiApi) -> None:
        tracks = self.player.tracks
        self.buttons: Any = gui.add_button_group("Motion", (_PLAY, _PAUSE, _BACK))
        self.time: Any = gui.add_slider(
            "Time [s]", min=0.0, max=self._end, step=self._end / _OF_SLIDER, initial_value=0.0
        )
        self.loop: Any = gui.add_checkbox("Loop", self.player.loop)
        self.speed: Any = gui.add_number("Speed", self.player.speed, min=_SPEEDS[0], max=_SPEEDS[1], step=0.1)
        self.send: Any = gui.add_button("Send the arm here", hint="The arm of the other panels, within its limits")
        self.summary: Any = gui.add_html("".join(_line(track) for track in tracks))
        self.shown: list[Any] = [gui.add_checkbox(_short(track, tracks), True) for track in tracks]
        self.buttons.on_click(self._when(self._pressed))
        self.send.on_click(self._when(self._sent))
        self.time.on_update(self._when(self._sought))
        self.loop.on_update(self._when(self._looped))
        self.speed.on_update(self._when(self._hurried))
        for number, box in enumerate(self.shown):
            box.on_update(self._when(partial(self._shown_changed, number)))

    def _build_plots(self, gui: GuiApi) -> None:
        names = tuple(_short(track, self.player.tracks) for track in self.player.tracks)
        window = gui.add_panel()
        with window.add_tab("Curves"):
            self.plotted: Any = gui.add_dropdown("Of", names, visible=len(names) > 1)
            self.curves: Any = gui.add_dropdown("Curves", self._kinds())
            self.plot: Any = None
            self._plot_window = gui.add_folder("Plot", expand_by_default=True)
        window.dock_left()
        window.set_width(_WIDTH)
        self.plotted.on_update(self._when(self._choose_plot))
        self.curves.on_update(self._when(self._make_plot))
        self._make_plot()

    # --- what others call

    def on_tick(self, dt: float) -> None:
        """The clock of the motions runs on."""
        was_playing = self.player.playing
        self.player.advance(dt)
        self._draw()
        self._since_mark += dt
        if was_playing and (self._since_mark >= _NOW_PERIOD or not self.player.playing):
            self._mark()

    def on_command(self, q: FloatArray) -> None:
        """Another panel moves the arm: it is seen again."""
        if not self._quiet and not self._closed:
            self._view.arm_view.visible = True

    def close(self) -> None:
        """Nothing is drawn any more."""
        self._closed = True

    def seek(self, time: float) -> None:
        """Go to a time [s]."""
        with self._view.lock:
            self.player.seek(time)
            self._write()
            self._draw()
            self._mark()

    def show(self, number: int, shown: bool) -> None:
        """Show or hide one of the motions."""
        with self._view.lock, self._view.server.atomic():
            self.arm_views[number].visible = shown
            for node in self._traces[number]:
                node.visible = shown

    # --- what people do

    def _when(self, act: Callable[[], None]) -> Callable[[Any], None]:
        return on_event(
            self._view, act, complain=lambda words: self._view.say(words, bad=True), quiet=lambda: self._quiet
        )

    def _pressed(self) -> None:
        if self.buttons.value == _PLAY:
            self._view.arm_view.visible = False
            self.player.play()
        else:
            self.player.pause()
            self._mark()
        if self.buttons.value == _BACK:
            self.seek(0.0)

    def _sent(self) -> None:
        number = self._number()
        self._view.command(self._view.limited(self.player.tracks[number].at(self.player.time)))

    def _sought(self) -> None:
        self._view.arm_view.visible = False
        self.player.pause()
        self.seek(self.time.value)

    def _looped(self) -> None:
        self.player.loop = self.loop.value

    def _hurried(self) -> None:
        if not _SPEEDS[0] <= self.speed.value <= _SPEEDS[1]:
            self._quiet, wrong, self.speed.value = True, self.speed.value, self.player.speed
            self._quiet = False
            raise ArrayError(f"speed must be from {_SPEEDS[0]:g} to {_SPEEDS[1]:g}, got {wrong:g}")
        self.player.speed = self.speed.value

    def _shown_changed(self, number: int) -> None:
        self.show(number, self.shown[number].value)

    def _choose_plot(self) -> None:
        kinds = self._kinds()
        if kinds != self.curves.options:
            self.curves.options = kinds
        self._make_plot()

    # --- what is drawn and written

    @property
    def _end(self) -> float:
        """Of the slider of time; a motion of one point has none."""
        return self.player.duration or 1.0

    def _draw(self) -> None:
        if self.player.time == self._drawn:
            return
        self._drawn = self.player.time
        with self._view.server.atomic():
            for arm_view, q in zip(self.arm_views, self.player.poses(), strict=True):
                arm_view.update(q)
            self._write()

    def _write(self) -> None:
        """Where the clock stands."""
        self._quiet = True
        try:
            self.time.value = round(min(self.player.time, self._end), _DIGITS)
        finally:
            self._quiet = False

    def _number(self) -> int:
        return int(self.plotted.options.index(self.plotted.value))

    def _kinds(self) -> tuple[str, ...]:
        return _PLOTS if self.player.tracks[self._number()].errors is not None else _PLOTS[:-1]

    def _make_plot(self) -> None:
        track = self.player.tracks[self._number()]
        made = {"joints": track.joint_plot, "tip": track.tip_plot, "error": track.error_plot}[self.curves.value]()
        self._plot = made
        if self.plot is not None:
            self.plot.remove()
        if made is None:
            return
        logarithmic = self.curves.value == "error"
        series: list[Any] = [{"label": made.x_label}]
        series += [
            {"label": name, "stroke": color, "width": 2.0, "points": {"show": logarithmic}}
            for name, color in zip(made.names, _cycled(len(made.names)), strict=True)
        ]
        series.append(
            {
                "label": "now",
                "stroke": "#cd2828",
                "width": 0.0,
                "points": {"show": True, "size": 8.0, "fill": "#cd2828"},
            }
        )
        with self._plot_window:
            self.plot = self._view.server.gui.add_uplot(
                self._data(made),
                tuple(series),
                scales={
                    "x": {"time": False},
                    "y": {"distr": 3 if logarithmic else 1, "range": _around(made.y, logarithmic)},
                },
                axes=(
                    {"label": made.x_label, "labelSize": 20.0, "size": 34.0},
                    {"label": made.y_label, "labelSize": 20.0, "size": 56.0},
                ),
                legend={"show": True, "live": False},
                height=300,
            )

    def _mark(self) -> None:
        """Mark the time in the plot."""
        self._since_mark = 0.0
        if self.plot is not None and self._plot is not None:
            self.plot.data = self._data(self._plot)

    def _data(self, made: Plot) -> tuple[FloatArray, ...]:
        """The curves, and a last one that has a value only now, on the first curve."""
        track = self.player.tracks[self._number()]
        now = self.player.time
        if self.curves.value == "error" and track.duration > 0.0:
            now *= (track.trajectory.t.size - 1) / track.duration
        mark = np.full(made.x.shape, np.nan)
        here = int(np.argmin(np.abs(made.x - now)))
        mark[here] = made.y[0, here]
        return made.x, *made.y, mark


def _around(y: FloatArray, logarithmic: bool) -> tuple[float, float]:
    """From where to where an axis goes that holds some values; without it the values of the mark, mostly NaN, would count."""
    if logarithmic:
        seen = y[y > 0.0]
        low, high = (float(seen.min()), float(seen.max())) if seen.size else (0.1, 1.0)
        return 10.0 ** np.floor(np.log10(low)), 10.0 ** np.ceil(np.log10(1.001 * high))
    low, high = float(y.min()), float(y.max())
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _cycled(count: int) -> list[str]:
    return [_CURVES[k % len(_CURVES)] for k in range(count)]


def _short(track: Track, tracks: Sequence[Track]) -> str:
    """The name of a motion, with a number where it is not the only one of that name."""
    same = [other for other in tracks if other.name == track.name]
    return track.name if len(same) == 1 else f"{track.name} ({same.index(track) + 1})"


def _line(track: Track) -> str:
    color: Color = track.color
    return (
        f'<div style="padding:0.2em 0.8em;font-size:0.85em"><span style="color:rgb{color}">&#9632;</span> '
        f"<b>{html.escape(track.name)}</b>: {html.escape(track.summary)}</div>"
    )
