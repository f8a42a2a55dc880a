"""A scene as data: a camera over a field, robots with markers on them, a ball, how they move, and what spoils the picture.

Motions are formulas of time, so the truth is exact at any time; `synthetic` draws what the camera sees.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.spatial._checks import FloatArray

Bgr = tuple[float, float, float]

COLORS: dict[str, Bgr] = {
    "red": (45, 40, 205),
    "blue": (205, 90, 25),
    "green": (95, 225, 60),
    "yellow": (40, 215, 240),
    "cyan": (225, 215, 60),
    "magenta": (165, 60, 215),
    "orange": (25, 120, 245),
}
"""Paint of the markers in white light: blue, green, red, 0 to 255."""


@dataclass(frozen=True)
class Pose:
    """Where something is, and how it moves."""

    x: float
    y: float
    heading: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    turn_rate: float = 0.0


class Motion(Protocol):
    """A formula of time."""

    def __call__(self, t: float) -> Pose:
        """Return the pose at a time [s]; the heading may leave (-pi, pi]."""
        ...


@dataclass(frozen=True)
class Straight:
    """Constant velocity and turn rate; all zero by default, which is parked.

    >>> Straight((0.0, 0.1), velocity=(0.5, 0.0))(2.0).x
    1.0
    """

    start: tuple[float, float]
    heading: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    turn_rate: float = 0.0

    def __call__(self, t: float) -> Pose:
        """Return the pose at a time [s]."""
        (x, y), (vx, vy) = self.start, self.velocity
        return Pose(x + vx * t, y + vy * t, self.heading + self.turn_rate * t, vx, vy, self.turn_rate)


@dataclass(frozen=True)
class Circle:
    """Round a circle at constant speed, nose along the way; `rate` [rad/s] is positive anticlockwise."""

    centre: tuple[float, float]
    radius: float
    rate: float
    phase: float = 0.0

    def __call__(self, t: float) -> Pose:
        """Return the pose at a time [s]."""
        angle = self.phase + self.rate * t
        c, s = float(np.cos(angle)), float(np.sin(angle))
        r, w = self.radius, self.rate
        nose = angle + np.copysign(np.pi / 2, w)
        return Pose(self.centre[0] + r * c, self.centre[1] + r * s, float(nose), -r * w * s, r * w * c, w)


@dataclass(frozen=True)
class Sway:
    """To and fro along both axes, each a sine with its own rate and phase, turning evenly."""

    centre: tuple[float, float]
    reach: tuple[float, float]
    rate: tuple[float, float]
    phase: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    turn_rate: float = 0.0

    def __call__(self, t: float) -> Pose:
        """Return the pose at a time [s]."""
        p, v = [], []
        for k in (0, 1):
            angle = self.rate[k] * t + self.phase[k]
            p.append(self.centre[k] + self.reach[k] * float(np.sin(angle)))
            v.append(self.reach[k] * self.rate[k] * float(np.cos(angle)))
        return Pose(p[0], p[1], self.heading + self.turn_rate * t, v[0], v[1], self.turn_rate)


@dataclass(frozen=True)
class Marker:
    """A patch of colour on top of a robot: a disc, or a rectangle if `box` is given (length along x, width along y) [m]."""

    color: str
    x: float
    y: float
    radius: float = 0.0
    box: tuple[float, float] | None = None

    @property
    def area(self) -> float:
        """[m^2]."""
        return float(np.pi * self.radius**2) if self.box is None else self.box[0] * self.box[1]

    def outline(self, corners: int) -> FloatArray:
        """Return its outline in the robot's frame, ``(n, 2)`` [m]."""
        if self.box is not None:
            return np.asarray(_rectangle(*self.box) + np.array([self.x, self.y]))
        return np.asarray(circle(self.radius, corners) + np.array([self.x, self.y]))


