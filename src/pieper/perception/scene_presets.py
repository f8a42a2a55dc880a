"""Scenes that are ready to be rendered, and the robots on them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.perception.scene import (
    Ball,
    Bar,
    Circle,
    Effects,
    Marker,
    Model,
    Pitch,
    Robot,
    Scene,
    Straight,
    Sway,
    overhead,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.perception.field_view import FieldView


SOCCER = Model(
    "soccer",
    (
        Marker("blue", 0.045, 0.0, 0.034),
        Marker("red", -0.045, 0.0, 0.034),
        Marker("green", 0.0, 0.062, 0.031),
        Marker("green", 0.0, -0.062, 0.031),
    ),
    radius=0.11,
    height=0.12,
)
"""The soccer robot of the report: blue ahead, red behind, a green on either side."""


def vsss(team: str, first: str, second: str) -> Model:
    """Return a cube of 75 mm with a team stripe ahead and two smaller patches behind, as in the Very Small Size league.

    Parameters
    ----------
    team : str
        Colour of the stripe.
    first, second : str
        Colours of the patches, as the robot looks: the left one, the right one.

    Returns
    -------
    Model
    """
    return Model(
        f"{team} {first} {second}",
        (
            Marker(team, 0.0175, 0.0, box=(0.031, 0.066)),
            Marker(first, -0.0175, 0.0175, box=(0.031, 0.031)),
            Marker(second, -0.0175, -0.0175, box=(0.031, 0.031)),
        ),
        side=0.075,
        height=0.06,
    )


def team(count: int) -> tuple[tuple[str, Model], ...]:
    """Return names and models of robots that can be told apart, at most twelve, yellow and blue in turn.

    Names and colours are those of the built-in patterns ``"vsss"``.

    Raises
    ------
    ArrayError
        More than twelve, or fewer than none.
    """
    pairs = (
        ("red", "green"),
        ("red", "cyan"),
        ("green", "red"),
        ("green", "cyan"),
        ("green", "magenta"),
        ("cyan", "red"),
    )
    named = [(f"{color}_{k}", vsss(color, *pair)) for k, pair in enumerate(pairs) for color in ("yellow", "blue")]
    if not 0 <= count <= len(named):
        raise ArrayError(f"a team has 0 to {len(named)} robots, got {count}")
    return tuple(named[:count])


def _wanderers(count: int) -> tuple[Robot | Ball, ...]:
    """Robots on courses of their own that stay apart, and a ball."""
    robots = [
        Robot(
            name, model, Sway((x, y), (0.07, 0.05), (1.7 + 0.23 * k, 2.3 - 0.17 * k), (k, 2.0 * k), k, 0.6 - 0.15 * k)
        )
        for k, ((name, model), (x, y)) in enumerate(zip(team(count), _grid(count), strict=True))
    ]
    return (*robots, Ball("ball", Straight((-0.6, -0.02), velocity=(0.35, 0.012))))


def _grid(count: int) -> list[tuple[float, float]]:
    columns = min(count, 5)
    rows = -(-count // columns)
    return [
        ((k % columns - (columns - 1) / 2) * 0.28, (k // columns - (rows - 1) / 2) * (0.55 if rows == 2 else 0.33))
        for k in range(count)
    ]


def _clean(size: tuple[int, int]) -> Scene:
    return Scene("clean", _view(size), _wanderers(10))


def _noise(size: tuple[int, int]) -> Scene:
    return _clean(size).but(name="noise", noise=12.0)


def _blur_light(size: tuple[int, int]) -> Scene:
    return _clean(size).but(name="blur-light", exposure=1 / 120, light=(1.0, 0.4), gradient=0.3, noise=3.0)


def _light_ramp(size: tuple[int, int]) -> Scene:
    return _clean(size).but(name="light-ramp", light=(1.0, 0.4), cast=(0.0, 0.15), noise=3.0, frames=300)


def _shadow(size: tuple[int, int]) -> Scene:
    return _clean(size).but(name="shadow", shadow=0.5, gradient=0.3, noise=3.0)


def _compression(size: tuple[int, int]) -> Scene:
    return _clean(size).but(name="compression", quality=60, noise=3.0)


def _lens(size: tuple[int, int]) -> Scene:
    view = overhead(size, mm_per_px=3.0 * 640 / size[0], tilt=0.15, distortion=(-0.22, 0.06, 0.001, -0.0008, 0.0))
    return _clean(size).but(name="lens", view=view, noise=3.0)


def _occlusion(size: tuple[int, int]) -> Scene:
    """A robot at 0.6 m/s goes under a bar that hides it wholly for half a second; another one passes in the open."""
    (first, model), (second, other) = team(2)
    speed, hidden = 0.6, 0.5
    things = (
        Robot(first, model, Straight((-0.65, 0.2), velocity=(speed, 0.0))),
        Robot(second, other, Straight((0.6, -0.35), heading=np.pi, velocity=(-0.5, 0.0))),
    )
    bar = Bar(Straight((0.05, 0.2)), (speed * hidden + model.side, 0.25))
    return Scene("occlusion", _view(size), things, frames=130, bars=(bar,), effects=Effects(noise=3.0))


def _crossing(size: tuple[int, int]) -> Scene:
    """Two rows of five that pass between each other again and again, 100 mm apart at the closest."""
    named, things = team(10), []
    for k, (name, model) in enumerate(named):
        side, row = k % 2, k // 2
        y = (row - 2) * 0.22 + (0.055 if side else -0.055)
        phase = (np.pi / 2 if side else -np.pi / 2) + 0.12 * row
        things.append(
            Robot(name, model, Sway((0, y), (0.6, 0.004), (1.5, 3.0), (phase, row), np.pi * side, 0.3 * (row - 2)))
        )
    return Scene("crossing", _view(size), tuple(things), frames=360, effects=Effects(noise=3.0))


def _report(size: tuple[int, int]) -> Scene:
    """The report's robot on a slow circle, in steady light."""
    robot = Robot("robot", SOCCER, Circle((0.0, 0.0), 0.35, 0.9))
    pitch = replace(Pitch(), length=1.7, width=1.25, carpet=(50, 78, 44))
    return Scene("report", _view(size), (robot,), pitch=pitch, effects=Effects(noise=3.0))


