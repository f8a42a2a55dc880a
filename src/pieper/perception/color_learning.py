"""Colour models from regions that somebody marked on chosen frames, with a report of how well they hold.

Each region is a capture of one colour. What of it is not that colour (the corners around a disc, a rim) is left out: the pixels kept
are those near the median of its middle. Captures of a colour are pooled, within and between. The rest of the frames is the background.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._version import __version__
from pieper.errors import VisionError
from pieper.perception.color import (
    CAST,
    DARKEST,
    LIGHT,
    THRESHOLD,
    Background,
    Bgr,
    ColorModel,
    Look,
    default_draw,
    draw_color,
)
from pieper.perception.color_space import LogChroma, Space, hsv_statistics, pooled, space_named
from pieper.yaml_file import read_yaml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray
    from pieper.yaml_file import Section

FLOOR = {"log-chroma": np.full(3, 0.03**2), "hsv": np.array([1.5**2, 4.0**2, 4.0**2])}
"""Variances that are added to what was learned: a few pixels of one capture know less than they seem to, and a flat region nothing."""

CLIPPED = 0.15
"""Standard deviation of the logarithm of a channel that is at its end, and would be more if it could."""

COMPONENTS = 12
"""Gaussians of the background."""

CONFUSED = 0.01
"""Share of a colour's pixels taken for another above which that is said."""

_TRIM = 4.0  # Mahalanobis distance within which a pixel of a region is of its colour
_ALIKE = 3.0  # and within which a pixel elsewhere is of the same colour as a region
_ROUNDS = 6
_PIXELS = 4000  # of the background, from each frame
_LARGEST_REGION = 250_000  # pixels; more of one colour tell nothing new
_PORTION = 0.3  # of a region below which its box is called loose


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


@dataclass(frozen=True, eq=False)
class Capture:
    """What one region says.

    Attributes
    ----------
    region : Region
    pixels : (n, 3) uint8 array
        Those of its colour: blue, green, red.
    share : float
        Of the region that they are.
    mean, covariance : (3,) and (3, 3) arrays
        In the space of the model, without any floor.
    hsv_mean, hsv_covariance : (3,) and (3, 3) arrays
        In OpenCV's HSV, with a hue that wraps.
    flat : bool
        The covariance is singular.
    """

    region: Region
    pixels: NDArray[np.uint8]
    share: float
    mean: FloatArray
    covariance: FloatArray
    hsv_mean: FloatArray
    hsv_covariance: FloatArray
    flat: bool


@dataclass(frozen=True, eq=False)
class Learned:
    """A model, and what it was made of.

    Attributes
    ----------
    model : ColorModel
        With regions, provenance and validation in its `notes`.
    captures : tuple of Capture
    remarks : tuple of str
        What a person ought to know: flat or loose regions, colours that overlap.
    """

    model: ColorModel
    captures: tuple[Capture, ...]
    remarks: tuple[str, ...]


def learn(
    read: Callable[[int], Image],
    regions: Sequence[Region],
    *,
    draw: Mapping[str, Bgr] | None = None,
    space: str = LogChroma.name,
    threshold: float = THRESHOLD,
    light: float = LIGHT,
    cast: float = CAST,
    background: int = COMPONENTS,
    more_frames: Sequence[int] = (),
    source: Mapping[str, Any] | None = None,
) -> Learned:
    """Learn a colour model.

    Parameters
    ----------
    read : callable
        From the number of a frame to its image; it raises where there is none.
    regions : sequence of Region
        Captures, one or more for each colour.
    draw : mapping, optional
        Blue, green, red in which a colour is drawn; else that of its name, or the colour itself.
    space : str
        ``"log-chroma"`` or ``"hsv"``.
    threshold : float
        Mahalanobis distance d.
    light, cast : float
        Standard deviations of the light and of its colour [logarithm]; see `ColorModel`.
    background : int
        Gaussians of the background; 0 for none.
    more_frames : sequence of int
        Frames that show more of the background.
    source : mapping, optional
        Where the frames come from, for the file.

    Returns
    -------
    Learned

    Raises
    ------
    VisionError
        No regions, or one that is empty, outside of its frame, or too dark to have a colour.
    """
    if not regions:
        raise VisionError("no regions are given; a colour needs one at least: --roi frame,x,y,w,h")
    chosen = space_named(space)
    images = {n: read(n) for n in dict.fromkeys([*(region.frame for region in regions), *more_frames])}
    captures = tuple(_capture(region, images[region.frame], chosen) for region in regions)
    names = tuple(dict.fromkeys(region.color for region in regions))
    groups = [[c for c in captures if c.region.color == name] for name in names]
    gaussians = [_pool(group, chosen) for group in groups]
    wanted = dict(draw or {})
    model = ColorModel(
        names,
        np.array([mean for mean, _ in gaussians]),
        np.array([covariance for _, covariance in gaussians]),
        space=space,
        threshold=threshold,
        light=light,
        cast=cast,
    )
    drawn = (wanted.get(name) or default_draw(name) or own for name, own in zip(names, model.draw, strict=True))
    model = replace(model, draw=tuple(drawn))
    if background:
        model = replace(model, background=_background(captures, images, background, chosen))
    validation, remarks = _validate(model, captures, groups, images, chosen)
    notes = {
        "regions": [_noted(capture) for capture in captures],
        "learned": {
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            **(source or {}),
            "frames": sorted(images),
            "pieper": __version__,
            "numpy": np.__version__,
        },
        "validation": validation,
    }
    return Learned(replace(model, notes=notes), captures, tuple(remarks))


