"""A scene as data: a camera over a field, robots with markers on them, a ball, how they move, and what spoils the picture.

Motions are formulas of time, so the truth is exact at any time; `synthetic` draws what the camera sees.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from pieper.errors import ArrayError
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView

if TYPE_CHECKING:
    from collections.abc import Sequence

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

        >>> from pieper.perception.scene_presets import preset
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
