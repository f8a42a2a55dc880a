"""The jog panel: a slider and a number box for each joint, and where every frame is."""

from __future__ import annotations

import html
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.spatial import rotation
from pieper.viewer.panel import Panel, Window

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.arm import Arm
    from pieper.model.chain import FloatArray
    from pieper.motion.robot import RobotState

_READOUT_PERIOD = 0.1  # [s]
_DECIMALS = 9  # of what is typed into a number box
_TURN = 2.0 * math.pi


# --------------------------------------------------------------------------------------------------------------------
# what is known without a browser


def slider_range(arm: Arm) -> FloatArray:
    """(n, 2) ends of the sliders [rad or m]: the limits, and a turn or a metre each way where there are none."""
    lower, upper = arm.limits.T
    span = np.where(turning(arm), _TURN, 1.0)
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * span, -span))
    high = np.where(np.isfinite(upper), upper, np.where(np.isfinite(lower), lower + 2.0 * span, span))
    return np.stack([low, high], axis=1)


def slider_step(lower: float, upper: float) -> float:
    """A round step, of which there are some thousand in the range.

    >>> slider_step(-3.1, 3.1), slider_step(0.0, 0.04)
    (0.001, 1e-05)
    """
    return float(10.0 ** math.floor(math.log10((upper - lower) / 2000.0)))


def turning(arm: Arm) -> Any:
    """(n,) mask of the joints whose values are angles."""
    chain = arm.chain
    return np.array([bool(chain.is_revolute[axes].all()) for axes in (chain.coupling != 0.0).T], dtype=np.bool_)


def home(arm: Arm) -> FloatArray:
    """Joint values nearest 0 within the limits, (n,) [rad or m]."""
    return np.asarray(np.clip(np.zeros(arm.dof), *arm.limits.T))


