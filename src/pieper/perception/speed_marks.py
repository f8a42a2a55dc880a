"""How fast colours become blobs, and frames become robots, beside routes by OpenCV and the report's method."""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.perception.opencv import opencv
from pieper.perception.pass_mark import Mark
from pieper.perception.pattern import Patterns
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.report import ReportTracker
from pieper.perception.scene_colors import learned, report_colors
from pieper.perception.scene_presets import preset
from pieper.perception.segment import segment
from pieper.perception.synthetic import Renderer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from pieper.perception.color_table import ColorTable
    from pieper.perception.frame import Image

VGA, FULL_HD = (640, 480), (1920, 1080)


def speed_marks(quick: bool) -> list[Mark]:
    """Three colours to blobs, beside the routes by OpenCV."""
    marks = []
    for size, name, limit in ((VGA, "VGA", 0.8), (FULL_HD, "1080p", 5.0)):
        scene = preset("report", size)
        image = Renderer(scene)[30][0].image
        table, theirs = learned(scene).table(), ReportTracker(report_colors(scene))
        routes = opencv_routes(image, table)
        candidates: dict[str, Callable[[], object]] = {
            "pieper": lambda image=image, table=table: segment(image, table),  # type: ignore[misc]
            "report": lambda image=image, theirs=theirs: theirs.find(image),  # type: ignore[misc]
            **routes,
        }
        seconds = _in_turn(candidates, rounds=5 if quick else 25)
        ms = {key: 1e3 * statistics.median(values) for key, values in seconds.items()}
        best = min(routes, key=lambda key: ms[key])
        ratio = {key: _median_ratio(seconds[key], seconds["pieper"]) for key in ("report", best)}
        details = {"milliseconds": ms, "best_opencv": best}
        what = f"three colours to blobs, {name}"
        marks += [
            Mark(what, "ms CPU", ms["pieper"], limit, report=ms["report"], details=details),
            Mark(f"{what}: faster than the report", "x", ratio["report"], 100.0, at_least=True, report=1.0),
            Mark(
                f"{what}: faster than the best of OpenCV",
                "x",
                ratio[best],
                2.0,
                at_least=True,
                report=None,
                details=details,
            ),
        ]
    return marks


def opencv_routes(image: Image, table: ColorTable) -> dict[str, Callable[[], object]]:
    """Return ways to blobs by OpenCV alone, each with area and centroid of every patch of every colour.

    Colours are boxes around the pixels that the table gives them, in HSV or in blue, green, red; or bits that a table for each channel gives.
    """
    cv2 = opencv("the routes by OpenCV")
    labels, names = table.classify(image), range(1, len(table.names) + 1)
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    in_hsv, in_bgr = ([_box(space[labels == k]) for k in names] for space in (hsv, image))
    bits = np.zeros((256, 1, 3), np.uint8)
    for k, (low, high) in enumerate(in_bgr):
        for channel in range(3):
            bits[int(low[channel]) : int(high[channel]) + 1, 0, channel] |= 1 << k

    def by_hsv() -> list[Any]:
        space = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        return [cv2.inRange(space, low, high) for low, high in in_hsv]

    def by_bgr() -> list[Any]:
        return [cv2.inRange(image, low, high) for low, high in in_bgr]

    def by_table() -> list[Any]:
        b, g, r = cv2.split(cv2.LUT(image, bits))
        return [cv2.bitwise_and(cv2.bitwise_and(b, g, b), r, b)]

    def components(mask: Any) -> object:
        return cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_16U)

    def contours(mask: Any) -> object:
        return [cv2.moments(found) for found in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]]

    ways = {"HSV boxes": by_hsv, "BGR boxes": by_bgr, "table per channel": by_table}
    ends = {"components": components, "contours": contours}
    return {
        f"OpenCV: {way}, {end}": (lambda masks=masks, find=find: [find(mask) for mask in masks()])  # type: ignore[misc]
        for way, masks in ways.items()
        for end, find in ends.items()
    }


def _box(pixels: Any) -> tuple[Any, Any]:
    return pixels.min(axis=0).astype(float), pixels.max(axis=0).astype(float)


def _in_turn(candidates: Mapping[str, Callable[[], object]], *, rounds: int) -> dict[str, list[float]]:
    """Processor seconds of each candidate, once a round, OpenCV on one thread."""
    cv2 = opencv("timing")
    threads = cv2.getNumThreads()
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    random, order = np.random.default_rng(0), list(candidates)
    try:
        cv2.setNumThreads(1)
        for run in candidates.values():
            run()
        for _ in range(rounds):
            random.shuffle(order)
            for name in order:
                times, start = 0, time.process_time_ns()
                while times == 0 or time.process_time_ns() - start < 5_000_000:  # short ones as often as 5 ms take
                    candidates[name]()
                    times += 1
                seconds[name].append((time.process_time_ns() - start) * 1e-9 / times)
    finally:
        cv2.setNumThreads(threads)
    return seconds


def _median_ratio(slow: Sequence[float], fast: Sequence[float]) -> float:
    return statistics.median(a / b for a, b in zip(slow, fast, strict=True))


def whole_step_marks(quick: bool) -> list[Mark]:
    """A whole step with ten robots, in frames per second."""
    marks = []
    for size, name, limit in ((VGA, "VGA", 500.0), (FULL_HD, "1080p", 120.0)):
        scene = preset("clean", size).but(noise=3.0)
        renderer = Renderer(scene)
        count = 15 if quick or size == FULL_HD else 60
        frames = [renderer[k][0] for k in range(count)]
        model = learned(scene)
        rates, stages = [], defaultdict(list)
        for _ in range(2 if quick else 5):
            tracker = MarkerTracker(model, view=scene.view, patterns=Patterns.of_scene(scene))
            tracker.step(frames[0])
            start = time.process_time_ns()
            for frame in frames[1:]:
                for stage, ms in tracker.step(frame).milliseconds.items():
                    stages[stage].append(ms)
            rates.append((count - 1) / ((time.process_time_ns() - start) * 1e-9))
        details = {"milliseconds": {stage: statistics.median(ms) for stage, ms in stages.items()}}
        what = f"with pattern and track, 10 robots and a ball, {name}"
        marks.append(Mark(what, "fps", statistics.median(rates), limit, at_least=True, details=details))
    return marks
