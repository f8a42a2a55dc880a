"""What this room must reach, measured: scenes are drawn, tracked and compared with their truth, the report's method beside ours.

Everything is measured in one run on one machine. Times are processor times on one core, each round measures every candidate once, and
ratios are taken within the round; what is told is the median.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.perception.calibration_marks import calibration_marks
from pieper.perception.evaluate import VISIBLE, evaluate, tracked
from pieper.perception.frame import Frame
from pieper.perception.metrics import REACH, spread
from pieper.perception.pass_mark import Mark
from pieper.perception.pattern import Patterns
from pieper.perception.pattern_finder import PatternFinder
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.report import ReportTracker
from pieper.perception.scene_colors import learned, report_colors
from pieper.perception.scene_presets import preset
from pieper.perception.segment import segment
from pieper.perception.sighting import Sighting
from pieper.perception.speed_marks import speed_marks, whole_step_marks
from pieper.perception.synthetic import Renderer
from pieper.perception.track import Tracker, TrackerParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.perception.color import ColorModel
    from pieper.perception.evaluate import Evaluation
    from pieper.perception.output import TrackFile
    from pieper.perception.scene import Scene
    from pieper.perception.truth import TrueObject, Truth

__all__ = [
    "Followed",
    "Mark",
    "as_data",
    "follow",
    "hidden_for_half_a_second",
    "learned",
    "measure",
    "report_colors",
    "spoiled",
]

_NEAR = 5.0  # px, within which a circle of the report's is of a marker
_MISSES, _CLUTTER = 0.2, 0.05


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
        ("three colours to blobs", speed_marks),
        ("whole step with ten robots", whole_step_marks),
        ("marker centres", _centres),
        ("position and heading", _positions),
        ("light and colour cast", _light),
        ("full occlusion", _occlusion),
        ("ten robots crossing", _crossing),
        ("calibration", calibration_marks),
    ):
        begin(title)
        marks += rows(quick)
    begin("consistency")
    marks += _consistency(marks)
    return marks


def as_data(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    """Return the rows for JSON."""
    return [{**asdict(mark), "must": mark.must, "reached": mark.reached} for mark in marks]


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
