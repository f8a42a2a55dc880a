"""``pieper ros tracker``: what ``pieper track`` finds, on the robot's network."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.node import Backend, Domain, Network, joined, ros_arguments
from pieper.errors import PieperError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.perception.pipeline import MarkerTracker
    from pieper.perception.source import Source
    from pieper.ros.bus import Bus
    from pieper.ros.nodes.tracker import Tracker

_PATIENCE = 0.05  # seconds between looks at whether the node was ended, while a recording keeps its pace


def tracker(
    context: typer.Context,
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
    speed: Annotated[
        float, typer.Option("--speed", metavar="X", help="Play it X times as fast; 0 as fast as it can be read.")
    ] = 1.0,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> None:
    r"""Robots and balls that a camera sees.

    For example:
      pieper ros tracker clean/video.mp4 --colors colors.yaml \
          --field clean/field.yaml --patterns clean/patterns.yaml
    """
    from pieper.perception.color import ColorModel
    from pieper.perception.pipeline import MarkerTracker
    from pieper.perception.source import open_source
    from pieper.ros.nodes.tracker import Tracker

    if not 0 <= speed < float("inf"):
        raise PieperError(f"--speed must be a number of at least 0, got {speed}")
    follower = MarkerTracker(ColorModel.load(colors), view=_view(field), patterns=patterns, ball=ball)
    joining: dict[str, Any] = {"backend": backend, "network": network, "domain": domain}
    with (
        open_source(source) as frames,
        joined("tracker", arguments=ros_arguments(context), **joining) as bus,
    ):
        node = Tracker(bus, unit=follower.view.unit)
        worker = _Worker(bus, node, follower, frames, speed)
        worker.start()
        try:
            bus.spin()
        finally:
            worker.end()
        worker.complain()


def _view(field: Path | None) -> Any:
    if field is None:
        return None
    from pieper.perception.calibration_file import load_view

    return load_view(field)


class _Worker(threading.Thread):
    """Tracks in a thread of its own, so that the network is served meanwhile."""

    def __init__(self, bus: Bus, node: Tracker, follower: MarkerTracker, frames: Source, speed: float) -> None:
        super().__init__(name="tracker", daemon=True)
        self._bus, self._node, self._follower, self._frames = bus, node, follower, frames
        self._speed = 0.0 if frames.info.live else speed
        self._ended = threading.Event()
        self._error: BaseException | None = None

    def run(self) -> None:
        """Track until the frames or the patience of the user end."""
        try:
            for frame in self._paced():
                step = self._follower.step(frame)
                self._node.put(step.time, step.estimates)
            while self._node.waiting and not self._ended.wait(_PATIENCE):
                pass
        except Exception as error:  # noqa: BLE001  raised again in the thread that spins
            self._error = error
        finally:
            self._bus.stop()

    def _paced(self) -> Iterator[Any]:
        """The frames, those of a recording no faster than they were taken."""
        start: tuple[float, float] | None = None
        for frame in self._frames:
            if self._speed > 0.0:
                now = time.monotonic()
                start = start or (now, frame.time)
                due = start[0] + (frame.time - start[1]) / self._speed
                self._ended.wait(max(due - now, 0.0))
            if self._ended.is_set():
                return
            yield frame

    def end(self) -> None:
        """Stop after the frame at hand."""
        self._ended.set()
        self._frames.stop()
        self.join()

    def complain(self) -> None:
        """Raise what went wrong in the thread."""
        if self._error is not None:
            raise self._error
