"""Boxes on frames in which one colour lies: as text, in files, as data."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError
from pieper.perception.drawn_color import Bgr, draw_color
from pieper.yaml_file import read_yaml

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from pieper.perception.frame import Image
    from pieper.yaml_file import Section


@dataclass(frozen=True)
class Region:
    """A box on a frame that shows one colour.

    Attributes
    ----------
    color : str
        Name of the colour.
    frame : int
        Number of the frame, from 0.
    x, y, width, height : int
        Left, top and size [px].
    """

    color: str
    frame: int
    x: int
    y: int
    width: int
    height: int

    @property
    def box(self) -> str:
        """Left, top, width, height, for messages."""
        return f"{self.x},{self.y},{self.width},{self.height}"

    def cut(self, image: Image) -> Image:
        """Return the part of an image.

        Raises
        ------
        VisionError
            The box is empty, or reaches beyond the image.
        """
        height, width = image.shape[:2]
        where = f"region {self.box} of {self.color!r} on frame {self.frame}"
        if self.width < 1 or self.height < 1:
            raise VisionError(f"{where} is empty; width and height must be at least 1")
        if self.x < 0 or self.y < 0 or self.x + self.width > width or self.y + self.height > height:
            raise VisionError(f"{where} reaches beyond the image of {width} x {height} pixels")
        return image[self.y : self.y + self.height, self.x : self.x + self.width]


def parse_region(text: str, color: str | None = None) -> Region:
    """Return the region of ``[name:]frame,x,y,w,h``.

    Raises
    ------
    VisionError
        The text is of another form, or its numbers are none.

    Examples
    --------
    >>> parse_region("red:120,300,200,40,30")
    Region(color='red', frame=120, x=300, y=200, width=40, height=30)
    """
    name, colon, numbers = text.rpartition(":")
    parts = numbers.split(",")
    if (not colon and color is None) or len(parts) != 5:
        raise VisionError(f"a region must be name:frame,x,y,w,h, as in red:120,300,200,40,40, got {text!r}")
    try:
        frame = int(parts[0])
    except ValueError:
        raise VisionError(f"not valid frame number: {parts[0].strip()!r}, in the region {text!r}") from None
    try:
        x, y, width, height = (int(part) for part in parts[1:])
    except ValueError:
        raise VisionError(f"x, y, w and h must be whole pixels, got {text!r}") from None
    return Region(name.strip() if colon else str(color), frame, x, y, width, height)


def read_regions(path: Path) -> tuple[list[Region], dict[str, Bgr]]:
    """Read regions, and draw colours, from a YAML or CSV file.

    In YAML ``colors`` has a list of ``[frame, x, y, w, h]`` for each name, and ``draw`` may have ``#rrggbb`` for each; in CSV the
    columns are ``color, frame, x, y, width, height``.

    Raises
    ------
    VisionError
        The file is malformed; the message names line and field.
    """
    if path.suffix.lower() == ".csv":
        return _regions_of_csv(path), {}
    file = read_yaml(path)
    file.only("colors", "draw")
    colors = file.section("colors")
    regions = []
    for name in colors:
        rows = colors.array(name, (None, 5))
        if not (rows == rows.round()).all() or np.abs(rows).max(initial=0) > 2**31:
            raise colors.error(
                name,
                f"must be lists of whole numbers: frame, x, y, w, h; got {rows[(rows != rows.round()).any(axis=1) | (np.abs(rows) > 2**31).any(axis=1)][0].tolist()}",
            )
        regions += [Region(name, *(int(n) for n in row)) for row in rows]
    draw = {}
    for name, text in _texts(file.section("draw")) if "draw" in file else ():
        if name not in colors:
            raise file.section("draw").error(name, "is not among the colors")
        try:
            draw[name] = draw_color(text)
        except VisionError as error:
            raise file.section("draw").error(name, str(error)) from None
    return regions, draw


def _texts(section: Section) -> list[tuple[str, str]]:
    return [(name, section.text(name)) for name in section]


def _regions_of_csv(path: Path) -> list[Region]:
    columns = ["color", "frame", "x", "y", "width", "height"]
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise VisionError(f"{path}: is not UTF-8 text") from None
    rows = csv.reader(io.StringIO(text), skipinitialspace=True)
    regions = []
    try:
        for row in rows:
            if rows.line_num == 1 and [cell.strip().lower() for cell in row] != columns:
                raise VisionError(f"{path}, line 1: the columns must be {','.join(columns)}, got {','.join(row)[:80]}")
            if rows.line_num == 1 or not row:
                continue
            if len(row) != len(columns):
                raise VisionError(f"{path}, line {rows.line_num}: must have {len(columns)} columns, got {len(row)}")
            try:
                regions.append(Region(row[0].strip(), *(int(cell) for cell in row[1:])))
            except ValueError:
                raise VisionError(f"{path}, line {rows.line_num}: must be whole numbers after the name") from None
    except csv.Error as error:
        raise VisionError(f"{path}, line {rows.line_num}: {error}") from None
    return regions


def regions_as_data(regions: Sequence[Region]) -> dict[str, Any]:
    """Return what `read_regions` reads from YAML."""
    colors: dict[str, Any] = {}
    for r in regions:
        colors.setdefault(r.color, []).append([r.frame, r.x, r.y, r.width, r.height])
    return {"colors": colors}
