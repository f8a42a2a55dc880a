"""The report's tracker behind the same door as ours: frames in, steps out."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError
from pieper.perception.blobs import Blobs
from pieper.perception.pipeline import Step
from pieper.perception.report import ReportColor, ReportTracker
from pieper.perception.sighting import Sighting

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from pieper.perception.frame import Frame, Image
    from pieper.perception.report import Patch

SINGLE = ("red", "blue", "rojo", "azul")
"""Colours of which the report follows the largest patch, with a filter; of others it takes every patch."""


class ReportPipeline:
    """A `ReportTracker` that gives a `Step` for each frame.

    Parameters
    ----------
    tracker : ReportTracker
    """

    def __init__(self, tracker: ReportTracker) -> None:
        self.tracker = tracker
        self._names = tuple(color.name for color in tracker.colors)

    def step(self, frame: Frame) -> Step:
        """Take one frame."""
        begun = perf_counter()
        estimates = tuple(self.tracker.update(frame))
        spent = 1e3 * (perf_counter() - begun)
        seen = [patch for patch in self.tracker.patches if not patch.occluded]
        blobs = _circles(seen, self._names)
        sightings = tuple(
            Sighting("marker", patch.color, blobs.centroid[row], None, np.eye(2), (row,))
            for row, patch in enumerate(seen)
        )
        return Step(frame.index, frame.time, blobs, sightings, estimates, {"total": spent})


def _circles(patches: Sequence[Patch], names: tuple[str, ...]) -> Blobs:
    """The report's circles; what it does not say of them is that of a disc."""
    k = len(patches)
    centroid = np.array([[p.x, p.y] for p in patches], dtype=np.float64).reshape(k, 2)
    radius = np.array([p.radius for p in patches], dtype=np.float64)
    corner = np.round(centroid - radius[:, None])
    return Blobs(
        names=names,
        color=np.array([names.index(p.color) for p in patches], dtype=np.int64),
        centroid=centroid,
        covariance=np.broadcast_to(np.eye(2), (k, 2, 2)).copy(),
        area=np.pi * radius**2,
        extent=np.concatenate([corner, np.round(2 * radius)[:, None].repeat(2, axis=1)], axis=1).astype(np.int64),
        circularity=np.ones(k),
    )


def report_colors(
    notes: Mapping[str, Any], read: Callable[[int], Image], *, single: Sequence[str] = SINGLE
) -> list[ReportColor]:
    """Learn the report's Gaussians from the regions that a colour file lists.

    Parameters
    ----------
    notes : mapping
        `ColorModel.notes`, with ``regions``.
    read : callable
        From the number of a frame to its image, in the video that the regions were taken from.
    single : sequence of str
        Colours with one marker.

    Raises
    ------
    VisionError
        No regions are listed, or one does not suffice.
    """
    regions: dict[str, list[Image]] = {}
    for entry in notes.get("regions") or ():
        try:
            name, number = str(entry["color"]), int(entry["frame"])
            x, y, width, height = (int(n) for n in entry["roi"])
        except (KeyError, TypeError, ValueError) as cause:
            raise VisionError(
                f"a region of the colours is malformed: {entry}; it needs color, frame and roi"
            ) from cause
        regions.setdefault(name, []).append(read(number)[y : y + height, x : x + width])
    if not regions:
        raise VisionError(
            "the colours list no regions, from which the report's method learns; learn them with pieper learn-colour"
        )
    return [ReportColor.learn(name, cuts, single=name.lower() in single) for name, cuts in regions.items()]


def learned_from(notes: Mapping[str, Any], colors: Path, tracked: str) -> Path:
    """Return the video that colours were learnt from.

    Raises
    ------
    VisionError
        It is not where the file says, nor beside the file, nor the one that is tracked.
    """
    learned = notes.get("learned")
    words = (
        [str(v) for k, v in learned.items() if k in ("video", "source", "path")] if isinstance(learned, dict) else []
    )
    for word in words:
        for place in (Path(word), colors.parent / Path(word).name, Path(tracked)):
            if place.name == Path(word).name and place.exists():
                return place
    raise VisionError(
        f"the report's method learns from the regions in {colors}, and their video {' '.join(words) or '(not named)'} is not there"
    )
