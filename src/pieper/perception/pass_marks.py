"""What this room must reach, measured: scenes are drawn, tracked and compared with their truth, the report's method beside ours.

Everything is measured in one run on one machine. Times are processor times on one core, each round measures every candidate once, and
ratios are taken within the round; what is told is the median.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.perception.board import Board
from pieper.perception.board_views import find_views
from pieper.perception.calibration import calibrate_camera
from pieper.perception.color_learning import learn
from pieper.perception.evaluate import VISIBLE, evaluate, tracked
from pieper.perception.field import from_lines
from pieper.perception.field_lines import lines
from pieper.perception.frame import Frame
from pieper.perception.metrics import REACH, spread
from pieper.perception.opencv import opencv
from pieper.perception.pattern import Patterns
from pieper.perception.pattern_finder import PatternFinder
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.report import ReportColor, ReportTracker
from pieper.perception.scene_folder import color_regions
from pieper.perception.scene_presets import preset
from pieper.perception.segment import segment
from pieper.perception.sighting import Sighting
from pieper.perception.synthetic import Renderer
from pieper.perception.track import Tracker, TrackerParameters
from pieper.spatial import rotation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from pieper.perception.camera import Camera
    from pieper.perception.color import ColorModel
    from pieper.perception.color_table import ColorTable
    from pieper.perception.evaluate import Evaluation
    from pieper.perception.frame import Image
    from pieper.perception.output import TrackFile
    from pieper.perception.scene import Scene
    from pieper.perception.truth import TrueObject, Truth
    from pieper.spatial._checks import FloatArray

VGA, FULL_HD = (640, 480), (1920, 1080)
_NEAR = 5.0  # px, within which a circle of the report's is of a marker
_MISSES, _CLUTTER = 0.2, 0.05
_SIDES = 4  # rays through a pixel, each way
_SOFT = 1.0  # px; what a lens makes of an edge


@dataclass(frozen=True)
class Mark:
    """One row of the table.

    Attributes
    ----------
    what : str
        Is measured.
    unit : str
        Of the figures.
    ours : float
        Of this package.
    report : float or None
        Of the report's method in the same run; None where it has no such answer.
    limit : float
    at_least : bool
        Whether the figure must not be below the limit; otherwise it must not be above.
    details : mapping
        What else was measured.
    """

    what: str
    unit: str
    ours: float
    limit: float
    at_least: bool = False
    report: float | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def reached(self) -> bool:
        """Whether it is as it must be; what could not be measured is not."""
        return self.ours >= self.limit if self.at_least else self.ours <= self.limit

    @property
    def must(self) -> str:
        """The limit in words."""
        return f"{'>=' if self.at_least else '<='} {self.shown(self.limit)}"

    def shown(self, value: float | None) -> str:
        """Return a figure in words."""
        if value is None:
            return "-"
        return f"{value:.1%}" if self.unit == "share" else f"{value:.3g} {self.unit}".strip()


def measure(*, quick: bool = False, begin: Callable[[str], object] = lambda _: None) -> list[Mark]:
    """Measure every row.

    Parameters
    ----------
    quick : bool
        Shorter scenes and fewer rounds: for a look, not for quoting.
    begin : callable
        Is told what is measured next.
    """
    marks: list[Mark] = []
    for title, rows in (
        ("three colours to blobs", _speed),
        ("whole step with ten robots", _whole_step),
        ("marker centres", _centres),
        ("position and heading", _positions),
        ("light and colour cast", _light),
        ("full occlusion", _occlusion),
        ("ten robots crossing", _crossing),
        ("calibration", _calibration),
    ):
        begin(title)
        marks += rows(quick)
    begin("consistency")
    marks += _consistency(marks)
    return marks


def as_data(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    """Return the rows for JSON."""
    return [{**asdict(mark), "must": mark.must, "reached": mark.reached} for mark in marks]


# --------------------------------------------------------------------------------------------------------------------
# learning, as a person would: boxes on a few frames


def learned(scene: Scene) -> ColorModel:
    """Return the colour model of boxes on up to three frames of a scene, in the light of its first frame."""
    steady = Renderer(
        scene.but(light=(scene.effects.light[0],) * 2, cast=(scene.effects.cast[0],) * 2, noise=_grain(scene))
    )
    return learn(lambda k: steady[k][0].image, color_regions(scene)).model


def report_colors(scene: Scene) -> list[ReportColor]:
    """Return the report's Gaussians of the same boxes."""
    steady = Renderer(
        scene.but(light=(scene.effects.light[0],) * 2, cast=(scene.effects.cast[0],) * 2, noise=_grain(scene))
    )
    cuts: dict[str, list[Image]] = defaultdict(list)
    for region in color_regions(scene):
        cuts[region.color].append(region.cut(steady[region.frame][0].image))
    return [ReportColor.learn(name, regions, single=name != "green") for name, regions in cuts.items()]


