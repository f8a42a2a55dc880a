"""Where everything in a scene really was: what the renderer knows, and what estimates are measured against.

A truth file is JSON lines: a first line that says what it is, then one line for each frame. Lines are whole, so a file that was cut
off is good up to there.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import TextIO

    from pieper.spatial._checks import FloatArray

FORMAT = "pieper truth 1"


@dataclass(frozen=True, eq=False)
class TrueMarker:
    """One marker of an object in one frame.

    Attributes
    ----------
    color : str
        Name of its colour.
    image : (2,) array
        Its centre in the image [px]: the projection of the centre of the marker in space. Under perspective and distortion that is
        not quite the centroid of the patch that is seen.
    visible : float
        Share of it that is in the image and not hidden, 0 to 1.
    """

    color: str
    image: FloatArray
    visible: float


@dataclass(frozen=True, eq=False)
class TrueObject:
    """One object in one frame.

    Attributes
    ----------
    name : str
        Which one.
    kind : str
        ``"robot"`` or ``"ball"``.
    position : (2,) array
        On the field [m], in the middle of the exposure.
    heading : float or None
        From the field's x to the object's x [rad], in (-pi, pi]; None for a ball.
    velocity : (2,) array
        [m/s].
    turn_rate : float or None
        [rad/s].
    visible : float
        Share of the area of its markers that is seen, 0 to 1.
    markers : tuple of TrueMarker
        In the order of its pattern; a ball is one marker.
    """

    name: str
    kind: str
    position: FloatArray
    heading: float | None
    velocity: FloatArray
    turn_rate: float | None
    visible: float
    markers: tuple[TrueMarker, ...]


@dataclass(frozen=True, eq=False)
class Truth:
    """Everything in one frame."""

    index: int
    time: float
    objects: tuple[TrueObject, ...]


def write(path: Path, truths: Iterable[Truth]) -> int:
    """Write a truth file, a line at a time, and return the number of frames."""
    count = 0
    with Path(path).open("w", encoding="utf-8") as file:
        begin(file)
        for truth in truths:
            add(file, truth)
            count += 1
    return count


def begin(file: TextIO) -> None:
    """Write the first line of a truth file."""
    file.write(json.dumps({"format": FORMAT, "unit": "m"}) + "\n")


def add(file: TextIO, truth: Truth) -> None:
    """Write the line of one frame."""
    line = {"frame": truth.index, "time": truth.time, "objects": [_object_out(thing) for thing in truth.objects]}
    file.write(json.dumps(line) + "\n")
    file.flush()


def read(path: Path) -> list[Truth]:
    """Read a truth file.

    Raises
    ------
    VisionError
        It is not one; the message names the line.
    OSError
        It cannot be read.
    """
    with Path(path).open(encoding="utf-8") as file:
        return list(_read(file, str(path)))


def _read(file: TextIO, source: str) -> Iterator[Truth]:
    for number, text in enumerate(file, start=1):
        try:
            line = json.loads(text)
            if number == 1:
                if line["format"] != FORMAT:
                    raise ValueError(f"format is {line['format']!r}")
                continue
            yield Truth(int(line["frame"]), float(line["time"]), tuple(_object_in(o) for o in line["objects"]))
        except (ValueError, KeyError, TypeError) as cause:
            if number > 1 and not text.endswith("\n"):
                return  # the line being written when the writer was stopped
            what = f"lacks {cause}" if isinstance(cause, KeyError) else str(cause)
            raise VisionError(f"{source}: line {number} is not a line of a {FORMAT!r} file: {what}") from cause


def _object_out(thing: TrueObject) -> dict[str, Any]:
    return {
        "name": thing.name,
        "kind": thing.kind,
        "x": float(thing.position[0]),
        "y": float(thing.position[1]),
        "heading": thing.heading,
        "vx": float(thing.velocity[0]),
        "vy": float(thing.velocity[1]),
        "turn_rate": thing.turn_rate,
        "visible": round(thing.visible, 6),
        "markers": [
            {"color": m.color, "u": _or_none(m.image[0]), "v": _or_none(m.image[1]), "visible": round(m.visible, 6)}
            for m in thing.markers
        ],
    }


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _object_in(line: dict[str, Any]) -> TrueObject:
    def number(value: Any) -> float:
        return float("nan") if value is None else float(value)

    return TrueObject(
        name=str(line["name"]),
        kind=str(line["kind"]),
        position=np.array([float(line["x"]), float(line["y"])]),
        heading=None if line["heading"] is None else float(line["heading"]),
        velocity=np.array([float(line["vx"]), float(line["vy"])]),
        turn_rate=None if line["turn_rate"] is None else float(line["turn_rate"]),
        visible=float(line["visible"]),
        markers=tuple(
            TrueMarker(str(m["color"]), np.array([number(m["u"]), number(m["v"])]), float(m["visible"]))
            for m in line["markers"]
        ),
    )
