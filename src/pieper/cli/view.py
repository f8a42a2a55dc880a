"""``pieper view``: an arm in the browser."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pieper.cli.arguments import ArmName, Base, Degrees, Nominal, Tip, load
from pieper.cli.target import seed_values
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.arm import Arm
    from pieper.viewer.panel import Panel

_THEMES = ("light", "dark")


def view(
    arm: ArmName,
    q: Annotated[
        str | None, typer.Option("--q", metavar="Q1,Q2,...", help="Joint values at the beginning, separated by commas.")
    ] = None,
    degrees: Degrees = False,
    compare: Annotated[
        str | None, typer.Option("--compare", metavar="OTHER", help="A second model beside it, and how they differ.")
    ] = None,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option("--trajectory", metavar="FILE", help="A motion to play, .csv, .json or .npz; may be repeated."),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option("--export", metavar="FILE.html", help="Write the scene as one page that opens offline, and end."),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", metavar="N", help="This port or none; by itself 8080, or a free one where it is taken."),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the browser; never done where there is no display.")
    ] = True,
    theme: Annotated[str, typer.Option("--theme", metavar="THEME", help="light or dark.")] = "light",
    frames: Annotated[bool, typer.Option("--frames", help="Draw every frame of the arm, with its name.")] = False,
    axes: Annotated[bool, typer.Option("--axes", help="Draw the joint axes, with their names.")] = False,
    meshes: Annotated[
        bool, typer.Option("--meshes/--no-meshes", help="Meshes of the description, or a shape made from the joints.")
    ] = True,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
) -> int:
    """Open an arm in the browser: jog it, drag its tip, compare it, play motions. On this machine alone; Ctrl-C ends it."""
    if theme not in _THEMES:
        raise ArrayError(f"--theme must be light or dark, got {theme!r}")
    if export is not None and export.suffix.lower() not in (".html", ".htm"):
        raise ArrayError(f"--export writes a page, whose name ends in .html, got {str(export)!r}")
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    start = seed_values(robot, q, degrees=degrees, option="--q")

    from pieper.sim.kinematic import KinematicSimulator
    from pieper.viewer.server import USUAL_PORT, Server
    from pieper.viewer.view import View

    simulated = KinematicSimulator(robot.chain, q=start)
    panels = _panels(robot, compare, trajectory or [])
    server = Server(0 if export is not None else port, label=robot.name)
    try:
        window = View(
            server,
            robot,
            simulated,
            panels=panels,
            dark=theme == "dark",
            frames=frames,
            axes=axes,
            meshes=None if meshes else False,
        )
    except BaseException:
        server.stop()
        raise
    with window:
        if export is not None:
            window.export(export)
            typer.echo(f"wrote {export}  {export.stat().st_size / 1e6:.1f} MB")
            return 0
        with _until_asked():
            window.start()
            if port is None and server.port != USUAL_PORT:
                typer.echo(f"port {USUAL_PORT} is taken: this is port {server.port}")
            typer.echo(f"{robot.name}  {server.url}\nCtrl-C ends it")
            sys.stdout.flush()
            if browser and _has_display():
                import webbrowser

                webbrowser.open(server.url)
            window.wait()
    return 0


def _panels(robot: Arm, compare: str | None, trajectories: list[Path]) -> list[Panel]:
    """The tabs beside those that every window has."""
    from pieper.motion import files
    from pieper.viewer.compare_panel import ComparePanel
    from pieper.viewer.paths import COLORS, Track
    from pieper.viewer.paths_panel import PathsPanel
    from pieper.viewer.solve_panel import SolvePanel

    panels: list[Panel] = [SolvePanel()] if robot.dof else []
    if compare is not None:
        panels.append(ComparePanel(load(compare)))
    if trajectories:
        tracks = [
            Track.of(robot, files.read(path), name=path.name, color=COLORS[number % len(COLORS)])
            for number, path in enumerate(trajectories)
        ]
        panels.append(PathsPanel(tracks))
    return panels


def _has_display() -> bool:
    """Whether a window could be opened here."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextmanager
def _until_asked() -> Iterator[None]:
    """Ctrl-C and SIGTERM are a wish to end, and not a failure."""

    def asked(*_: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, asked) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        for number, old in before.items():
            signal.signal(number, old)