def random_pose(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """Joint values anywhere within the limits, (n,) [rad or m]; half a turn each way for a joint without any."""
    ends = slider_range(arm)
    ends[np.isinf(arm.limits).all(axis=1)] *= 0.5
    return np.asarray(rng.uniform(*ends.T))


def as_python(arm: Arm, q: FloatArray) -> str:
    """Lines of Python that bring the arm to `q`.

    >>> import pieper
    >>> print(as_python(pieper.load("mh12"), np.array([0.5, 0.0, 0.0, 0.0, 0.0, -0.25])))
    q = [0.5, 0.0, 0.0, 0.0, 0.0, -0.25]  # [rad] joint_1_s, joint_2_l, joint_3_u, joint_4_r, joint_5_b, joint_6_t
    """
    turns = turning(arm)
    unit = "rad" if turns.all() else "m" if not turns.any() else "rad or m"
    return f"q = {q.tolist()}  # [{unit}] {', '.join(arm.joint_names)}"


def as_json(arm: Arm, q: FloatArray) -> str:
    """The joint values by name, and the pose of the tip, as JSON in metres and radians."""
    T = arm.fk(q)
    return json.dumps(
        {
            "arm": arm.name,
            "q": dict(zip(arm.joint_names, q.tolist(), strict=True)),
            "frame": arm.tip,
            "position": T[:3, 3].tolist(),
            "quaternion_xyzw": rotation.as_quaternion(T[:3, :3]).tolist(),
        }
    )


def pose_lines(arm: Arm, q: FloatArray, frame: str) -> list[str]:
    r"""Where a frame is in the base frame: position, quaternion and angles, as the command line prints them.

    >>> import pieper
    >>> print("\n".join(pose_lines(pieper.load("mh12", nominal=True), np.array([0, 0, 0, 0, 0.5, 0]), "tool0")))
    position    x y z  [m]
       0.882758   0.000000   1.311943
    quaternion  x y z w
       0.510184   0.000000   0.860066   0.000000
    angles      roll pitch yaw  [deg]
         0.0000   -61.3521   180.0000
    angles      roll pitch yaw  [rad]
       0.000000  -1.070796   3.141593
    """
    T = arm.fk(q, up_to=frame)
    rpy = rotation.as_rpy(T[:3, :3])
    return [
        "position    x y z  [m]",
        _numbers(T[:3, 3]),
        "quaternion  x y z w",
        _numbers(rotation.as_quaternion(T[:3, :3])),
        "angles      roll pitch yaw  [deg]",
        _numbers(np.degrees(rpy), 4),
        "angles      roll pitch yaw  [rad]",
        _numbers(rpy),
    ]


def joint_lines(arm: Arm, q: FloatArray) -> list[str]:
    """The joint values, a line each: [rad] and [deg], or [m]."""
    width = max((len(name) for name in arm.joint_names), default=0)
    lines = []
    for name, value, turns in zip(arm.joint_names, q.tolist(), turning(arm), strict=True):
        angle = f" {math.degrees(value):10.4f} deg" if turns else ""
        lines.append(f"{name:{width}} {value + 0.0:10.6f} {'rad' if turns else 'm'}{angle}")
    return lines


def _numbers(values: FloatArray, digits: int = 6) -> str:
    rounded = np.round(values, digits) + 0.0  # no minus before zero
    return "".join(f"{value:11.{digits}f}" for value in rounded.tolist())


# --------------------------------------------------------------------------------------------------------------------
# the panel


class JogPanel(Panel):
    """Sliders, number boxes, and the live pose of a frame.

    Parameters
    ----------
    seed : int, optional
        Of the random poses.

    Attributes
    ----------
    sliders : list of slider handles, or None for a joint that cannot move
    """

    title = "Jog"

    def __init__(self, *, seed: int | None = None) -> None:
        self._rng = np.random.default_rng(seed)
        self._since_readout = math.inf
        self._stale = True
        self.sliders: list[Any] = []

    def build(self, view: Window) -> None:
        """Make the controls."""
        self._view = view
        gui, arm = view.server.gui, view.arm
        for index, (lower, upper) in enumerate(slider_range(arm).tolist()):
            unit = "rad" if turning(arm)[index] else "m"
            label = f"{arm.joint_names[index]} [{unit}]"
            if upper - lower < 1e-9:
                gui.add_text(label, f"{lower:g}", disabled=True)
                self.sliders.append(None)
                continue
            value = float(np.clip(view.target[index], lower, upper))
            slider = gui.add_slider(
                label,
                lower,
                upper,
                slider_step(lower, upper),
                value,
                marks=_marks(lower, upper),
                hint=_hint(arm, index),
            )
            slider.precision = _DECIMALS  # the box beside the slider takes numbers finer than the steps of the slider
            slider.on_update(self._moved(index))
            self.sliders.append(slider)
        buttons = gui.add_button_group("Go to", ("Home", "Random", "Stop"))
        buttons.on_click(self._go)
        self._frame = gui.add_dropdown("Frame", arm.frame_names, initial_value=arm.tip)
        self._frame.on_update(lambda _: self._refresh())
        self._readout = gui.add_html("")
        self._show_readout()

    def _moved(self, index: int) -> Callable[[Any], None]:
        def moved(event: Any) -> None:
            if event.client_id is None:  # set by the viewer itself
                return
            with self._view.lock:
                q = np.array(self._view.target)
                q[index] = event.target.value  # what it is now, and not when the event was sent
                self._view.command(self._view.limited(q))

        return moved

    def _go(self, event: Any) -> None:
        with self._view.lock:
            wish = event.target.value
            if wish == "Stop":
                self._view.stop_motion()
            else:
                self._view.command(home(self._view.arm) if wish == "Home" else random_pose(self._view.arm, self._rng))

    def on_command(self, q: FloatArray) -> None:
        """Show on the sliders where the arm is sent."""
        for slider, value in zip(self.sliders, q.tolist(), strict=True):
            if slider is not None:
                slider.value = value

    def on_state(self, state: RobotState) -> None:
        """The numbers are out of date."""
        self._stale = True

    def on_tick(self, dt: float) -> None:
        """Write the numbers, some ten times a second."""
        self._since_readout += dt
        if self._stale and self._since_readout >= _READOUT_PERIOD:
            self._show_readout()

    def _refresh(self) -> None:
        with self._view.lock:
            self._show_readout()

    def _show_readout(self) -> None:
        arm, q = self._view.arm, self._view.q
        text = "\n".join([*pose_lines(arm, q, self._frame.value), "", *joint_lines(arm, q)])
        self._readout.content = (
            f'<pre style="{_READOUT_STYLE}">{html.escape(text)}</pre>'
            f"{_copy_button('Copy as Python', as_python(arm, q))} {_copy_button('Copy as JSON', as_json(arm, q))}"
        )
        self._stale, self._since_readout = False, 0.0


_READOUT_STYLE = "font-size:10.5px;line-height:1.35;margin:0 0.6em 0.6em;overflow-x:auto"
_BUTTON_STYLE = (
    "font-size:12px;padding:0.3em 0.7em;margin:0 0 0.5em 0.5em;border:1px solid #8888;border-radius:4px;cursor:pointer;"
    "background:transparent;color:inherit"
)


def _copy_button(label: str, text: str) -> str:
    """A button that puts a text on the clipboard of the browser."""
    return (
        f'<button style="{_BUTTON_STYLE}" data-copy="{html.escape(text)}" '
        "onclick=\"navigator.clipboard.writeText(this.dataset.copy);this.style.borderColor='#2a2'\">"
        f"{label}</button>"
    )


def _marks(lower: float, upper: float) -> tuple[tuple[float, str], ...]:
    return ((lower, f"{lower:.4g}"), (upper, f"{upper:.4g}"))


def _hint(arm: Arm, index: int) -> str:
    """The limits in words, angles in degrees as well."""
    lower, upper = arm.limits[index].tolist()
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return "no limits"
    if turning(arm)[index]:
        return f"{lower:.6g} to {upper:.6g} rad, {math.degrees(lower):.4g} to {math.degrees(upper):.4g} deg"
    return f"{lower:.6g} to {upper:.6g} m"