def _capture(region: Region, image: Image, space: Space) -> Capture:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise VisionError(f"frame {region.frame} must be a colour image of 8 bits, got {image.shape} {image.dtype}")
    cut = region.cut(image)
    every = max(1, round(np.sqrt(cut.shape[0] * cut.shape[1] / _LARGEST_REGION)))
    cut = cut[::every, ::every]
    pixels = _of_one_colour(cut, space)
    if np.median(pixels.max(axis=-1)) < DARKEST:
        raise VisionError(
            f"region {region.box} of {region.color!r} on frame {region.frame} is too dark to have a colour: "
            f"its brightest channel is {np.median(pixels.max(axis=-1)):g} of 255, {DARKEST} is the least"
        )
    x = space.of(pixels)
    mean = space.mean(x)
    away = space.minus(x, mean)
    covariance = away.T @ away / len(away)
    flat = bool(np.linalg.eigvalsh(covariance)[0] <= 1e-9 * max(np.trace(covariance), 1e-3))
    hsv = hsv_statistics(pixels)
    return Capture(region, pixels, pixels.size / cut.size, mean, covariance, *hsv, flat)


def _of_one_colour(cut: Image, space: Space) -> NDArray[np.uint8]:
    """The pixels of a region that are near the median of its middle, as often as it takes to settle."""
    height, width = cut.shape[:2]
    flat = cut.reshape(-1, 3)
    dy = np.abs(np.arange(height) - (height - 1) / 2) / height
    dx = np.abs(np.arange(width) - (width - 1) / 2) / width
    kept = (np.maximum(dy[:, None], dx[None, :]) <= 1 / 6 + 0.5 / max(min(height, width), 3)).reshape(-1)
    middle = np.median(flat[kept], axis=0)
    look = Look(space, flat)
    floor = 4.0 * np.diag(FLOOR[space.name])
    for _ in range(_ROUNDS):
        x = space.of(flat[kept])
        centre = space.of(middle[None])[0] if _ == 0 else space.mean(x)
        away = space.minus(x, centre)
        covariance = away.T @ away / len(away) if _ else np.zeros((3, 3))
        now = look.gaussian(centre, covariance + floor)[0] <= _TRIM**2
        if not now.any() or (now == kept).all():
            break
        kept = now
    return np.ascontiguousarray(flat[kept])


