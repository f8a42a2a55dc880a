"""Colour models from regions that somebody marked on chosen frames, with a report of how well they hold.

Each region is a capture of one colour. What of it is not that colour (the corners around a disc, a rim) is left out: the pixels kept
are those near the median of its middle. Captures of a colour are pooled, within and between. The rest of the frames is the background.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._version import __version__
from pieper.errors import VisionError
from pieper.perception.color import CAST, DARKEST, LIGHT, THRESHOLD, Background, ColorModel, Look
from pieper.perception.color_regions import Region, parse_region, read_regions
from pieper.perception.color_space import LogChroma, Space, hsv_statistics, pooled, space_named
from pieper.perception.drawn_color import Bgr, default_draw

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

__all__ = [
    "CLIPPED",
    "COMPONENTS",
    "CONFUSED",
    "FLOOR",
    "Capture",
    "Learned",
    "Region",
    "classified",
    "hsv_of",
    "learn",
    "parse_region",
    "read_regions",
]

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
    pixels = _of_one_color(cut, space)
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


def _of_one_color(cut: Image, space: Space) -> NDArray[np.uint8]:
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
