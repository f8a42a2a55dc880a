"""``pieper pick``: things out of their slots and into a bin, by contact physics, as often as wanted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli.show import console
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.sim.scene_view import Recording
    from pieper.tasks.pick import Cycle, PickAndPlace, Stage
    from pieper.tasks.see import SeeAndPick, SeeTask

_FILM_SIZE = "640x480"


def pick(
    arm: Annotated[str, typer.Option("--arm", metavar="ARM", help="kr210, ur10e, mh12 or youbot.")] = "kr210",
    see: Annotated[
        bool,
        typer.Option(
            "--see",
            help="Cans anywhere on a table, in random light, found by a camera that is calibrated first; kr210 or ur10e.",
        ),
    ] = False,
    cycles: Annotated[
        int, typer.Option("--cycles", metavar="N", help="How many things to pick, one after another.")
    ] = 9,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the places of the things in their slots.")] = 0,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Film it: an .mp4 or .gif file.")
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show it in MuJoCo's window, in real time.")] = False,
    log: Annotated[
        Path | None,
        typer.Option(
            "--log", metavar="FILE", help="Keep every cycle as a line of JSON, and go on where the file ends."
        ),
    ] = None,
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels of the film.")] = _FILM_SIZE,
    fps: Annotated[float, typer.Option("--fps", metavar="N", help="Frames per second of the film.")] = 25.0,
    speed: Annotated[float, typer.Option("--speed", metavar="X", help="Play the film X times as fast.")] = 1.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the count only, not the stages.")] = False,
) -> int:
    """Pick things out of slots and place them in a bin, with contact physics; 0 when all are placed, 1 when not."""
    from contextlib import ExitStack

    from pieper.sim import film
    from pieper.tasks.pick import PickAndPlace
    from pieper.tasks.pick_log import PickLog
    from pieper.tasks.pick_tasks import task

    if cycles < 1:
        raise ArrayError(f"--cycles must be 1 or more, got {cycles}")
    if seed < 0:
        raise ArrayError(f"--seed must be 0 or more, got {seed}")
    pixels = _size(size)
    if record is not None:
        film.check_format(record)
    sight = _by_sight(arm) if see else None
    wanted = task(arm) if sight is None else sight.pick
    kept = None if log is None else PickLog(log, wanted.name, seed)
    done: list[Cycle] = [] if kept is None else kept.done[:cycles]
    out = console()
    if done:
        out.print(
            f"{len(done)} cycles are in {log} already, {sum(c.placed for c in done)} of them placed", markup=False
        )
    if len(done) >= cycles:
        return _count(done)
    filmed: list[Recording] = []

    def told(stage: Stage) -> None:
        if filmed:
            filmed[0].caption = f"{wanted.name}  cycle {stage.cycle} of {cycles}: {_next_stage(stage)}"
        if not quiet:
            out.print(
                str(stage), style=None if stage.succeeded else "red", markup=False, highlight=False, soft_wrap=True
            )

    eyes = ExitStack()
    run = PickAndPlace(wanted, seed=seed, log=told) if sight is None else eyes.enter_context(_seeing(sight, seed, told))
    if record is not None:
        filmed.append(_recording(run, fps, speed))
    closing = _shown(run) if view else None
    first = len(done) + 1
    interrupted = False
    try:
        with _bar(quiet) as bar:
            job = bar.add_task("cycles", total=cycles, completed=len(done))
            for cycle in run.run(cycles - len(done), first=first):
                done.append(cycle)
                if kept is not None:
                    kept.add(cycle, [stage for stage in run.stages if stage.cycle == cycle.number])
                bar.update(job, completed=len(done))
    except KeyboardInterrupt:
        interrupted = True
        run.robot.stop()
    finally:
        eyes.close()
        if closing is not None:
            closing()
    if record is not None and filmed[0].moments:
        _film(filmed[0], record, pixels)
    code = _count(done, cycles)
    if interrupted:
        if log is not None:
            out.print(f"the same command goes on after cycle {len(done)}", markup=False)
        raise KeyboardInterrupt
    return code


def _by_sight(arm: str) -> SeeTask:
    from pieper.tasks.see import see_task

    return see_task(arm)


def _seeing(sight: SeeTask, seed: int, told: Callable[[Stage], None]) -> SeeAndPick:
    """A run by sight; says where its camera is."""
    from pieper.tasks.see import SeeAndPick, calibrate_cell

    found = calibrate_cell(sight, seed=seed)
    x, y, z = found.T_mount_camera[:3, 3]
    console().print(
        f"camera at ({x:.4f}, {y:.4f}, {z:.4f}) m +- {1e3 * max(found.position_deviation):.2f} mm, from {int(found.used.sum())} views of a board, "
        f"{found.pixel_rms:.2f} px RMS",
        markup=False, highlight=False, soft_wrap=True,
    )  # fmt: skip
    return SeeAndPick(sight, seed=seed, calibration=found, log=told)


def _recording(run: PickAndPlace, fps: float, speed: float) -> Recording:
    from pieper.sim.scene_view import Recording
    from pieper.tasks.see import SeeAndPick
    from pieper.tasks.see_film import SeeRecording

    if isinstance(run, SeeAndPick):
        return SeeRecording(run, fps=fps, speed=speed)
    return Recording(run.robot, fps=fps, speed=speed)


def _next_stage(stage: Stage) -> str:
    """What comes after a stage, for the caption."""
    from pieper.tasks.pick import STAGES

    if not stage.succeeded or stage.name not in STAGES:
        return f"{stage.name} {stage.outcome}"
    return STAGES[(STAGES.index(stage.name) + 1) % len(STAGES)]


def _count(done: list[Cycle], cycles: int | None = None) -> int:
    placed = sum(cycle.placed for cycle in done)
    total = len(done) if cycles is None else cycles
    words = f"{placed} of {total} placed"
    if placed:
        words += f", {sum(c.duration for c in done if c.placed) / placed:.2f} s of simulated time each"
    console().print(words, style="bold", markup=False, highlight=False)
    return 0 if placed == total else 1


def _size(text: str) -> tuple[int, int]:
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise ArrayError(f"--size must be width x height in pixels, such as 640x480, got {text!r}")
    return int(words[0]), int(words[1])


def _bar(quiet: bool) -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    screen = Console(stderr=True)
    columns = (TextColumn("cycles"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


def _film(recording: Recording, path: Path, size: tuple[int, int]) -> None:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    screen = Console(stderr=True)
    columns = (TextColumn("frames"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        job = bar.add_task("frames", total=len(recording.moments))
        count = recording.save(path, size=size, progress=lambda done, of: bar.update(job, completed=done, total=of))
    console().print(f"wrote {path}  {size[0]} x {size[1]} pixels, {count} frames", markup=False, soft_wrap=True)


def _shown(run: PickAndPlace) -> Any:
    """MuJoCo's own window, which follows the simulation in real time; returns what closes it."""
    from pieper.sim.window import open_window

    return open_window(run.robot)