def _pool(group: Sequence[Capture], space: Space) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the captures of a colour, regular."""
    mean, covariance = pooled(np.array([c.mean for c in group]), np.array([c.covariance for c in group]), space)
    covariance = covariance + np.diag(FLOOR[space.name])
    if space.name == LogChroma.name:
        pixels = np.concatenate([c.pixels for c in group])
        covariance += np.diag((CLIPPED * (pixels >= 250).mean(axis=0)) ** 2)
    return mean, covariance


def _background(captures: Sequence[Capture], images: Mapping[int, Image], count: int, space: Space) -> Background:
    """What is neither in nor about a region, and is not as the colours are."""
    draw = np.random.default_rng(0)
    samples = []
    for number, image in images.items():
        free = np.ones(image.shape[:2], bool)
        for region in (capture.region for capture in captures):
            if region.frame == number:
                left, top = max(region.x - region.width, 0), max(region.y - region.height, 0)
                free[top : region.y + 2 * region.height, left : region.x + 2 * region.width] = False
        rows = np.flatnonzero(free)
        samples.append(image.reshape(-1, 3)[draw.choice(rows, min(_PIXELS, len(rows)), replace=False)])
    pixels = np.concatenate(samples)
    floor = 4.0 * np.diag(FLOOR[space.name])
    for capture in captures:  # unmarked things that look just like a marked one are not background
        own = Look(space, pixels).gaussian(capture.mean, capture.covariance + floor)[0]
        pixels = pixels[own > _ALIKE**2]
    if len(pixels) < 50 * count:
        count = len(pixels) // 50
    return _mixture(space.of(pixels), count, draw, space)


def _mixture(x: FloatArray, count: int, draw: np.random.Generator, space: Space) -> Background:
    """Clusters of points by k-means from far seeds (Arthur and Vassilvitskii 2007), each as a Gaussian."""
    if count < 1:
        return Background()
    scale = np.sqrt(space.minus(x, space.mean(x)).var(axis=0) + FLOOR[space.name])
    centres = x[[draw.integers(len(x))]]
    for _ in range(count - 1):
        squared = _squared(x, centres, scale, space).min(axis=1)
        if squared.sum() <= 0:
            break  # fewer colours than clusters
        centres = np.concatenate([centres, x[[draw.choice(len(x), p=squared / squared.sum())]]])
    for _ in range(15):
        nearest = _squared(x, centres, scale, space).argmin(axis=1)
        centres = np.array([space.mean(x[nearest == i]) if (nearest == i).any() else c for i, c in enumerate(centres)])
    nearest = _squared(x, centres, scale, space).argmin(axis=1)
    rows = []
    for i, centre in enumerate(centres):
        away = space.minus(x[nearest == i], centre)
        if len(away):
            rows.append((len(away) / len(x), centre, away.T @ away / len(away) + np.diag(FLOOR[space.name])))
    return Background(*(np.array(part) for part in zip(*rows, strict=True)))


def _squared(x: FloatArray, centres: FloatArray, scale: FloatArray, space: Space) -> FloatArray:
    return np.stack([((space.minus(x, centre) / scale) ** 2).sum(axis=1) for centre in centres], axis=1)


def _validate(
    model: ColorModel,
    captures: Sequence[Capture],
    groups: Sequence[Sequence[Capture]],
    images: Mapping[int, Image],
    space: Space,
) -> tuple[dict[str, Any], list[str]]:
    """What becomes of the samples and of the frames, and what ought to be said."""
    table = model.table()
    remarks = []
    for capture in captures:
        where = f"region {capture.region.box} of {capture.region.color!r} on frame {capture.region.frame}"
        if capture.flat:
            size = f"{len(capture.pixels)} pixels" if len(capture.pixels) > 1 else "one pixel"
            remarks.append(f"{where} is flat ({size}): its covariance is singular, and was widened to be used")
        if capture.share < _PORTION:
            remarks.append(f"only {capture.share:.0%} of {where} is one colour; a tighter box says more")
    confusion, separation, held_out = {}, {}, {}
    for name, group in zip(model.names, groups, strict=True):
        pixels = np.concatenate([c.pixels for c in group])
        counts = np.bincount(table.classify(pixels[None]).reshape(-1), minlength=len(model.names) + 1) / len(pixels)
        confusion[name] = {
            other: round(float(share), 4) for other, share in zip(("none", *model.names), counts, strict=True)
        }
        if len(group) > 1:
            held_out[name] = round(_held_out(model, group, space), 4)
    for i, first in enumerate(model.names):
        for second in model.names[i + 1 :]:
            apart = model.separation(first, second)
            separation[f"{first} - {second}"] = round(apart, 2)
            taken = max(confusion[first][second], confusion[second][first])
            if taken > CONFUSED or apart < model.threshold:
                remarks.append(
                    f"colours {first!r} and {second!r} overlap: {confusion[first][second]:.1%} of the pixels of {first!r} "
                    f"are taken for {second!r}, {confusion[second][first]:.1%} the other way, and their means are "
                    f"{apart:.1f} apart (Mahalanobis, changes of light allowed for); mark them more exactly, or use fewer colours"
                )
    remarks += [
        f"{shares['none']:.0%} of the pixels of {name!r} are taken for background; it looks the same"
        for name, shares in confusion.items()
        if shares["none"] > 0.5
    ]
    explained = {}
    for number in sorted(images):
        image = images[number]
        counts = np.bincount(table.classify(image).reshape(-1), minlength=len(model.names) + 1) / image[..., 0].size
        explained[str(number)] = {n: round(float(s), 5) for n, s in zip(model.names, counts[1:], strict=True)}
    report = {"confusion": confusion, "separation": separation, "held_out": held_out, "explained": explained}
    return report, remarks


def _held_out(model: ColorModel, group: Sequence[Capture], space: Space) -> float:
    """Share of the pixels of each capture within the threshold of what the other captures of its colour make, on average."""
    shares = []
    for i, capture in enumerate(group):
        mean, covariance = _pool([c for j, c in enumerate(group) if j != i], space)
        covariance = covariance + space.spread(mean, model.light, model.cast)
        shares.append((Look(space, capture.pixels).gaussian(mean, covariance)[0] <= model.threshold**2).mean())
    return float(np.mean(shares))


def _noted(capture: Capture) -> dict[str, Any]:
    region = capture.region
    return {
        "color": region.color,
        "frame": region.frame,
        "roi": [region.x, region.y, region.width, region.height],
        "pixels": len(capture.pixels),
        "share": round(capture.share, 4),
        "flat": capture.flat,
        "hsv_mean": capture.hsv_mean.round(4),
        "hsv_covariance": capture.hsv_covariance.round(4),
    }


def hsv_of(captures: Sequence[Capture]) -> tuple[FloatArray, FloatArray]:
    """Return mean (3,) and covariance (3, 3) of captures of one colour in HSV: within and between, with a hue that wraps."""
    means = np.array([c.hsv_mean for c in captures])
    return pooled(means, np.array([c.hsv_covariance for c in captures]), space_named("hsv"))


def classified(image: Image, model: ColorModel) -> Image:
    """Return a frame and, beside it, the same frame darkened, with what is of a colour in the colour it is drawn in."""
    paint = np.array([(0, 0, 0), *model.draw], np.uint8)
    return np.hstack([image, np.maximum(image // 4, paint[model.table().classify(image)])])


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
            raise colors.error(name, "must be lists of whole numbers: frame, x, y, w, h")
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
