"""Marker layouts: what may be on the field.

A pattern is a set of coloured markers on top of a robot, in millimetres in YAML and metres here, x ahead and y to the left, seen from
above. `pieper.perception.pattern_finder` finds them among the blobs of a frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError, unknown_name
from pieper.yaml_file import parse_yaml, read_yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from pieper.perception.scene import Scene
    from pieper.yaml_file import Section

BUILT_IN = ("report", "ssl", "vsss", "circles")
"""Names of the layouts that come along."""
FORMAT = "pieper patterns 1"


@dataclass(frozen=True)
class PatternMarker:
    """A patch of colour on a robot.

    Attributes
    ----------
    color : str
        Its name in the colour model.
    position : (float, float)
        In the robot's frame: ahead, to the left [m].
    height : float
        Above the field [m].
    radius : float
        Of the disc of its size [m]; 0 if it is not known.
    """

    color: str
    position: tuple[float, float]
    height: float = 0.0
    radius: float = 0.0


@dataclass(frozen=True)
class Pattern:
    """The markers of one robot."""

    name: str
    markers: tuple[PatternMarker, ...]


@dataclass(frozen=True)
class BallPattern:
    """What a ball looks like.

    Attributes
    ----------
    color : str
    radius : float
        [m]; 0 if it is not known. Its centre is that high above the field.
    """

    color: str
    radius: float = 0.0


@dataclass(frozen=True)
class Patterns:
    """What may be on the field.

    Raises
    ------
    VisionError
        Two patterns have the same name, a pattern has no markers, or two of its markers are at the same place.

    Examples
    --------
    >>> league = load_patterns("ssl")
    >>> len(league.robots), league.ball.color
    (32, 'orange')
    >>> [marker.color for marker in league.only(["blue_3"]).robots[0].markers]
    ['blue', 'pink', 'green', 'pink', 'green']
    """

    robots: tuple[Pattern, ...] = ()
    ball: BallPattern | None = None

    def __post_init__(self) -> None:
        names = [robot.name for robot in self.robots]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise VisionError(f"each robot needs a name of its own; there are two named {', '.join(twice)}")
        looks: dict[Any, str] = {}
        for robot in self.robots:
            if not robot.markers:
                raise VisionError(f"robot {robot.name!r} has no markers; give it one at least, or leave it out")
            for a, b in combinations(robot.markers, 2):
                if np.hypot(a.position[0] - b.position[0], a.position[1] - b.position[1]) < 1e-4:
                    raise VisionError(f"two markers of robot {robot.name!r} are at the same place")
            look = frozenset(robot.markers)
            if look in looks:
                raise VisionError(f"robots {looks[look]!r} and {robot.name!r} have the same markers, and look the same")
            looks[look] = robot.name

    @classmethod
    def of_scene(cls, scene: Scene) -> Patterns:
        """Return what is on a scene that is rendered."""
        robots, ball = [], None
        for thing in scene.things:
            if thing.kind == "ball":
                ball = BallPattern(thing.color, thing.radius)
                continue
            height = thing.model.height
            markers = (
                PatternMarker(m.color, (m.x, m.y), height, float(np.sqrt(m.area / np.pi))) for m in thing.model.markers
            )
            robots.append(Pattern(thing.name, tuple(markers)))
        return cls(tuple(robots), ball)

    def __bool__(self) -> bool:
        return bool(self.robots) or self.ball is not None

    @property
    def colors(self) -> set[str]:
        """Colours of all markers and the ball."""
        robots = {marker.color for robot in self.robots for marker in robot.markers}
        return robots | ({self.ball.color} if self.ball else set())

    def with_ball(self, color: str, radius: float = 0.0) -> Patterns:
        """Return these with a ball."""
        return replace(self, ball=BallPattern(color, radius))

    def only(self, names: Iterable[str]) -> Patterns:
        """Return these with some of the robots, which is faster and safer where the others are not on the field."""
        known = {robot.name: robot for robot in self.robots}
        wanted = list(names)
        for name in wanted:
            if name not in known:
                raise unknown_name("robot", name, known)
        return replace(self, robots=tuple(known[name] for name in wanted))

    def recolored(self, colors: Mapping[str, str]) -> Patterns:
        """Return these with other colours, by a mapping from the old names to the new ones."""
        robots = tuple(
            replace(r, markers=tuple(replace(m, color=colors.get(m.color, m.color)) for m in r.markers))
            for r in self.robots
        )
        ball = replace(self.ball, color=colors.get(self.ball.color, self.ball.color)) if self.ball else None
        return Patterns(robots, ball)


def load_patterns(source: str | Path | None) -> Patterns:
    """Read patterns from a YAML file, or take a built-in set by its name.

    Parameters
    ----------
    source : str or Path, optional
        ``"report"``, ``"ssl"``, ``"vsss"``, ``"circles"``, or a file; None gives none.

    Returns
    -------
    Patterns
        Those of the file, or of that name.

    Raises
    ------
    VisionError
        The file is malformed; the message names file, line and field.
    UnknownNameError
        There is neither a built-in set nor a file of that name.
    OSError
        The file cannot be read.
    """
    if source is None:
        return Patterns()
    if isinstance(source, str) and source in BUILT_IN:
        raw = files("pieper.perception").joinpath("patterns", f"{source}.yaml").read_bytes()
        return _read(parse_yaml(raw, f"{source}.yaml"))
    path = Path(source)
    if not path.exists() and not path.suffix and path.name == str(source):
        raise unknown_name("pattern set or file", str(source), BUILT_IN)
    return _read(read_yaml(path))


def _read(file: Section) -> Patterns:
    file.only("format", "layouts", "robots", "ball")
    if file.text("format", FORMAT) != FORMAT:
        raise file.error("format", f"must be {FORMAT!r}, got {file.text('format')!r}")
    layouts = {}
    if "layouts" in file:
        section = file.section("layouts")
        layouts = {name: _read_layout(section.section(name)) for name in section}
    robots = tuple(_read_robot(robot, layouts) for robot in file.sections("robots", []))
    ball = None
    if "ball" in file:
        section = file.section("ball")
        section.only("color", "radius_mm")
        ball = BallPattern(section.text("color"), section.number("radius_mm", 0.0, least=0, most=1e4) / 1e3)
    try:
        patterns = Patterns(robots, ball)
    except VisionError as cause:
        raise file.error("robots", str(cause)) from None
    if not patterns:
        raise file.error("robots", "is missing, and there is no ball either")
    return patterns


def _read_layout(layout: Section) -> list[PatternMarker]:
    layout.only("height_mm", "radius_mm", "markers")
    return _read_markers(layout)


def _read_markers(parent: Section) -> list[PatternMarker]:
    height = parent.number("height_mm", 0.0, least=0, most=1e4)
    radius = parent.number("radius_mm", 0.0, least=0, most=1e4)
    markers = []
    for section in parent.sections("markers"):
        section.only("color", "position_mm", "height_mm", "radius_mm")
        x, y = section.array("position_mm", (2,)).tolist()
        markers.append(
            PatternMarker(
                section.text("color", ""),
                (x / 1e3, y / 1e3),
                section.number("height_mm", height, least=0, most=1e4) / 1e3,
                section.number("radius_mm", radius, least=0, most=1e4) / 1e3,
            )
        )
    return markers


def _read_robot(robot: Section, layouts: Mapping[str, list[PatternMarker]]) -> Pattern:
    if "layout" in robot:
        robot.only("name", "layout", "colors")
        layout = robot.text("layout")
        if layout not in layouts:
            raise robot.error("layout", str(unknown_name("layout", layout, layouts)))
        places, colors = layouts[layout], robot.texts("colors")
        if len(colors) != len(places):
            raise robot.error("colors", f"must be {len(places)}, one for each marker of {layout!r}, got {len(colors)}")
        markers = [replace(place, color=color) for place, color in zip(places, colors, strict=True)]
    else:
        robot.only("name", "height_mm", "radius_mm", "markers")
        markers = _read_markers(robot)
    if not all(marker.color for marker in markers):
        raise robot.error("markers" if "markers" in robot else "colors", "every marker needs a color")
    return Pattern(robot.text("name"), tuple(markers))
