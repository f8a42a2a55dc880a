"""Drag to solve: a handle at the tip, every solution as a ghost, and the panel that steps through them."""

from __future__ import annotations

import html
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.spatial import rotation
from pieper.viewer.arm_view import GhostsView, frame_size
from pieper.viewer.panel import Panel, Window, on_event
from pieper.viewer.solve import Kind, Solved, Solving

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from viser import GuiApi, SceneApi

    from pieper.spatial._checks import FloatArray
    from pieper.viewer.surface import Color

RED: Color = (205, 40, 40)
"""Of an arm that does not meet its target."""

AMBER: Color = (225, 155, 20)
"""Of solutions outside the joint limits."""

BLUE: Color = (40, 120, 220)
"""Of the other solutions."""

GHOSTS = 16
"""Ghosts at most."""

_WORDS: dict[str, tuple[Kind, str | None]] = {
    "position and orientation": ("pose", None),
    "position only": ("position", None),
    "position and tool x": ("axis", "x"),
    "position and tool y": ("axis", "y"),
    "position and tool z": ("axis", "z"),
}
_NONE = "none"
_PREVIOUS, _NEXT = "previous", "next"
_SAME = 1e-9  # of the entries of two rotations
_DIGITS_OF_METRES, _DIGITS_OF_DEGREES = 9, 7
_SHARE = 1000  # steps of the slider along a curve


