"""``pieper track``: markers and robots in a video, a folder of images, a camera, a stream or a pipe."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.outputs import keep_apart
from pieper.cli.pixels import pixels
from pieper.cli.progress import progress_bar
from pieper.cli.show import console
from pieper.cli.signals import stopped_once
from pieper.errors import VisionError, unknown_name

if TYPE_CHECKING:
    from pieper.perception.field_view import View
    from pieper.perception.follow import Follows, Found, Resumed, Summary
    from pieper.perception.frame import Frame
    from pieper.perception.output import TrackWriter
    from pieper.perception.source import Source
    from pieper.perception.video_file import VideoFile

METHODS = ("pieper", "report")
_INTERRUPTED = 130
_AROUND = 0.15  # m; goals, and what a lens and the height of a robot move


def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="VIDEO",
            help="A video, a folder of images, a camera (0, /dev/video0), rtsp://... or http://..., or - for standard input.",
        ),
    ],
    colors: Annotated[Path, typer.Option("--colors", metavar="FILE", help="Colours, from learn-colour.")],
    field: Annotated[
        Path | None,
        typer.Option("--field", metavar="FILE", help="The field, from calibrate-field; metres instead of pixels."),
    ] = None,
    patterns: Annotated[
        str | None,
        typer.Option(
            "--patterns",
            metavar="NAME",
            help="Markers of the robots: report, ssl, vsss, circles, or a YAML file.",
            autocompletion=completion.patterns,
        ),
    ] = None,
    ball: Annotated[
        str | None, typer.Option("--ball", metavar="NAME", help="Colour of the ball.", autocompletion=completion.colors)
    ] = None,
    largest: Annotated[
        list[str] | None,
        typer.Option(
            "--largest",
            metavar="NAME",
            help="Without patterns: follow only the largest patch of this colour.",
            autocompletion=completion.colors,
        ),
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(
            "--within",
            metavar="X0,Y0,X1,Y1",
            help="Look only there, in pixels, or metres with --field; by default on the field that the file tells, and 0.15 m around it.",
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="METHOD",
            help="pieper, or report: the pipeline of the report, as it is printed.",
            autocompletion=completion.methods,
        ),
    ] = "pieper",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Write the result; the tracks as .csv, .jsonl or .parquet."),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FILE", help="Film it; with everything found drawn in, .mp4 or .avi."),
    ] = None,
    start: Annotated[int, typer.Option("--start", metavar="N", help="First frame, from 0.")] = 0,
    stop: Annotated[int | None, typer.Option("--stop", metavar="N", help="Frame before which to end.")] = None,
    adapt: Annotated[bool, typer.Option("--adapt/--no-adapt", help="Let the colours follow the light slowly.")] = True,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what --out holds.")] = False,
    warm_up: Annotated[
        float,
        typer.Option(
            "--warm-up", metavar="SECONDS", help="With --resume: seconds before its end that are tracked again."
        ),
    ] = 2.0,
    size: Annotated[
        str | None,
        typer.Option("--size", metavar="WxH", help="Pixels, width and height; of raw BGR frames on standard input."),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option("--fps", metavar="N", help="Frames a second; of images, raw frames, or to ask a camera for."),
    ] = None,
    patience: Annotated[
        float,
        typer.Option("--patience", metavar="SECONDS", help="How long a camera may be away before it is given up."),
    ] = 60.0,
    trail: Annotated[
        int, typer.Option("--trail", metavar="N", min=0, help="Frames of the trails that are drawn.")
    ] = 60,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print every detection with its radius.")] = False,
) -> int:
    r"""Follow coloured markers, or robots that carry them; in pixels, or in metres with --field.

    For example:
      pieper track clean/video.mp4 --colors colors.yaml \
          --field clean/field.yaml --patterns clean/patterns.yaml --out tracks.csv
    """
    from pieper.perception.follow import Summary, follow
    from pieper.perception.opencv import quiet
    from pieper.perception.output import create_tracks
    from pieper.perception.overlay import Overlay
    from pieper.perception.source import open_source

    quiet()
    if method not in METHODS:
        raise unknown_name("method", method, METHODS)
    keep_apart([source, colors, field, patterns], {"--out": out, "--record": record})
    _check_files(out, record, resume, warm_up)
    frame_size = None if size is None else pixels(size)
    if frame_size is not None and source != "-":
        raise VisionError(
            f"--size is for raw frames on standard input, named -; {source} tells its own size, so leave it out"
        )
    model, tracker, view, heights = _tracker(
        colors, field, patterns, ball, largest or [], within, method=method, adapt=adapt, tracked=source
    )
    summary, stopped = Summary(), False
    with ExitStack() as stack:
        name = source if source == "-" or "://" in source else Path(source).name
        table, resumed = _continued(stack, out if resume else None, view.unit, source, name, warm_up, start)
        frames = stack.enter_context(
            open_source(
                source,
                start=start if resumed is None else resumed.start,
                stop=stop,
                size=frame_size,
                fps=fps,
                patience=patience,
            )
        )
        if out is not None and table is None:
            table = create_tracks(out, unit=view.unit, source=name)
            stack.callback(table.close)
        film = _film(stack, record, frames, resumed)
        overlay = Overlay(view, colors=dict(zip(model.names, model.draw, strict=True)), height=heights, trail=trail)
        try:
            first = start if resumed is None else resumed.last + 1
            left = _left(frames, first, stop)
            with stopped_once(frames.stop) as signals, progress_bar("frames", left) as advance:

                def on_step(frame: Frame, step: Found) -> None:
                    if verbose:
                        _print_detections(step)
                    advance(frame.index + 1 - first, words=_beside(summary))

                follow(
                    frames, tracker, tracks=table, video=film, overlay=overlay if film else None, on_step=on_step,
                    resumed=resumed, summary=summary,
                )  # fmt: skip
                stopped = bool(signals)
        finally:
            stack.close()
            _print_summary(summary, out, film.path if film is not None and film.frames else None, view.unit, tracker)
    if stopped:
        if out is not None:
            typer.secho("pieper: --resume goes on from here", err=True)
        return _INTERRUPTED
    return 0


def _check_files(out: Path | None, video: Path | None, resume: bool, warm_up: float) -> None:
    from pieper.perception.output import table_path
    from pieper.perception.video_file import video_path

    if resume and out is None:
        raise VisionError("--resume goes on with a table; name it by --out")
    if not warm_up >= 0:
        raise VisionError(f"--warm-up must be 0 seconds or more, got {warm_up:g}")
    for path, check in ((out, table_path), (video, video_path)):
        if path is not None:
            check(path)


def _tracker(
    colors: Path, field: Path | None, patterns: str | None, ball: str | None, largest: list[str], within: str | None, *,
    method: str, adapt: bool, tracked: str,
) -> tuple[Any, Follows, View, dict[str, float]]:  # fmt: skip
    """The colour model, the tracker, the view, and the heights of what is drawn."""
    from pieper.perception.adapt import LightAdaptation
    from pieper.perception.color import ColorModel
    from pieper.perception.field_view import PixelView
    from pieper.perception.pipeline import MarkerTracker

    model = ColorModel.load(colors)
    view: View = PixelView()
    place: tuple[float, float, float, float] | None = None
    if method == "report":
        if field is not None or patterns is not None or ball is not None or largest:
            raise VisionError(
                "the report's method knows no field and no patterns; leave out --field, --patterns, --ball, --largest"
            )
        return model, _report(model, colors, tracked), view, {}
    if field is not None:
        from pieper.perception.calibration_file import load_field_size, load_view

        view = load_view(field)
        size = load_field_size(field)
        if size is not None:
            x, y = size[0] / 2 + _AROUND, size[1] / 2 + _AROUND
            place = (-x, -y, x, y)
    if within is not None:
        place = _rectangle(within)
    for name in largest:
        if name not in model.names:
            raise unknown_name("colour", name, model.names, str(colors))
    adaptation = LightAdaptation(model) if adapt else None
    tracker = MarkerTracker(
        model,
        view=view,
        patterns=patterns,
        ball=ball,
        markers={name: "largest" if name in largest else "all" for name in model.names},
        adaptation=adaptation,
        within=place,
    )
    heights = {}
    if tracker.patterns.robots:
        markers = tracker.patterns.robots[0].markers
        heights["robot"] = sum(marker.height for marker in markers) / len(markers)
    if tracker.patterns.ball is not None:
        heights["ball"] = tracker.patterns.ball.radius
    return model, tracker, view, heights


def _report(model: Any, colors: Path, tracked: str) -> Follows:
    from pieper.perception.report import ReportTracker
    from pieper.perception.report_pipeline import ReportPipeline, learned_from, report_colors
    from pieper.perception.source import read_frame

    video = learned_from(model.notes, colors, tracked)
    learned = report_colors(model.notes, lambda n: read_frame(video, n).image)
    for color in learned:
        console().print(f"{color.name}\n{color.as_printed()}", markup=False, soft_wrap=True)
    return ReportPipeline(ReportTracker(learned))


def _continued(
    stack: ExitStack, out: Path | None, unit: str, source: str, name: str, warm_up: float, start: int
) -> tuple[TrackWriter | None, Resumed | None]:
    """The table that is gone on with, if there is one."""
    from pieper.perception.follow import Resumed
    from pieper.perception.output import continue_tracks

    if out is None:
        return None, None
    if not Path(source).exists():
        raise VisionError(f"only a video file or a folder of images can be resumed, got {source!r}")
    if not out.exists():
        return None, None
    table, kept = continue_tracks(out, unit=unit, source=name)
    stack.callback(table.close)
    return table, Resumed(kept, warm_up=warm_up, first=start)


def _film(stack: ExitStack, video: Path | None, frames: Source, resumed: Resumed | None) -> VideoFile | None:
    """The annotated video; one that goes on has the number of its first frame in its name, beside the one before."""
    from pieper.perception.reader import FPS
    from pieper.perception.video_file import VideoFile

    if video is None:
        return None
    if resumed is not None and video.exists():
        video = video.with_name(f"{video.stem}.from{resumed.last + 1:06d}{video.suffix}")
    film = VideoFile(video, fps=frames.info.fps or FPS)
    stack.callback(film.close)
    return film


def _left(frames: Source, first: int, stop: int | None) -> int | None:
    """How many frames there are from the first on; None where nobody knows."""
    ends = [n for n in (stop, frames.info.frames) if n is not None]
    return max(min(ends) - first, 0) if ends else None


def _beside(summary: Summary) -> str:
    """What is said beside the bar."""
    lost = f", {summary.dropped} dropped" if summary.dropped else ""
    return f"{summary.fps:.0f} fps{lost}"


def _print_detections(step: Found) -> None:
    rows = sorted({row for sighting in step.sightings for row in sighting.blobs})
    for row in rows:
        x, y = step.blobs.centroid[row]
        name, radius = step.blobs.names[int(step.blobs.color[row])], float(step.blobs.radius[row])
        sys.stdout.write(f"frame {step.index}  {name}  radius {radius:.2f} px  at {x:.2f}, {y:.2f}\n")
    sys.stdout.flush()  # somebody may read along in a pipe


def _print_summary(summary: Summary, out: Path | None, video: Path | None, unit: str, tracker: Follows) -> None:
    if not summary.frames:
        return
    say = console().print
    tracks = "1 track" if len(summary.tracks) == 1 else f"{len(summary.tracks)} tracks"
    frames = "1 frame" if summary.frames == 1 else f"{summary.frames} frames"
    line = f"{frames} in {summary.seconds:.2f} s, {summary.fps:.0f} fps; {summary.dropped} dropped; {tracks}"
    say(line, markup=False, soft_wrap=True)
    stages = ", ".join(f"{stage} {spent:.2f}" for stage, spent in summary.milliseconds.items())
    say(f"ms a frame: {stages}", markup=False, soft_wrap=True)
    told = getattr(getattr(tracker, "adaptation", None), "summary", None)
    if callable(told):
        say(told(), markup=False, soft_wrap=True)
    if out is not None:
        say(f"wrote {out}  in {'metres' if unit == 'm' else 'pixels'}", markup=False, soft_wrap=True)
    if video is not None:
        say(f"wrote {video}", markup=False, soft_wrap=True)


def _rectangle(text: str) -> tuple[float, float, float, float]:
    try:
        x0, y0, x1, y1 = (float(word) for word in text.split(","))
    except ValueError:
        x0, y0, x1, y1 = 0.0, 0.0, 0.0, 0.0
    if not (x0 < x1 and y0 < y1):
        raise VisionError(f"--within must be X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1, got {text!r}")
    return x0, y0, x1, y1
