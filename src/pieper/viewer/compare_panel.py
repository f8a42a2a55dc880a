"""Two models of an arm in one scene, one upon the other or side by side, with the difference of their tips as numbers."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.viewer.arm_view import ArmView, frame_size
from pieper.viewer.compare import Comparison, Difference
from pieper.viewer.panel import Panel, Window, on_event

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import GuiApi

    from pieper.arm import Arm
    from pieper.motion.robot import RobotState
    from pieper.spatial._checks import FloatArray
    from pieper.viewer.surface import Color

GREEN: Color = (0, 150, 110)
"""Of the second model."""

_LINE: Color = (205, 40, 40)
_UPON, _BESIDE = "one upon the other", "side by side"
_SAMPLES = 2000
_MOST = 100_000
_NOTHING, _ROUNDING = 1e-17, 1e-7  # [m or rad] between them a difference is written with its power of ten
_SMALL = 1e-9  # [m] less than this is not drawn as a line


class ComparePanel(Panel):
    """A tab of the viewer with a second model of the arm.

    The second model follows the arm joint by joint, by the rules of `pieper.viewer.compare.Comparison`, which the tab lists.

    Parameters
    ----------
    other : Arm
    signs : sequence of 1 and -1, optional
        As for `Comparison`.
    names : tuple of 2 str, optional
        As for `Comparison`.
    beside : bool
        Whether the models stand side by side from the beginning.

    Attributes
    ----------
    comparison : Comparison
        Made when the panel is built.
    other_view : ArmView
        The second model in the scene.
    live, rules, spread, solved, placing, samples, random, go, solve
        The controls of viser.
    """

    title = "Compare"

    def __init__(
        self, other: Arm, *, signs: list[float] | None = None, beside: bool = True, names: tuple[str, str] | None = None
    ) -> None:
        self._other = other
        self._names = names
        self._signs = signs
        self._beside = beside
        self._worst: FloatArray | None = None

    def build(self, view: Window) -> None:
        """Make the controls and the second model."""
        self._view = view
        self.comparison = Comparison(view.arm, self._other, signs=self._signs, names=self._names)
        self.other_view = ArmView(view.server, "compare/other", self._other, color=GREEN)
        self._gap = view.server.scene.add_line_segments(
            "/compare/gap", np.zeros((1, 2, 3)), _LINE, thickness=3.0, thickness_units="screen", visible=False
        )
        self._gap_label = view.server.scene.add_label("/compare/gap_label", "", visible=False)
        self._build_controls(view.server.gui)
        self.place(beside=self._beside)

    def _build_controls(self, gui: GuiApi) -> None:
        self.live: Any = gui.add_html("")
        self.placing: Any = gui.add_dropdown(
            "Models", (_UPON, _BESIDE), initial_value=_BESIDE if self._beside else _UPON
        )
        self.placing.on_update(self._when(lambda: self.place(beside=self.placing.value == _BESIDE)))
        with gui.add_folder("Anywhere within limits"):
            self.samples: Any = gui.add_number("Poses", _SAMPLES, min=1, max=_MOST, step=1000)
            self.random: Any = gui.add_button("Measure")
            self.spread: Any = gui.add_html("")
            self.go: Any = gui.add_button("Go to the largest", disabled=True)
        with gui.add_folder("The same pose"):
            self.solve: Any = gui.add_button(
                "Solve by both", hint="Inverse kinematics of both models for the pose of the tip"
            )
            self.solved: Any = gui.add_html("")
        with gui.add_folder("How they are compared", expand_by_default=False):
            self.rules: Any = gui.add_html(_lines(self.comparison.rules))
        self.random.on_click(self._when(self.measure))
        self.go.on_click(self._when(self._go_to_worst))
        self.solve.on_click(self._when(self.solve_both))

    # --- what others call

    def on_state(self, state: RobotState) -> None:
        """The second model follows, and the difference is written."""
        self._draw(np.asarray(state.q))

    def place(self, *, beside: bool) -> None:
        """Put the second model beside the first, or upon it."""
        T = np.eye(4)
        if beside:
            T[:3, 3] = self._step_aside()
        self.other_view.place(T)
        self.other_view.opacity = 1.0 if beside else 0.45  # what is upon another has to be seen through
        self._draw(self._view.q)

    def measure(self) -> None:
        """Differences over random joint vectors, as many as the box says."""
        found = self.comparison.spread(int(self.samples.value))
        self._worst = found.q
        self.go.disabled = False
        self.spread.content = _table(
            [
                ("mean", _mm(found.mean_distance), ""),
                ("largest", _mm(found.largest_distance), _mrad(found.largest_angle)),
                ("poses", f"{found.samples}", ""),
            ]
        )

    def solve_both(self) -> None:
        """Inverse kinematics of both models for the pose where the tip is."""
        q = self.comparison.common(self._view.q)
        found = self.comparison.solve(self._view.arm.fk(q), q)
        apart = found.q_other - found.q
        turning = np.array(
            [bool(self._view.arm.chain.is_revolute[axes != 0.0].all()) for axes in self._view.arm.chain.coupling.T]
        )
        rows = [
            (name, f"{1e3 * difference:+.4f} {'mrad' if turns else 'mm'}", "")
            for name, difference, turns in zip(self._view.arm.joint_names, apart, turning, strict=True)
        ]
        missed = ("tip off by", _mm(float(found.missed.distance)), _mrad(float(found.missed.angle)))
        self.solved.content = _table([*rows, missed]) + _lines([found.reason])

    # --- what people do

    def _when(self, act: Callable[[], None]) -> Callable[[Any], None]:
        def complain(words: str) -> None:
            self.live.content = _lines([words])

        return on_event(self._view, act, complain=complain)

    def _go_to_worst(self) -> None:
        if self._worst is not None:
            self._view.command(self._view.limited(self._worst))

    # --- what is drawn

    def _draw(self, q: FloatArray) -> None:
        both = self.comparison
        found = both.difference(q)
        with self._view.server.atomic():
            self.other_view.update(both.as_other(q))
            self.live.content = _difference(both, found)
            self._draw_gap(q, found)

    def _draw_gap(self, q: FloatArray, found: Difference) -> None:
        """From tip to tip, magnified until it can be seen; side by side it is drawn at the first."""
        distance, size = float(found.distance), 2.0 * frame_size(self._view.arm)
        seen = distance > _SMALL
        if seen:
            factor = max(1.0, 10.0 ** np.floor(np.log10(size / distance)))
            tip = self._view.arm.fk(self.comparison.common(q))[:3, 3]
            self._gap.points = np.stack([tip, tip + factor * found.offset])[None].astype(np.float32)
            self._gap_label.position = tip + factor * found.offset
            self._gap_label.text = f"{1e3 * distance:.3g} mm" + (f", drawn {factor:.0f} times" if factor > 1.0 else "")
        for node in (self._gap, self._gap_label):
            if node.visible != seen:
                node.visible = seen

    def _step_aside(self) -> FloatArray:
        """Where the second stands beside the first: along y, as far as both are thick and half as far as they reach."""
        reach = max(
            self._view.arm.fk_frames(np.zeros(self._view.arm.dof))[:, :3, 3].max(), 10.0 * frame_size(self._view.arm)
        )
        return np.array([0.0, -float(reach), 0.0])


def _difference(both: Comparison, found: Difference) -> str:
    x, y, z = 1e3 * found.offset
    return _table(
        [
            ("tip", _mm(float(found.distance)), _mrad(float(found.angle))),
            ("along x", f"{x:+.4f} mm", ""),
            ("along y", f"{y:+.4f} mm", ""),
            ("along z", f"{z:+.4f} mm", ""),
        ],
        title="{1} against {0}".format(*both.names),
    )


def _mm(metres: float) -> str:
    return f"{_thousandths(metres)} mm"


def _mrad(radians: float) -> str:
    return f"{_thousandths(radians)} mrad"


def _thousandths(value: float) -> str:
    """Four decimals, or what rounding has left in two digits."""
    return f"{1e3 * value:.1e}" if _NOTHING < value < _ROUNDING else f"{1e3 * value:.4f}"


def _table(rows: list[tuple[str, str, str]], *, title: str = "") -> str:
    cells = "".join(
        f"<tr>{''.join(f'<td style=padding-right:0.8em;white-space:nowrap>{html.escape(cell)}</td>' for cell in row)}</tr>"
        for row in rows
    )
    head = f"<div><b>{html.escape(title)}</b></div>" if title else ""
    return f'<div style="padding:0.3em 0.8em;font-size:0.8em">{head}<table>{cells}</table></div>'


def _lines(said: list[str] | tuple[str, ...]) -> str:
    return f'<div style="padding:0.3em 0.8em;font-size:0.85em">{"<br>".join(map(html.escape, said))}</div>'
