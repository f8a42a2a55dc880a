"""``pieper view``: an arm in the browser."""

from __future__ import annotations

import signal
import sys
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import ArmName, Base, Degrees, Nominal, Tip, load
from pieper.cli.screen import has_display
from pieper.cli.signals import handled
from pieper.cli.target import start_values
from pieper.errors import ArrayError, PieperError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.arm import Arm
    from pieper.spatial._checks import FloatArray
    from pieper.viewer.panel import Panel
    from pieper.viewer.paths import Track
    from pieper.viewer.server import Server
    from pieper.viewer.view import View

_THEMES = ("light", "dark")
_STEPS = 1000  # of an iteration at most
_CLOSE = 1e-3  # [m] where it ends


def view(
    arm: ArmName,
    q: Annotated[
        str | None,
        typer.Option(
            "--q", metavar="Q1,Q2,...", help="Joint values, zero by default [rad or m; with --deg, deg or m]."
        ),
    ] = None,
    degrees: Degrees = False,
    solve: Annotated[
        bool, typer.Option("--solve", help="Begin with the handle at the tip, and every solution as a ghost.")
    ] = False,
    compare: Annotated[
        str | None,
        typer.Option(
            "--compare",
            metavar="OTHER",
            help="A second model beside it, and how they differ; ROBOT:TABLE for DH rows on record.",
            autocompletion=completion.tables,
        ),
    ] = None,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option("--trajectory", metavar="FILE", help="A motion, .csv, .json or .npz; may be repeated."),
    ] = None,
    iterate: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--iterate", metavar="X Y Z", help="Play the steps of the Jacobian iteration to a position [m]."),
    ] = None,
    k1: Annotated[
        list[float] | None,
        typer.Option(
            "--k1", metavar="K", help="Iteration: gain of the position; 0.1 by default, may be repeated to compare."
        ),
    ] = None,
    hold_orientation: Annotated[
        bool, typer.Option("--hold-orientation", help="The iteration holds the orientation, and does not ignore it.")
    ] = False,
    workspace: Annotated[
        Path | None,
        typer.Option("--map", metavar="FOLDER", help="A map of `pieper workspace --out`, as coloured points."),
    ] = None,
    show: Annotated[
        str,
        typer.Option(
            "--show",
            metavar="QUANTITY",
            help="What the colours show: dexterity, manipulability, ...",
            autocompletion=completion.quantities,
        ),
    ] = "dexterity",
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="Write it for other programs; the scene as one .html that opens offline, and end.",
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", metavar="N", help="Port of the page; by default 8080, or a free one where it is taken."),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the browser; never where there is no display.")
    ] = True,
    theme: Annotated[
        str, typer.Option("--theme", metavar="THEME", help="light or dark.", autocompletion=completion.themes)
    ] = "light",
    frames: Annotated[bool, typer.Option("--frames", help="Draw every frame of the arm, with its name.")] = False,
    axes: Annotated[bool, typer.Option("--axes", help="Draw the joint axes, with their names.")] = False,
    meshes: Annotated[
        bool, typer.Option("--meshes/--no-meshes", help="Meshes of the description, or a shape made from the joints.")
    ] = True,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
) -> int:
    """Open an arm in the browser: jog it, drag its tip, compare it, play motions. On this machine alone; Ctrl-C ends it.

    For example:
      pieper view ur5e --solve
      pieper view mh12 --export mh12.html
    """
    if theme not in _THEMES:
        raise ArrayError(f"--theme must be light or dark, got {theme!r}")
    if export is not None and export.suffix.lower() not in (".html", ".htm"):
        raise ArrayError(f"--export writes a page, whose name ends in .html, got {str(export)!r}")
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    start = start_values(robot, q, degrees=degrees, option="--q")

    from pieper.sim.kinematic import KinematicSimulator
    from pieper.viewer.server import Server
    from pieper.viewer.solve_panel import SolvePanel
    from pieper.viewer.view import View

    simulated = KinematicSimulator(robot.chain, q=start)
    tracks = [
        *_files(robot, trajectory or []),
        *_iterations(robot, simulated.read().q, iterate, k1 or [0.1], hold=hold_orientation),
    ]
    panels: list[Panel] = [SolvePanel(shown=solve)] if robot.dof else []
    if compare is not None:
        panels.append(_comparison(arm, robot, compare))
    if tracks:
        panels.append(_motions(tracks))
    if workspace is not None:
        panels.append(_map(robot, workspace, show))
    server = Server(0 if export is not None else port, label=robot.name)
    look: dict[str, Any] = {
        "dark": theme == "dark",
        "frames": frames,
        "axes": axes,
        "meshes": None if meshes else False,
    }
    try:
        window = View(server, robot, simulated, panels=panels, **look)
    except BaseException:
        server.stop()
        raise
    with window:
        if export is not None:
            window.export(export)
            typer.echo(f"wrote {export}  {export.stat().st_size / 1e6:.1f} MB")
        else:
            _serve(robot, server, window, port, browser=browser)
    return 0