def _grain(scene: Scene) -> float:
    """Noise while learning: paint of one value alone has no covariance, and the report's method would have nothing to invert."""
    return max(scene.effects.noise, 2.0)


# --------------------------------------------------------------------------------------------------------------------
# speed


def _speed(quick: bool) -> list[Mark]:
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


def _whole_step(quick: bool) -> list[Mark]:
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


# --------------------------------------------------------------------------------------------------------------------
# accuracy


def _centres(quick: bool) -> list[Mark]:
    """Discs of 11 to 12 px, red, blue and green, as they are blobs; no filter."""
    marks = []
    for noise, limit, words in ((0.0, 0.06, "clean"), (12.0, 0.09, "noise 12")):
        scene = preset("report").but(noise=noise, frames=20 if quick else 120)
        table, theirs = learned(scene).table(), ReportTracker(report_colors(scene))
        ours: list[Any] = []
        reports: list[Any] = []
        found, all_ = [0, 0], 0
        for frame, truth in Renderer(scene):
            blobs = segment(frame.image, table)
            patches = theirs.find(frame.image)
            for marker in truth.objects[0].markers:
                all_ += 1
                own = blobs.of(marker.color).centroid - marker.image
                other = np.array([[p.x, p.y] for p in patches if p.color == marker.color]).reshape(-1, 2) - marker.image
                for k, (errors, away) in enumerate(((ours, own), (reports, other))):
                    nearest = away[np.hypot(*away.T).argmin()] if len(away) else np.full(2, np.inf)
                    if np.hypot(*nearest) < _NEAR:
                        errors.append(nearest)
                        found[k] += 1
        mine, old = spread(np.array(ours).reshape(-1, 2)), spread(np.array(reports).reshape(-1, 2))
        details = {
            "pieper": asdict(mine),
            "report": asdict(old),
            "found": {"pieper": found[0] / all_, "report": found[1] / all_},
        }
        marks.append(Mark(f"marker centre, {words}", "px RMS", mine.rms, limit, report=old.rms, details=details))
    return marks


@dataclass(frozen=True, eq=False)
class Followed:
    """A scene that was tracked.

    Attributes
    ----------
    result : Evaluation
    truths : list of Truth
    tracks : TrackFile
    detected : float
        Share of the robots and balls in view that were sighted in their frame, by the right name, each frame by itself.
    """

    result: Evaluation
    truths: list[Truth]
    tracks: TrackFile
    detected: float


def follow(scene: Scene, *, adapt: bool = False, model: ColorModel | None = None) -> Followed:
    """Track a scene with what is learnt in its first light."""
    colors = model or learned(scene)
    tracker = MarkerTracker(
        colors, view=scene.view, patterns=Patterns.of_scene(scene), adaptation=_adaptation(colors) if adapt else None
    )
    steps, truths, stages = [], [], defaultdict(list)
    hits: list[bool] = []
    for frame, truth in Renderer(scene):
        step = tracker.step(frame)
        steps.append((step.index, step.time, step.estimates))
        truths.append(truth)
        hits += [_sighted(thing, step.sightings) for thing in truth.objects if thing.visible >= VISIBLE]
        for stage, ms in step.milliseconds.items():
            stages[stage].append(ms)
    tracks = tracked(steps, source=scene.name)
    mean = {stage: statistics.fmean(ms) for stage, ms in stages.items()}
    return Followed(evaluate(truths, tracks, milliseconds=mean), truths, tracks, float(np.mean(hits)))


def _sighted(thing: TrueObject, sightings: Sequence[Sighting]) -> bool:
    return any(
        s.kind == thing.kind
        and (s.name == thing.name or thing.kind == "ball")
        and np.hypot(*(s.position - thing.position)) <= REACH
        for s in sightings
    )