@dataclass(frozen=True)
class Model:
    """A make of robot: its body and the markers on top.

    Attributes
    ----------
    name : str
        Of the pattern.
    markers : tuple of Marker
        In the robot's frame: x ahead, y to the left [m].
    radius, side : float
        Of the round body, or side of the square one if it is not zero [m].
    height : float
        Of the top with the markers above the field [m].
    """

    name: str
    markers: tuple[Marker, ...]
    radius: float = 0.0
    side: float = 0.0
    height: float = 0.06
    paint: Bgr = (38, 36, 34)

    def outline(self, corners: int) -> FloatArray:
        """Return the outline of the body in the robot's frame, ``(n, 2)`` [m]."""
        return _rectangle(self.side, self.side) if self.side else circle(self.radius, corners)


@dataclass(frozen=True)
class Robot:
    """A robot that moves."""

    name: str
    model: Model
    motion: Motion
    kind: Literal["robot"] = "robot"


@dataclass(frozen=True)
class Ball:
    """A ball that moves; its true position is that of its centre."""

    name: str
    motion: Motion
    radius: float = 0.0215
    color: str = "orange"
    kind: Literal["ball"] = "ball"


@dataclass(frozen=True)
class Bar:
    """Something grey over the field that hides what is below: a rectangle at a height, there from one time to another."""

    motion: Motion
    size: tuple[float, float]
    height: float = 0.2
    interval: tuple[float, float] = (-np.inf, np.inf)
    paint: Bgr = (120, 118, 115)

    def outline(self) -> FloatArray:
        """Return its outline in its frame, ``(4, 2)`` [m]."""
        return _rectangle(*self.size)


@dataclass(frozen=True)
class Effects:
    """What spoils the picture; nothing by default.

    Attributes
    ----------
    noise : float
        Standard deviation of each channel of each pixel [grey levels of 255].
    exposure : float
        Motion blur: how long the shutter is open [s]; the truth is that of the middle.
    light : (float, float)
        Of the lamps at the first and at the last frame; in between it goes evenly.
    gradient : float
        Light at the right edge above that at the left, as a share of that in the middle.
    cast : (float, float)
        Colour cast at the first and at the last frame: red is multiplied by 1 + cast, blue by 1 - cast.
    shadow : float
        0 to 1: how much light a shadow takes that lies across a part of the field.
    quality : int
        JPEG quality 1 to 100 of each frame; 0: not compressed.
    """

    noise: float = 0.0
    exposure: float = 0.0
    light: tuple[float, float] = (1.0, 1.0)
    gradient: float = 0.0
    cast: tuple[float, float] = (0.0, 0.0)
    shadow: float = 0.0
    quality: int = 0

    def __post_init__(self) -> None:
        bounds = {
            "noise": (0.0, 255.0),
            "exposure": (0.0, 10.0),
            "light": (0.0, 100.0),
            "gradient": (-1.99, 1.99),
            "cast": (-0.99, 0.99),
            "shadow": (0.0, 1.0),
            "quality": (0.0, 100.0),
        }
        for name, (least, most) in bounds.items():
            value = getattr(self, name)
            if not all(least <= v <= most for v in (value if isinstance(value, tuple) else (value,))):
                raise ArrayError(f"{name} is out of range: it must be from {least:g} to {most:g}, got {value}")


