"""Frames with discs of known colours at known places, under any light."""

from __future__ import annotations

import numpy as np

from pieper.perception.blobs import Blobs
from pieper.perception.color_learning import learn
from pieper.perception.color_regions import Region

PAINT = {"red": (45, 40, 205), "blue": (205, 90, 25), "green": (95, 225, 60)}
PLACES = {"red": [(30, 30), (90, 70)], "blue": [(90, 30), (30, 70)], "green": [(150, 30), (150, 70)]}
FIELD = (62, 104, 46)
RADIUS = 11
SIZE = (180, 100)  # width, height


def frame(*, light=1.0, cast=(1.0, 1.0, 1.0), noise=3.0, seed=0, places=PLACES, field=FIELD):
    """An image of discs; the light multiplies every channel, the cast each by its own factor."""
    width, height = SIZE
    image = np.empty((height, width, 3))
    image[:] = field
    v, u = np.mgrid[:height, :width]
    for name, centres in places.items():
        for x, y in centres:
            image[(u - x) ** 2 + (v - y) ** 2 <= RADIUS**2] = PAINT[name]
    image *= light * np.asarray(cast)
    image += np.random.default_rng(seed).normal(0.0, noise, image.shape) if noise else 0.0
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def box(name, which=0, number=0, half=7):
    x, y = PLACES[name][which]
    return Region(name, number, x - half, y - half, 2 * half + 1, 2 * half + 1)


def learned(**options):
    """A model from one box for each colour on one frame, and one on another."""
    frames = [frame(seed=1), frame(seed=2)]
    regions = [box(name, which, which) for name in PAINT for which in (0, 1)]
    return learn(frames.__getitem__, regions, **options)


def blobs(rows):
    """Blobs from ``(name, (x, y), radius)``."""
    names = tuple(PAINT)
    k = len(rows)
    return Blobs(
        names,
        np.array([names.index(name) for name, _, _ in rows], np.int64),
        np.array([place for _, place, _ in rows], float).reshape(k, 2),
        np.tile(0.01 * np.eye(2), (k, 1, 1)),
        np.array([np.pi * radius**2 for _, _, radius in rows], float),
        np.zeros((k, 4), np.int64),
        np.ones(k),
    )


def markers(places=PLACES):
    return blobs([(name, place, RADIUS) for name, centres in places.items() for place in centres])


def share_found(image, table, places=PLACES):
    """Share of the markers of which most pixels of the inner disc have the right label."""
    labels = table.classify(image)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    found = [
        (labels[(u - x) ** 2 + (v - y) ** 2 <= (RADIUS - 2) ** 2] == table.names.index(name) + 1).mean() > 0.8
        for name, centres in places.items()
        for x, y in centres
    ]
    return float(np.mean(found))