class SolvePanel(Panel):
    """A tab of the viewer in which the target of the arm is dragged about.

    The solution taken is what the arm is sent to. Where nothing meets the target the arm stays, and what comes nearest is drawn in red
    beside it, with a red line from its tip to the target.
    Events of a drag that come faster than they are drawn are left out: only the latest pose of the handle counts. Numbers that are
    not finite are told and put back.

    Parameters
    ----------
    shown : bool
        Whether handle and ghosts are shown from the beginning.
    kind, axis, keep_branch
        As for `Solving`, which is made when the panel is built.

    Attributes
    ----------
    solving : Solving
    ghosts : GhostsView
        The solutions that are not taken.
    apart : GhostsView
        What the arm is not sent to: in red what comes nearest to a target that is not met, in amber a solution outside the limits.
    gizmo, message, kind, position, rpy, solutions, step_buttons, along, keep_branch, shown
        The controls of viser.
    """

    title = "Solve"

    def __init__(
        self, *, shown: bool = False, kind: Kind | None = None, axis: str = "z", keep_branch: bool = True
    ) -> None:
        self._options: dict[str, Any] = {"kind": kind, "axis": axis, "keep_branch": keep_branch, "most": GHOSTS}
        self._shown = shown
        self._quiet = False  # while the panel itself writes into its boxes
        self._closed = False
        self._own = False  # while the panel itself sends the arm somewhere
        self._drawn: Solved | None = None
        self._dragged: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._span: tuple[float, float, float] | None = None

    def build(self, view: Window) -> None:
        """Make the controls and what they move in the scene."""
        self._view = view
        self.solving = Solving(view.arm, view.q, **self._options)
        self._build_scene(view.server.scene)
        self._build_controls(view.server.gui)
        self.redraw(command=False)

    def _build_scene(self, scene: SceneApi) -> None:
        arm = self._view.arm
        size = frame_size(arm)
        self._root = scene.add_frame("/solve", show_axes=False, visible=self._shown)
        self.ghosts = GhostsView(self._view.server, "solve/ghosts", arm, color=BLUE, opacity=0.3)
        self.apart = GhostsView(self._view.server, "solve/apart", arm, color=RED, opacity=0.55)
        self._gap = scene.add_line_segments(
            "/solve/gap", np.zeros((1, 2, 3)), RED, thickness=3.0, thickness_units="screen", visible=False
        )
        self.gizmo = scene.add_transform_controls("/solve/target", scale=1.8 * size, line_width=3.0, depth_test=False)
        self.gizmo.on_update(self._on_drag)

    def _build_controls(self, gui: GuiApi) -> None:
        self.message: Any = gui.add_html("")
        self.shown: Any = gui.add_checkbox("Handle and ghosts", self._shown)
        self.kind: Any = gui.add_dropdown("Target", tuple(_WORDS), initial_value=self._words_of(self.solving.solved))
        self.position: list[Any] = [gui.add_number(f"{name} [m]", 0.0, step=0.001) for name in "xyz"]
        self.rpy: list[Any] = [gui.add_number(f"{name} [deg]", 0.0, step=0.1) for name in ("roll", "pitch", "yaw")]
        for boxes, digits in ((self.position, _DIGITS_OF_METRES), (self.rpy, _DIGITS_OF_DEGREES)):
            for box in boxes:
                box.precision = digits
        self.solutions: Any = gui.add_dropdown("Solution", (_NONE,), hint="All that were found")
        self.step_buttons: Any = gui.add_button_group("Step", (_PREVIOUS, _NEXT), hint="Also with the keys P and N")
        self.along: Any = gui.add_slider(
            "Self-motion", min=0, max=_SHARE, step=1, initial_value=0,
            hint="Moves the arm while its tip stays, from end to end of what its limits allow",
        )  # fmt: skip
        self.keep_branch: Any = gui.add_checkbox(
            "Stay on the branch", self.solving.keep_branch, hint="Else the solution nearest to the arm is taken"
        )
        for control, act in (
            (self.shown, self._toggled),
            (self.kind, self._ask),
            *((box, self._typed) for box in (*self.position, *self.rpy)),
            (self.solutions, self._chosen),
            (self.along, self._slid),
            (self.keep_branch, self._kept),
        ):
            control.on_update(self._when(act))
        self.step_buttons.on_click(self._when(self._stepped))
        gui.add_command("Next solution", hotkey="N").on_trigger(self._when(self.next))
        gui.add_command("Previous solution", hotkey="P").on_trigger(self._when(self.previous))

    # --- what others call

    def on_command(self, q: FloatArray) -> None:
        """The arm was sent elsewhere by another panel: the target goes where its tip will be."""
        if not self._own and not self._closed:
            self.solving.put(q)
            self.redraw(command=False)

    def close(self) -> None:
        """Nothing is drawn any more; the one in control leaves when the server ends, which stops the arm."""
        self._closed = True

    def next(self) -> None:
        """Take the next solution."""
        self.solving.step(1)
        self.redraw()

    def previous(self) -> None:
        """Take the solution before."""
        self.solving.step(-1)
        self.redraw()

    def show(self, shown: bool) -> None:
        """Show or hide handle and ghosts."""
        with self._view.lock, self._writing():
            self._shown = self.shown.value = self._root.visible = shown
            self._drawn = None
            self.redraw(command=False)

    def redraw(self, *, command: bool = True, dragging: bool = False) -> None:
        """Draw the state of `solving`, and send the arm to the solution taken."""
        with self._view.lock, self._view.server.atomic(), self._writing():
            solved, before = self.solving.solved, self._drawn
            self._drawn = solved
            if command and solved.reached:
                self._own = True
                try:
                    self._view.command(self._view.limited(self.solving.q))
                finally:
                    self._own = False
            if self._shown:
                self._draw_solutions(solved)
            self._write_target(solved, before, dragging=dragging)
            self._write_solutions(solved)
            self.message.content = _said(solved.sentence, red=not solved.reached)
            if not dragging:
                self._write_span()

    # --- what people do

    def _when(self, act: Callable[[], None]) -> Callable[[Any], None]:
        def complain(words: str) -> None:
            self.message.content = _said(words, red=True)

        return on_event(self._view, act, complain=complain, quiet=lambda: self._quiet)

    def _on_drag(self, event: Any) -> None:
        """The handle moves. An event that comes late finds the latest pose solved already."""
        with self._view.lock:
            pose = tuple(map(float, self.gizmo.position)), tuple(map(float, self.gizmo.wxyz))
            dragging = event.phase != "end"
            if pose == self._dragged and dragging:
                return
            self._dragged = pose
            w, x, y, z = pose[1]
            before = self.solving.solved.T_base_target
            solved = self.solving.move_to(pose[0], xyzw=(x, y, z, w), dragging=dragging)
            self.redraw(dragging=dragging)
            if solved.T_base_target is before:  # refused: back to where it was
                self._put_gizmo(solved)

    def _typed(self) -> None:
        self.solving.move_to([box.value for box in self.position], self._typed_rpy())
        self.redraw()

    def _ask(self) -> None:
        kind, axis = _WORDS[self.kind.value]
        self.solving.ask_for(kind, axis=axis)
        self.redraw()

    def _chosen(self) -> None:
        if self.solutions.value != _NONE:
            self.solving.choose(self.solutions.options.index(self.solutions.value))
            self.redraw()

    def _stepped(self) -> None:
        (self.next if self.step_buttons.value == _NEXT else self.previous)()

    def _slid(self) -> None:
        if self._span is not None:
            start, end, _ = self._span
            self.solving.slide(start + (end - start) * self.along.value / _SHARE)
            self.redraw(dragging=True)  # the span stays: it is of the same curve

    def _kept(self) -> None:
        self.solving.keep_branch = self.keep_branch.value

    def _toggled(self) -> None:
        self.show(self.shown.value)

    # --- what is drawn and written

    def _draw_solutions(self, solved: Solved) -> None:
        inside = solved.inside if solved.chosen is None else np.delete(solved.inside, solved.chosen)
        self.ghosts.update(solved.ghosts, colors=[BLUE if within else AMBER for within in inside])
        apart = None if solved.reached else solved.q_shown  # what the arm is not sent to
        if apart is not None:
            self.apart.update(apart, colors=[RED if solved.chosen is None else AMBER])
            ends = np.stack([self.solving.arm.fk(apart)[:3, 3], solved.T_base_target[:3, 3]])
            self._gap.points = ends[None].astype(np.float32)
        elif self.apart.count:
            self.apart.update(np.empty((0, self.solving.arm.dof)))
        if self._gap.visible != (apart is not None):
            self._gap.visible = apart is not None

    def _put_gizmo(self, solved: Solved) -> None:
        T = solved.T_base_target
        self.gizmo.position, self.gizmo.wxyz = T[:3, 3], _wxyz(T)
        self._dragged = tuple(map(float, self.gizmo.position)), tuple(map(float, self.gizmo.wxyz))

    def _write_target(self, solved: Solved, before: Solved | None, *, dragging: bool) -> None:
        if before is None or before.T_base_target is not solved.T_base_target or solved.notice:
            T = solved.T_base_target
            self._fill(self.position, T[:3, 3])
            typed = self._typed_rpy()
            # at a gimbal lock many triples are one orientation: what was typed stays
            if not np.isfinite(typed).all() or np.abs(rotation.from_rpy(typed) - T[:3, :3]).max() > _SAME:
                self._fill(self.rpy, np.degrees(rotation.as_rpy(T[:3, :3])))
            if not dragging:
                self._put_gizmo(solved)
        if before is None or before.kind != solved.kind:
            self.gizmo.disable_rotations = solved.kind == "position"
            self.kind.value = self._words_of(solved)
            for box in self.rpy:
                box.visible = solved.kind != "position"

    def _typed_rpy(self) -> FloatArray:
        return np.radians(np.array([box.value for box in self.rpy], dtype=np.float64))

    @staticmethod
    def _fill(boxes: list[Any], values: FloatArray) -> None:
        for box, value in zip(boxes, values.tolist(), strict=True):
            box.value = value + 0.0  # no minus before zero

    def _write_solutions(self, solved: Solved) -> None:
        names = tuple(
            f"{number + 1}  {label}{'' if inside else '  (outside limits)'}"
            for number, (label, inside) in enumerate(zip(solved.labels, solved.inside, strict=True))
        ) or (_NONE,)
        if names != self.solutions.options:
            self.solutions.options = names
        self.solutions.value = names[solved.chosen or 0]

    def _write_span(self) -> None:
        free = self.solving.solved.free == 1 or self.solving.arm.dof > 6
        self._span = self.solving.span() if free else None
        known = self._span is not None and self._span[1] > self._span[0]
        self.along.visible = free
        self.along.disabled = not known
        if self._span is not None and known:
            start, end, here = self._span
            self.along.value = round(_SHARE * (here - start) / (end - start))

    def _words_of(self, solved: Solved) -> str:
        axis = self.solving.axis if solved.kind == "axis" else None
        return next(words for words, meant in _WORDS.items() if meant == (solved.kind, axis))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """What is written into boxes meanwhile is not taken for typed."""
        before, self._quiet = self._quiet, True
        try:
            yield
        finally:
            self._quiet = before


def _said(sentence: str, *, red: bool) -> str:
    color = "#d63c3c" if red else "inherit"
    return f'<div style="color:{color};padding:0.4em 0.8em;font-size:0.85em;line-height:1.35">{html.escape(sentence)}</div>'


def _wxyz(T: FloatArray) -> FloatArray:
    return np.roll(rotation.as_quaternion(T[:3, :3]), 1)