def _report_occlusion(size: tuple[int, int]) -> Scene:
    """The report's robot at constant velocity, wholly hidden for half a second."""
    speed, hidden = 0.5, 0.5
    robot = Robot("robot", SOCCER, Straight((-0.6, 0.0), velocity=(speed, 0.0)))
    bar = Bar(Straight((0.05, 0.0)), (speed * hidden + 2 * SOCCER.radius, 0.4), height=0.25)
    return _report(size).but(name="report-occlusion", things=(robot,), bars=(bar,), frames=140)


def _view(size: tuple[int, int]) -> FieldView:
    """3 mm/px in VGA; the same field in other sizes."""
    return overhead(size, mm_per_px=3.0 * max(640 / size[0], 480 / size[1]))


PRESETS: dict[str, Callable[[tuple[int, int]], Scene]] = {
    "clean": _clean,
    "noise": _noise,
    "blur-light": _blur_light,
    "light-ramp": _light_ramp,
    "shadow": _shadow,
    "compression": _compression,
    "lens": _lens,
    "occlusion": _occlusion,
    "crossing": _crossing,
    "report": _report,
    "report-occlusion": _report_occlusion,
}
"""Scenes by name."""


def preset(name: str, size: tuple[int, int] = (640, 480)) -> Scene:
    """Return a scene by name.

    Raises
    ------
    UnknownNameError
        There is none of that name; the message lists them.

    Examples
    --------
    >>> [thing.name for thing in preset("occlusion").things]
    ['yellow_0', 'blue_0']
    """
    if name not in PRESETS:
        raise unknown_name("scene", name, PRESETS)
    return PRESETS[name](size)