def _motions(tracks: list[Track]) -> Panel:
    """The motions, each in a colour of its own."""
    from pieper.viewer.paths import COLORS
    from pieper.viewer.paths_panel import PathsPanel

    return PathsPanel([replace(track, color=color) for track, color in zip(tracks, cycle(COLORS))])


def _serve(robot: Arm, server: Server, window: View, port: int | None, *, browser: bool) -> None:
    """Say where the page is, and keep it until it is left or ended."""
    from pieper.viewer.server import USUAL_PORT

    with _until_asked():
        window.start()
        if port is None and server.port != USUAL_PORT:
            typer.echo(f"port {USUAL_PORT} is taken: this is port {server.port}")
        typer.echo(f"{robot.name}  {server.url}\nCtrl-C ends it")
        sys.stdout.flush()
        if browser and has_display():
            import webbrowser

            webbrowser.open(server.url)
        window.wait()


def _comparison(name: str, robot: Arm, other: str) -> Panel:
    from pieper.viewer.compare_panel import ComparePanel

    return ComparePanel(load(other), names=(name, other if other != name else f"{other} (2)"))


def _map(robot: Arm, path: Path, show: str) -> Panel:
    from pieper.errors import MapError, unknown_name
    from pieper.viewer.map_panel import MapPanel
    from pieper.workspace.map import UNITS
    from pieper.workspace.store import open_store

    if show not in UNITS:
        raise unknown_name("quantity", show, UNITS, "a workspace map")
    found = open_store(path).map()
    if found.record["arm"] != robot.name or found.record["base"] != robot.base:
        raise MapError(
            f"{path} is a map of {found.record['arm']!r} from {found.record['base']!r}, and this is {robot.name!r} from {robot.base!r}"
        )
    return MapPanel(found, quantity=show)


def _files(robot: Arm, trajectories: list[Path]) -> list[Track]:
    """Motions out of files."""
    from pieper.motion import files
    from pieper.viewer.paths import Track

    tracks = []
    for path in trajectories:
        motion = files.read(path)
        try:
            tracks.append(Track.of(robot, motion, name=path.name))
        except PieperError as error:
            raise ArrayError(f"{path}: {error}") from error
    return tracks


def _iterations(
    robot: Arm, q: FloatArray, goal: tuple[float, float, float] | None, gains: list[float], *, hold: bool
) -> list[Track]:
    """The steps of an iteration, once for each gain."""
    if goal is None:
        return []
    from pieper.ik.iteration import iterate
    from pieper.viewer.paths import Track

    options: dict[str, Any] = {
        "orientation": "hold" if hold else "ignore",
        "iterations": _STEPS,
        "position_stop": _CLOSE,
    }
    return [
        Track.from_steps(robot, iterate(robot.chain, goal, q, k1=gain, **options), name=f"gain {gain:g}")
        for gain in gains
    ]


@contextmanager
def _until_asked() -> Iterator[None]:
    """Ctrl-C and SIGTERM are a wish to end, and not a failure."""

    def asked(*_: object) -> None:
        raise KeyboardInterrupt

    with handled((signal.SIGINT, signal.SIGTERM), asked), suppress(KeyboardInterrupt):
        yield
