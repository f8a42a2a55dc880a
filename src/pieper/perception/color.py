"""Colours as distributions of pixels, with the background beside them: what a colour is, in a file and as a table.

A pixel belongs to the colour whose density there is greatest, if its Mahalanobis distance ::

    d^2 = (x - m)^T (C + L + N(pixel))^-1 (x - m)

is at most the threshold, and the background is not likelier. C is the covariance that was learned, L what changes of the light may add,
N the noise of that pixel, which is much where it is dark. A pixel has one colour at most.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from pieper.errors import ArrayError, VisionError, unknown_name
from pieper.perception.color_space import OFFSET, LogChroma, Space, space_named
from pieper.perception.color_table import BITS, ColorTable
from pieper.perception.drawn_color import DRAWN, Bgr, as_hex, draw_color, from_hsv
from pieper.spatial._checks import stack
from pieper.yaml_file import Section, read_yaml, write_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from pieper.spatial._checks import FloatArray

__all__ = [
    "BRIGHTER",
    "CAST",
    "DARKEST",
    "DIMMER",
    "DRAWN",
    "FORMAT",
    "LIGHT",
    "ODDS",
    "THRESHOLD",
    "Background",
    "Bgr",
    "ColorModel",
    "Look",
    "draw_color",
]

FORMAT = "pieper colors 1"
THRESHOLD = 4.0
"""Mahalanobis distance: 99.9 % of the pixels of a Gaussian colour lie within it."""
ODDS = 10.0
"""How much likelier a pixel is of the background than of a colour, before it is looked at; markers are far fewer pixels than that."""
LIGHT, CAST = 0.35, 0.06
"""Standard deviations of the light and of its colour, as logarithms: the light may halve at two of them, a channel change by a ninth."""
DARKEST = 24
"""The brightest channel of a pixel that can have a colour [grey levels]."""
DIMMER, BRIGHTER = 6.0, 3.0
"""How much the brightest channel of a pixel may be below and above that of its colour, whatever the distance."""
_FEWEST_EIGENVALUE = 1e-12


@dataclass(frozen=True, eq=False)
class Background:
    """What is no colour, as a mixture of Gaussians.

    Attributes
    ----------
    weights : (b,) array
        Shares, with sum 1; none if there is no background.
    means, covariances : (b, 3) and (b, 3, 3) arrays
        In the space of the model.
    """

    weights: FloatArray = field(default_factory=lambda: np.zeros(0))
    means: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    covariances: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))

    def __post_init__(self) -> None:
        _freeze(self, "weights", "means", "covariances")


@dataclass(frozen=True, eq=False)
class ColorModel:
    """What each colour looks like.

    Attributes
    ----------
    names : tuple of str
        The colours.
    means, covariances : (k, 3) and (k, 3, 3) arrays
        Of their pixels, in the space; covariances are within captures and between them together.
    draw : tuple of (int, int, int)
        Blue, green, red in which each is drawn.
    space : str
        ``"log-chroma"`` or ``"hsv"``.
    threshold : float
        Mahalanobis distance d within which a pixel may be of a colour. Not its square.
    light, cast : float
        Standard deviations of the light, and of its colour, that a colour may be seen under [logarithm].
    background : Background
    odds : float
        Of the background against each colour, for a pixel that was not looked at yet.
    gain : (3,) array
        Logarithm of the light of now, against that of learning, in blue, green and red. Only in log-chroma.
    shifts : (k, 3) array
        What the light of now adds to the mean of each colour beyond that. Only in log-chroma.
    notes : mapping
        Where it comes from and how it was tested, as `learn` writes it: plain data, kept in the file.

    Raises
    ------
    ArrayError
        A shape is wrong, or a covariance is not positive definite.
    VisionError
        Names are missing or doubled, or a number is out of range.

    Examples
    --------
    >>> spread = 0.01 * np.eye(3)
    >>> model = ColorModel(("red", "blue"), np.log([[46, 46, 236], [236, 76, 46]]), [spread, spread])
    >>> picture = np.array([[[30, 30, 220], [12, 12, 88], [220, 60, 30], [90, 90, 90]]], np.uint8)
    >>> model.classify(picture)  # the second is the first at 0.4 of the light
    array([[1, 1, 2, 0]], dtype=uint8)
    >>> round(model.share_inside, 4)
    0.9989
    """

    names: tuple[str, ...]
    means: FloatArray
    covariances: FloatArray
    draw: tuple[Bgr, ...] = ()
    space: str = LogChroma.name
    threshold: float = THRESHOLD
    light: float = LIGHT
    cast: float = CAST
    background: Background = field(default_factory=Background)
    odds: float = ODDS
    gain: FloatArray = field(default_factory=lambda: np.zeros(3))
    shifts: FloatArray = field(default_factory=lambda: np.zeros(0))
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = tuple(str(name) for name in self.names)
        k = len(names)
        if not names or len(set(names)) < k or not all(name.strip() for name in names) or k > 255:
            raise VisionError(f"names must be 1 to 255 different words, got {names}")
        object.__setattr__(self, "names", names)
        space_named(self.space)
        object.__setattr__(self, "means", stack(self.means, (3,), "means").reshape(-1, 3))
        object.__setattr__(self, "covariances", stack(self.covariances, (3, 3), "covariances").reshape(-1, 3, 3))
        if np.size(self.shifts) == 0:
            object.__setattr__(self, "shifts", np.zeros((k, 3)))
        _freeze(self, "means", "covariances", "shifts", "gain")
        for name, shape in {"means": (k, 3), "covariances": (k, 3, 3), "shifts": (k, 3)}.items():
            if getattr(self, name).shape != shape:
                raise ArrayError(f"{name} must have shape {shape} for {k} colours, got {getattr(self, name).shape}")
        for name, covariance in zip(names, self.covariances, strict=True):
            if not _definite(covariance):
                raise ArrayError(
                    f"the covariance of {name!r} must be symmetric and positive definite, got {covariance.tolist()}"
                )
        for which, least, most in (
            ("threshold", 0.1, 100.0),
            ("light", 0.0, 5.0),
            ("cast", 0.0, 5.0),
            ("odds", 0.0, 1e6),
        ):
            if not least <= getattr(self, which) <= most:
                raise VisionError(f"{which} must be from {least:g} to {most:g}, got {getattr(self, which)}")
        if self.space != LogChroma.name and (self.gain.any() or self.shifts.any()):
            raise VisionError(f"only colours in {LogChroma.name} follow the light, these are in {self.space}")
        draw = self.draw or tuple(self._middle(i) for i in range(k))
        if len(draw) != k:
            raise VisionError(f"draw must have {k} colours, one for each name, got {len(draw)}")
        object.__setattr__(self, "draw", tuple(draw))

    @property
    def share_inside(self) -> float:
        """Share of the pixels of a Gaussian colour within the threshold: chi-square of its square, with 3 degrees of freedom."""
        return float(chi2.cdf(self.threshold**2, 3))

    def index(self, name: str) -> int:
        """Return the place of a colour among the names.

        Raises
        ------
        UnknownNameError
            There is none of that name.
        """
        if name not in self.names:
            raise unknown_name("colour", name, self.names, "this colour model")
        return self.names.index(name)

    def distance(self, image: NDArray[Any], name: str) -> FloatArray:
        """Return the Mahalanobis distance of each pixel to a colour.

        Parameters
        ----------
        image : (..., 3) array
            Blue, green, red, 0 to 255.
        name : str
            The colour.

        Returns
        -------
        (...) array
            d, not its square.
        """
        pixels = _pixels(image)
        k = self.index(name)
        look = Look(space_named(self.space), pixels.reshape(-1, 3))
        squared = look.gaussian(self._now[k], self._spread[k])[0]
        return np.asarray(np.sqrt(squared).reshape(pixels.shape[:-1]))

    def mask(self, image: NDArray[Any], name: str, threshold: float | None = None) -> NDArray[np.bool_]:
        """Return where pixels are within a distance of a colour, whatever else they may be near to.

        Parameters
        ----------
        image : (..., 3) array
            Blue, green, red.
        name : str
            The colour.
        threshold : float, optional
            Mahalanobis distance d, that of the model if not given.

        Returns
        -------
        (...) bool array
            `classify` gives one colour to each pixel; masks may overlap.
        """
        return self.distance(image, name) <= (self.threshold if threshold is None else threshold)

    def classify(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """Return the label of each pixel ``(...)``: 0 none, 1 the first colour, ...; `table` is the fast way."""
        pixels = _pixels(image)
        look = Look(space_named(self.space), pixels.reshape(-1, 3))
        density, labels = np.zeros(len(look.x)), np.zeros(len(look.x), np.uint8)
        for k in range(len(self.names)):
            self._claim(k, look, np.arange(len(labels)), density, labels)
        self._leave_background(look, density, labels)
        return labels.reshape(pixels.shape[:-1])

    def table(self, bits: int = BITS) -> ColorTable:
        """Return the model as a table over all pixels, one colour at most for each cell, as at the middle of the cell."""
        side = 1 << bits
        middle = ((np.arange(side) + 0.5) * (256 / side) - 0.5).astype(np.float32)
        density, labels = np.zeros(side**3, np.float32), np.zeros(side**3, np.uint8)
        for k in range(len(self.names)):
            cells = self._near(k, middle)
            self._claim(k, self._look(cells, middle), cells, density, labels)
        found = np.flatnonzero(labels)
        kept = labels[found]
        if self.background.weights.size:
            self._leave_background(self._look(found, middle), density[found], kept)
        labels[found] = kept
        return ColorTable(self.names, labels.reshape(side, side, side))

    def _look(self, cells: NDArray[Any], middle: NDArray[Any]) -> Look:
        side = len(middle)
        pixels = middle[np.stack([cells // side**2, cells // side % side, cells % side], axis=-1)]
        return Look(space_named(self.space), pixels, np.float32)

    def relit(self, gain: ArrayLike, shifts: ArrayLike | None = None) -> ColorModel:
        """Return the model as it looks under another light.

        Parameters
        ----------
        gain : (3,) array
            Logarithm of the light in blue, green and red, against that of learning.
        shifts : (k, 3) array, optional
            Added to the mean of each colour after that.

        Returns
        -------
        ColorModel

        Raises
        ------
        VisionError
            The model is not in log-chroma.
        """
        moved = np.zeros((len(self.names), 3)) if shifts is None else stack(shifts, (len(self.names), 3), "shifts")
        return replace(self, gain=stack(gain, (3,), "gain"), shifts=moved)

    @cached_property
    def _now(self) -> FloatArray:
        """Means under the light of now."""
        return self._lit(self.means) + self.shifts

    @cached_property
    def _spread(self) -> FloatArray:
        """Covariances with what the light may add, without the noise of a pixel, ``(k, 3, 3)``."""
        space = space_named(self.space)
        light = np.array([space.spread(mean, self.light, self.cast) for mean in self._now])
        return np.asarray(self.covariances + light)

    def _lit(self, x: FloatArray) -> FloatArray:
        return LogChroma().lit(x, self.gain) if self.gain.any() else x

    def separation(self, first: str, second: str) -> float:
        """Return the Mahalanobis distance between the means of two colours, with the mean of their spreads."""
        i, j = self.index(first), self.index(second)
        away = space_named(self.space).minus(self._now[i].copy(), self._now[j])
        return float(np.sqrt(away @ np.linalg.solve((self._spread[i] + self._spread[j]) / 2, away)))

    def save(self, path: str | Path) -> None:
        """Write the model as YAML."""
        data = {
            "format": FORMAT,
            "space": self.space,
            "threshold": self.threshold,
            "share_inside": round(self.share_inside, 5),
            "light": self.light,
            "cast": self.cast,
            "odds": self.odds,
            "colors": {
                name: {"draw": as_hex(draw), "mean": _short(mean), "covariance": _short(covariance)}
                for name, draw, mean, covariance in zip(self.names, self.draw, self._now, self.covariances, strict=True)
            },
            "background": {
                "weights": _short(self.background.weights),
                "means": _short(self._lit(self.background.means)),
                "covariances": _short(self.background.covariances),
            },
            **self.notes,
        }
        comment = (
            "Colours as pixels of a video, for `pieper track --colors`.\n"
            "threshold: Mahalanobis distance d (not squared); share_inside: share of a colour's own pixels within it.\n"
            "Means are of log(blue + 16), log(green + 16), log(red + 16)."
            if self.space == LogChroma.name
            else "Colours as pixels of a video, for `pieper track --colors`.\nMeans are of hue [0, 180), saturation, value."
        )
        write_yaml(path, data, comment=comment)

    @classmethod
    def load(cls, path: str | Path) -> ColorModel:
        """Read a model that `save` wrote, or a person.

        Raises
        ------
        VisionError
            The file is malformed; the message names line and field.
        """
        return _from_yaml(read_yaml(path))

    def _middle(self, k: int) -> Bgr:
        """The colour itself, to draw it with."""
        from pieper.perception.color_space import Hsv

        if self.space == Hsv.name:
            return from_hsv(self.means[k])
        b, g, r = np.clip(np.exp(np.minimum(self.means[k], 9.0)) - OFFSET, 0, 255).round().astype(int).tolist()
        return b, g, r

    def _claim(self, k: int, look: Look, cells: NDArray[Any], density: NDArray[Any], labels: NDArray[np.uint8]) -> None:
        """Give the label of colour k to those of the cells, which look so, that are likelier of it than of those before."""
        squared, det = look.gaussian(self._now[k], self._spread[k])
        takes = (squared <= self.threshold**2) & (look.brightest >= DARKEST)
        if self.space == LogChroma.name:
            high = np.exp(self._now[k].max()) - OFFSET
            takes &= (look.brightest > high / DIMMER) & (look.brightest < high * BRIGHTER)
        rows = np.flatnonzero(takes)
        height = np.exp(-0.5 * squared[rows]) / np.sqrt(det[rows])
        likelier = height > density[cells[rows]]
        density[cells[rows[likelier]]] = height[likelier]
        labels[cells[rows[likelier]]] = k + 1

    def _leave_background(self, look: Look, density: NDArray[Any], labels: NDArray[np.uint8]) -> None:
        """Take labels away where the background is likelier."""
        ground = self.background
        total = np.zeros(len(labels), look.x.dtype)
        for weight, mean, covariance in zip(ground.weights, self._lit(ground.means), ground.covariances, strict=True):
            squared, det = look.gaussian(mean, covariance + look.space.spread(mean, self.light, self.cast))
            total += self.odds * weight * np.exp(-0.5 * squared) / np.sqrt(det)
        labels[total > density] = 0

    def _near(self, k: int, middle: NDArray[Any]) -> NDArray[Any]:
        """Cells that may be within the threshold: by any two channels alone, whose distance is never more than that by all three."""
        side = len(middle)
        if self.space != LogChroma.name:
            return np.arange(side**3)
        space = space_named(self.space)
        x = space.of(middle)[:, None] - self._now[k]
        variance = np.diagonal(self._spread[k]) + space.noise(middle)[:, None]
        pairs = []
        for i, j in ((0, 1), (1, 2), (0, 2)):
            u, v, a, d = x[:, i, None], x[None, :, j], variance[:, i, None], variance[None, :, j]
            b = self._spread[k][i, j]
            pairs.append(u * u * d - 2 * u * v * b + v * v * a <= self.threshold**2 * (a * d - b * b))
        blue_green, green_red, blue_red = pairs
        return np.flatnonzero(blue_green[:, :, None] & green_red[None] & blue_red[:, None])


class Look:
    """Pixels in a space, with the noise that each has there.

    Parameters
    ----------
    space : Space
    pixels : (n, 3) array
        Blue, green, red.
    dtype : type
        In which it is computed; half as many bits do for a table.
    """

    def __init__(self, space: Space, pixels: NDArray[Any], dtype: type = np.float64) -> None:
        self.space = space
        self.brightest: NDArray[Any] = np.maximum(np.maximum(pixels[:, 0], pixels[:, 1]), pixels[:, 2])
        self.x: NDArray[Any] = np.asfortranarray(space.of(pixels), dtype=dtype)  # by columns, as they are used
        self.noise: NDArray[Any] = np.ascontiguousarray(space.noise(pixels).T, dtype=dtype)

    def __getitem__(self, rows: NDArray[Any]) -> Look:
        part = object.__new__(Look)
        part.space, part.brightest, part.x, part.noise = (
            self.space,
            self.brightest[rows],
            self.x[rows],
            self.noise[:, rows],
        )
        return part

    def gaussian(self, mean: FloatArray, covariance: FloatArray) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return squared Mahalanobis distances and determinants, ``(n,)`` each, with the noise of each pixel in its covariance."""
        kind = self.x.dtype.type
        x, y, z = np.ascontiguousarray(self.space.minus(self.x, mean.astype(kind)).T)
        # The inverse of [a b c; b d e; c e f] by its adjugate, for all pixels at once.
        a, d, f = (n + kind(covariance[i, i]) for i, n in enumerate(self.noise))
        b, c, e = (kind(covariance[i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        A, B, C, D, E, F = d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b
        det = np.maximum(a * A + b * B + c * C, kind(1e-30))
        squared = (x * (x * A + 2 * (y * B + z * C)) + y * (y * D + 2 * z * E) + z * z * F) / det
        return np.maximum(squared, kind(0.0)), det


def _from_yaml(file: Section) -> ColorModel:
    said = file.text("format", FORMAT)
    if said != FORMAT:
        raise file.error("format", f"must be {FORMAT!r}, got {said!r}")
    file.only(
        "format",
        "space",
        "threshold",
        "share_inside",
        "light",
        "cast",
        "odds",
        "colors",
        "background",
        "regions",
        "learned",
        "validation",
    )
    colors = file.section("colors")
    if not len(colors):
        raise file.error("colors", "must have one colour at least")
    space = file.text("space", LogChroma.name)
    if space not in (LogChroma.name, "hsv"):
        raise file.error("space", str(unknown_name("space", space, [LogChroma.name, "hsv"])))
    means, covariances, draw = [], [], []
    for name in colors:
        color = colors.section(name)
        color.only("draw", "mean", "covariance")
        means.append(color.array("mean", (3,)))
        covariances.append(_covariance(color, "covariance", color.array("covariance", (3, 3))))
        draw.append(_draw(color))
    k = len(means)
    model = ColorModel(
        tuple(colors),
        np.array(means),
        np.array(covariances),
        space=space,
        threshold=file.number("threshold", THRESHOLD, least=0.1, most=100.0),
        light=file.number("light", LIGHT, least=0.0, most=5.0),
        cast=file.number("cast", CAST, least=0.0, most=5.0),
        background=_background(file.section("background", None)),
        odds=file.number("odds", ODDS, least=0.0, most=1e6),
        notes=file.plain("regions", "learned", "validation"),
    )
    return replace(model, draw=tuple(draw[i] or model.draw[i] for i in range(k)))


def _background(section: Section | None) -> Background:
    if section is None:
        return Background()
    weights = section.array("weights", (None,))
    n = len(weights)
    if not n:
        return Background()
    if (weights <= 0).any() or weights.sum() > 1.001:
        raise section.error(
            "weights", f"must be positive, with a sum of 1, got {weights.tolist()}, which sum to {weights.sum():g}"
        )
    covariances = section.array("covariances", (n, 3, 3))
    for covariance in covariances:
        _covariance(section, "covariances", covariance)
    return Background(weights, section.array("means", (n, 3)), covariances)


def _covariance(section: Section, key: str, matrix: FloatArray) -> FloatArray:
    if not _definite(matrix):
        raise section.error(
            key, f"must be symmetric and positive definite, got {matrix.tolist()}; learn the colours again"
        )
    return matrix


def _definite(matrix: FloatArray) -> bool:
    scale = float(np.abs(matrix).max())
    if not 0.0 < scale < 1e9 or not np.allclose(matrix, matrix.T, atol=1e-9 * scale):
        return False
    return bool(np.linalg.eigvalsh(matrix)[0] > _FEWEST_EIGENVALUE)


def _draw(section: Section) -> Bgr | None:
    if "draw" not in section:
        return None
    text = section.text("draw")
    try:
        return draw_color(text)
    except VisionError as error:
        raise section.error("draw", str(error)) from None


def _short(array: FloatArray) -> list[Any]:
    """Numbers with as many digits as they are known to, so that people can read them."""
    return [_short(row) if row.ndim else float(f"{row:.7g}") for row in np.asarray(array)]


def _pixels(image: NDArray[Any]) -> NDArray[Any]:
    pixels = np.asarray(image)
    if pixels.ndim < 1 or pixels.shape[-1] != 3 or pixels.dtype.kind not in "uif":
        raise ArrayError(
            f"image must have shape (..., 3), blue green red from 0 to 255, got {pixels.shape} {pixels.dtype}"
        )
    if pixels.dtype != np.uint8:
        if pixels.size and not (pixels.min() >= 0 and pixels.max() <= 255):
            raise ArrayError("image must be blue, green, red from 0 to 255; scale 16-bit images down first")
        return pixels.astype(np.float64)
    return pixels


def _freeze(thing: Any, *names: str) -> None:
    for name in names:
        array = np.array(getattr(thing, name), dtype=np.float64)
        array.flags.writeable = False
        object.__setattr__(thing, name, array)