@dataclass(frozen=True)
class Pitch:
    """A field with lines, centred on the origin, x along its length [m]."""

    length: float = 1.5
    width: float = 1.3
    line: float = 0.012
    circle: float = 0.2
    box: tuple[float, float] = (0.15, 0.7)
    goal: tuple[float, float] = (0.1, 0.4)
    margin: float = 0.1
    carpet: Bgr = (62, 104, 46)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn; the same scene is drawn the same way each time.

    Attributes
    ----------
    name : str
        Of the scene.
    view : FieldView
        The camera.
    things : tuple of Robot or Ball
        With distinct names.
    frames : int
        How many.
    fps : float
        Frames per second; frame k is taken at k / fps.
    effects : Effects
        What spoils the picture.
    bars : tuple of Bar
        What hides things.
    pitch : Pitch
        The field.
    seed : int
        Of the noise and of the carpet.
    """

    name: str
    view: FieldView
    things: tuple[Robot | Ball, ...]
    frames: int = 120
    fps: float = 60.0
    effects: Effects = field(default_factory=Effects)
    bars: tuple[Bar, ...] = ()
    pitch: Pitch = field(default_factory=Pitch)
    seed: int = 1

    def __post_init__(self) -> None:
        names = [thing.name for thing in self.things]
        if len(set(names)) != len(names):
            raise ArrayError(f"the things in a scene must have distinct names, got {names}")
        if self.frames < 1 or not 0 < self.fps < np.inf:
            raise ArrayError(f"a scene needs at least one frame and a positive rate, got {self.frames}, {self.fps}")
        if self.seed < 0:
            raise ArrayError(f"the seed of a scene must be 0 or more, got {self.seed}")

    def __len__(self) -> int:
        return self.frames

    @property
    def robots(self) -> tuple[Robot, ...]:
        """The robots alone."""
        return tuple(thing for thing in self.things if isinstance(thing, Robot))

    def progress(self, index: int) -> float:
        """0 at the first frame, 1 at the last."""
        return index / (self.frames - 1) if self.frames > 1 else 0.0

    def but(self, **changes: object) -> Scene:
        """Return a scene that differs in some attributes, or in some effects.

        >>> preset("clean").but(noise=12.0, frames=10).effects.noise
        12.0
        """
        effects = {key: changes.pop(key) for key in list(changes) if key in Effects.__dataclass_fields__}
        if effects:
            changes["effects"] = replace(self.effects, **effects)  # type: ignore[arg-type]
        return replace(self, **changes)  # type: ignore[arg-type]


def circle(radius: float, corners: int = 48) -> FloatArray:
    """Return a polygon with the area of a disc, ``(corners, 2)``."""
    step = 2 * np.pi / corners
    angle = step * np.arange(corners)
    corner = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(corner * (radius * np.sqrt(step / np.sin(step))))


def _rectangle(length: float, width: float) -> FloatArray:
    return np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (length / 2, width / 2)


def overhead(
    size: tuple[int, int] = (640, 480),
    *,
    mm_per_px: float = 3.0,
    height: float = 2.0,
    tilt: float = 0.0,
    distortion: Sequence[float] = (),
) -> FieldView:
    """Return a camera that looks down on the origin of the field, x of the field to the right and y up.

    Parameters
    ----------
    size : (int, int)
        Width and height of the image [px].
    mm_per_px : float
        On the field, below the camera [mm].
    height : float
        Of the camera above the origin [m], along its line of sight.
    tilt : float
        Of the line of sight from straight down [rad], about the image's x axis.
    distortion : sequence of float
        Of the lens, as in `Camera`.

    Returns
    -------
    FieldView
    """
    f = height / (mm_per_px / 1000)
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]])
    camera = Camera(K, np.array(distortion, dtype=np.float64), size)
    c, s = np.cos(tilt), np.sin(tilt)
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.diag([1.0, -1.0, -1.0])
    T[2, 3] = height
    return FieldView(camera, T)


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

# Places of the four outer dots of the butterfly of the Small Size League: 65 mm from the middle, the front pair wider apart.
_DOTS = ((0.035, 0.054772), (-0.054772, 0.035), (-0.054772, -0.035), (0.035, -0.054772))


def butterfly(team: str, dots: Sequence[str]) -> Model:
    """Return a robot of the Small Size League: a dot of the team in the middle, and four that tell which it is."""
    outer = tuple(Marker(color, x, y, 0.02) for color, (x, y) in zip(dots, _DOTS, strict=True))
    return Model(f"{team} {' '.join(dots)}", (Marker(team, 0.0, 0.0, 0.025), *outer), radius=0.09, height=0.14)


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
