"""The pass mark for the light, on the rendered scene: it falls to two fifths and takes on a cast of 15 %."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.perception.adapt import LightAdaptation
from pieper.perception.color_learning import learn
from pieper.perception.color_regions import Region
from pieper.perception.scene_presets import preset
from pieper.perception.segment import segment
from pieper.perception.synthetic import Renderer

EVERY = 10
"""Frames are 0.17 s apart instead of 1/60: harder to follow, and faster to draw."""

NEAR = 3.0
"""[px] from a marker's centre within which a blob of its colour is that marker; markers are 10 px wide and more."""

HALF = 3
"""[px] of a box, of 7 by 7, inside the smallest marker however it is turned."""


def boxes(renderer):
    """A box on up to two markers of each colour, on each of the first two frames: as a person would draw them."""
    found = []
    for n in (0, 1):
        count = {}
        for marker in (m for thing in renderer.truth(n).objects for m in thing.markers if m.visible > 0.99):
            count[marker.color] = count.get(marker.color, 0) + 1
            if count[marker.color] <= 2:
                x, y = (np.rint(marker.image).astype(int) - HALF).tolist()
                found.append(Region(marker.color, n, x, y, 2 * HALF + 1, 2 * HALF + 1))
    return found


@pytest.mark.parametrize("cast", [(0.0, 0.15), (0.0, -0.15)])
def test_99_percent_of_markers_are_found_without_learning_again(cast):
    renderer = Renderer(preset("light-ramp").but(cast=cast))
    learned = learn(lambda n: renderer[n][0].image, boxes(renderer))
    light = LightAdaptation(learned.model)
    found = total = false = 0
    for n in range(0, len(renderer), EVERY):
        frame, truth = renderer[n]
        blobs = segment(frame.image, light.table)
        rows = set()
        for marker in (m for thing in truth.objects for m in thing.markers if m.visible > 0.5):
            near = np.hypot(*(blobs.centroid - marker.image).T) < NEAR
            hits = np.flatnonzero(near & (blobs.color == blobs.names.index(marker.color)))
            total += 1
            found += bool(len(hits))
            rows.update(hits[:1].tolist())
        false += len(blobs) - len(rows)
        light.update(frame, blobs.select(np.array(sorted(rows), dtype=np.int64)))
    assert total > 900
    assert found >= 0.99 * total
    assert false <= 0.01 * total
    assert light.light < 0.6