def _adaptation(colors: ColorModel) -> Any:
    from pieper.perception.adapt import LightAdaptation

    return LightAdaptation(colors)


def _positions(quick: bool) -> list[Mark]:
    marks = []
    for name, millimetres, degrees in (("clean", 0.5, 0.5), ("blur-light", 1.5, 1.5)):
        scene = preset(name).but(frames=30 if quick else 120)
        result = follow(scene, adapt=name != "clean").result
        details = {"scene": name, **result.as_data()}
        words = "clean" if name == "clean" else "blur and light ramp"
        marks += [
            Mark(
                f"robot position at 3 mm/px, {words}", "mm RMS", 1e3 * result.position.rms, millimetres, details=details
            ),
            Mark(f"robot heading, {words}", "deg RMS", float(np.degrees(result.heading.rms)), degrees),
        ]
    return marks


def _light(quick: bool) -> list[Mark]:
    """Light from 1 to 0.4 and a cast from 0 to 15 %, learnt in the light of the first frame."""
    scene = preset("light-ramp").but(frames=100 if quick else 300)
    ours, plain = follow(scene, adapt=True), follow(scene)
    old = preset("report").but(light=(1.0, 0.4), cast=(0.0, 0.15), frames=scene.frames // 3)
    theirs = ReportTracker(report_colors(old))
    found = []
    for frame, truth in Renderer(old):
        patches = theirs.find(frame.image)
        colors = {m.color for m in truth.objects[0].markers if _hit(patches, m.color, m.image)}
        found.append({"red", "blue"} <= colors)
    details = {"scene": scene.name, "without_adaptation": plain.detected, **ours.result.as_data()}
    what, report = "light 1 to 0.4, cast 15 %: detected", float(np.mean(found))
    return [Mark(what, "share", ours.detected, 0.99, at_least=True, report=report, details=details)]


def _hit(patches: Sequence[Any], color: str, image: Any) -> bool:
    return any(p.color == color and np.hypot(p.x - image[0], p.y - image[1]) < _NEAR for p in patches)


def _occlusion(quick: bool) -> list[Mark]:
    """Wholly hidden for half a second at constant velocity, and for good."""
    del quick
    scene = preset("occlusion")
    hidden = hidden_for_half_a_second(scene)
    report = _report_hidden()
    details = {**hidden, "report_largest_px": report}
    mm_per_px = 3.0
    largest, kept = 1e3 * hidden["largest"], float(hidden["kept"])
    return [
        Mark("full occlusion 0.5 s: largest error", "mm", largest, 15.0, report=report * mm_per_px, details=details),
        Mark("full occlusion 0.5 s: identity kept", "share", kept, 1.0, at_least=True),
        Mark("a track without data ends after", "s", _ends_after(scene), 1.0 + 1.5 / scene.fps, report=float("inf")),
    ]


def hidden_for_half_a_second(scene: Scene) -> dict[str, Any]:
    """Return how far off the first robot of a scene is predicted while nothing of it is seen, and whether it stays the same track."""
    ours = follow(scene)
    truths, frames = ours.truths, ours.tracks.frames
    hidden = [k for k, truth in enumerate(truths) if truth.objects[0].visible == 0]
    name = truths[0].objects[0].name
    mine = [[row for row in frame.rows if row.name == name and row.state != "lost"] for frame in frames]
    away = []
    for k in hidden:
        x, y = truths[k].objects[0].position
        away.append(min((float(np.hypot((r.x or 0) - x, (r.y or 0) - y)) for r in mine[k]), default=float("inf")))
    before, after = ([row.track for row in mine[k]] for k in (hidden[0] - 5, -1))
    return {
        "seconds": len(hidden) / scene.fps,
        "largest": max(away),
        "kept": len(before) == 1 and before == after,
        "track_before": before,
        "track_after": after,
        "seen_rms": ours.result.position.rms,
        "seen_heading_rms": ours.result.heading.rms,
    }


def _report_hidden() -> float:
    """How far off the report predicts its markers while its robot is hidden, at the worst [px]."""
    scene = preset("report-occlusion")
    theirs = ReportTracker(report_colors(scene))
    worst = 0.0
    for frame, truth in Renderer(scene):
        theirs.update(frame)
        if truth.objects[0].visible > 0:
            continue
        for patch in theirs.patches:
            for marker in truth.objects[0].markers:
                if patch.occluded and marker.color == patch.color:
                    worst = max(worst, float(np.hypot(patch.x - marker.image[0], patch.y - marker.image[1])))
    return worst


def _ends_after(scene: Scene) -> float:
    """Seconds from the last sighting to the end of the track, when a robot never comes back."""
    tracker = MarkerTracker(learned(scene), view=scene.view, patterns=Patterns.of_scene(scene))
    renderer = Renderer(scene)
    black = np.zeros_like(renderer[0][0].image)
    last = 0.0
    for k in range(150):
        frame = renderer[k][0] if k < 30 else Frame(black, k, k / scene.fps)
        if k < 30:
            last = frame.time
        step = tracker.step(frame)
        if k > 30 and all(e.state == "lost" for e in step.estimates):
            return frame.time - last
    return float("inf")


def _crossing(quick: bool) -> list[Mark]:
    """Ten robots; of what the patterns find in the pictures a fifth is lost and false robots are added, then it is tracked."""
    scene = preset("crossing").but(frames=420 if quick else 720)
    table, patterns = learned(scene).table(), Patterns.of_scene(scene)
    finder = PatternFinder(patterns, scene.view)
    tracker = Tracker(TrackerParameters.metres())
    random = np.random.default_rng(7)
    steps, truths = [], []
    for frame, truth in Renderer(scene):
        clean = finder.find(segment(frame.image, table, min_area=12))
        steps.append((frame.index, frame.time, tracker.step(frame.time, spoiled(clean, scene, random))))
        truths.append(truth)
    result = evaluate(truths, tracked(steps))
    what = "10 robots crossing, 20 % misses, 5 % clutter"
    details = {"scene": scene.name, "seconds": len(scene) / scene.fps, **result.as_data()}
    return [
        Mark(f"{what}: IDF1", "", result.identity.idf1, 0.99, at_least=True, details=details),
        Mark(f"{what}: HOTA", "", result.hota.hota, 0.95, at_least=True),
        Mark(f"{what}: identity switches", "", float(result.clear.switches), 0.0),
    ]


def spoiled(
    sightings: Sequence[Sighting],
    scene: Scene,
    random: np.random.Generator,
    *,
    misses: float = _MISSES,
    clutter: float = _CLUTTER,
) -> list[Sighting]:
    """Return sightings of which some are missed, among false ones of robots anywhere on the field under any name.

    >>> spoiled([], preset("clean"), np.random.default_rng(1), clutter=0.0)
    []
    """
    kept = [sighting for sighting in sightings if random.random() >= misses]
    half = np.array([scene.pitch.length, scene.pitch.width]) / 2
    for _ in range(random.binomial(len(scene.robots), clutter)):
        name = scene.robots[random.integers(len(scene.robots))].name
        place, heading = random.uniform(-half, half), float(random.uniform(-np.pi, np.pi))
        kept.append(Sighting("robot", name, place, heading, np.diag([1e-7, 1e-7, 1e-5]), (), 1.0))
    return kept


def _consistency(marks: Sequence[Mark]) -> list[Mark]:
    """NEES of places and headings in all scenes that were tracked before, each counted once."""
    shares: dict[str, tuple[float, float, int]] = {}
    for mark in marks:
        if "nees" in mark.details:
            nees, turn = mark.details["nees"], mark.details["heading_nees"]
            shares[mark.details["scene"]] = (nees["inside"], turn["inside"], nees["count"])
    details = {scene: {"places": a, "headings": b, "count": n} for scene, (a, b, n) in shares.items()}
    total = sum(n for _, _, n in shares.values())
    inside = sum(a * n for a, _, n in shares.values()) / total
    turned = sum(b * n for _, b, n in shares.values()) / total
    return [
        Mark("consistency: NEES of places inside the 95 % band", "share", inside, 0.9, at_least=True, details=details),
        Mark(
            "consistency: NEES of headings inside the 95 % band", "share", turned, 0.9, at_least=True, details=details
        ),
    ]


# --------------------------------------------------------------------------------------------------------------------
# calibration


def _calibration(quick: bool) -> list[Mark]:
    """A lens from pictures of a ChArUco board, and the field from its lines with that lens: both against the camera that made them."""
    true = preset("lens")
    lens = true.view.camera
    board = Board.parse("charuco:9x6:0.04:0.03")
    with tempfile.TemporaryDirectory() as folder:
        eye = BoardCamera(lens, board)
        for k, pose in enumerate(_poses(board, 8 if quick else 16)):
            _, data = opencv("writing a picture").imencode(".png", eye.picture(pose, seed=k))
            Path(folder, f"{k:02d}.png").write_bytes(data.tobytes())
        found = calibrate_camera(find_views([Path(folder)], board), board)
    still = true.but(things=(), noise=3.0)
    image = Renderer(still)[0][0].image
    field_found = from_lines(image, lines("vsss"), camera=found.camera)
    half = np.array([true.pitch.length, true.pitch.width]) / 2
    grid = np.stack(np.meshgrid(*(np.linspace(-h, h, 15) for h in half)), axis=-1).reshape(-1, 2)
    away = field_found.view.to_field(true.view.to_image(grid)) - grid
    if np.hypot(*away.T).mean() > half.min():  # the lines look the same turned round
        away = -field_found.view.to_field(true.view.to_image(grid)) - grid
    error = spread(away)
    pixels = np.stack(np.meshgrid(np.linspace(0, 639, 17), np.linspace(0, 479, 13)), axis=-1).reshape(-1, 2)
    rays, found_rays = lens.directions(pixels)[:, :2], found.camera.directions(pixels)[:, :2]
    lens_error = spread((found_rays - rays) * lens.matrix[0, 0])
    details = {
        "views": len(found.views),
        "pixels_against_the_true_lens": asdict(lens_error),
        "field_mm": 1e3 * error.largest,
    }
    return [
        Mark("calibration of the lens, synthetic boards", "px RMS", found.rms, 0.1, details=details),
        Mark(
            "calibration of the field, by its lines", "mm RMS", 1e3 * error.rms, 2.0, details={"largest": error.largest}
        ),
    ]


def _poses(board: Board, count: int) -> Iterator[FloatArray]:
    """Poses of a board before the camera, near and far, to all sides, tilted by up to half a right angle."""
    middle = np.array([*(np.array(board.squares) * board.square / 2), 0.0])
    random = np.random.default_rng(11)
    for k in range(count):
        T = np.eye(4)
        tilt = random.uniform(0.15, 0.7) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        T[:3, :3] = rotation.from_rotation_vector(tilt)
        distance = random.uniform(0.45, 0.8)
        aside = np.array([np.cos(2.4 * k + 1), 0.7 * np.sin(2.4 * k + 1)]) * distance * 0.22
        T[:3, 3] = np.array([*aside, distance]) - T[:3, :3] @ middle
        yield T


class BoardCamera:
    """Takes pictures of a printed board through a lens: each pixel is the mean of sixteen rays, softened by the lens by a pixel.

    Parameters
    ----------
    camera : Camera
    board : Board
    """

    def __init__(self, camera: Camera, board: Board) -> None:
        width, height = camera.size
        self._rays = camera.directions(
            np.stack(np.meshgrid(np.arange(width + 1), np.arange(height + 1)), axis=-1) - 0.5
        )
        self._board = board

    def picture(self, T_camera_board: FloatArray, *, noise: float = 2.0, seed: int = 0) -> Image:
        """Return what the camera sees of the board at a pose."""
        T = np.linalg.inv(T_camera_board)
        along = self._rays @ T[:3, :3].T  # through the corners of the pixels
        four = along[:-1, :-1], along[:-1, 1:], along[1:, :-1], along[1:, 1:]
        white = np.zeros(along.shape[:2])[1:, 1:]
        for i in range(_SIDES):
            for j in range(_SIDES):  # no two in one row or column, so that no edge meets four at once
                s, t = (i + (j + 0.5) / _SIDES) / _SIDES, (j + (i + 0.5) / _SIDES) / _SIDES
                ray = (1 - s) * (1 - t) * four[0] + s * (1 - t) * four[1] + (1 - s) * t * four[2] + s * t * four[3]
                white += self._board.is_white(T[:2, 3] - ray[..., :2] * (T[2, 3] / ray[..., 2])[..., None])
        gray = opencv("drawing a board").GaussianBlur(30 + 190 * white / _SIDES**2, (0, 0), _SOFT)
        gray += np.random.default_rng(seed).normal(0, noise, gray.shape)
        image: Image = np.repeat(np.clip(np.rint(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        return image
