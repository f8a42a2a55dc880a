"""``pieper pick``: things out of their slots and into a bin, by contact physics, as often as wanted."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.outputs import keep_apart
from pieper.cli.pixels import pixels
from pieper.cli.progress import progress_bar
from pieper.cli.screen import has_display
from pieper.cli.show import console, say
from pieper.cli.signals import handled
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.sim.scene_view import Recording
    from pieper.tasks.pick import Cycle, PickAndPlace, PickTask, Stage
    from pieper.tasks.pick_log import PickLog
    from pieper.tasks.pick_view import PickView
    from pieper.tasks.see import SeeAndPick, SeeTask

_FILM_SIZE = "640x480"
_PATIENCE = 20.0  # [s] for somebody to open the page


def pick(
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            metavar="ARM",
            help="A built-in robot: kr210, ur10e, mh12 or youbot.",
            autocompletion=completion.pick_arms,
        ),
    ] = None,
    see: Annotated[
        bool,
        typer.Option(
            "--see",
            help="Cans anywhere on a table, in random light, found by a camera that is calibrated first; kr210 or ur10e.",
        ),
    ] = False,
    task_file: Annotated[
        Path | None, typer.Option("--task", metavar="FILE", help="Another task, instead of --arm.")
    ] = None,
    write_task: Annotated[
        Path | None,
        typer.Option("--write-task", metavar="FILE", help="Write the task of --arm to change, and end."),
    ] = None,
    cycles: Annotated[
        int, typer.Option("--cycles", metavar="N", help="How many things to pick, one after another.")
    ] = 9,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", metavar="N", help="Of random numbers, the same again for the same; for the places of the things."
        ),
    ] = 0,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Film it; into an .mp4 or .gif.")
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show it in the browser, in real time.")] = False,
    window: Annotated[
        bool, typer.Option("--window", help="Show it in MuJoCo's own window, which needs a screen.")
    ] = False,
    planner: Annotated[
        str | None,
        typer.Option(
            "--planner",
            metavar="NAME",
            help="rrt searches for ways, direct tries straight ones; rrt where it is installed.",
            autocompletion=completion.planners,
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            "--log", metavar="FILE", help="Keep every cycle as a line of JSON, and go on where the file ends."
        ),
    ] = None,
    size: Annotated[
        str, typer.Option("--size", metavar="WxH", help="Pixels, width and height; of the film.")
    ] = _FILM_SIZE,
    fps: Annotated[float, typer.Option("--fps", metavar="N", help="Frames a second; of the film.")] = 25.0,
    speed: Annotated[float, typer.Option("--speed", metavar="X", help="Play it X times as fast; the film.")] = 1.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the count only, not the stages.")] = False,
) -> int:
    """Pick things out of slots and place them in a bin, with contact physics; 0 when all are placed, 1 when not.

    For example:
      pieper pick --arm kr210 --cycles 1
    """
    from pieper.sim import film
    from pieper.tasks.pick import PickAndPlace, chosen_planner

    _check(cycles, seed)
    frame = pixels(size)
    keep_apart([task_file], {"--record": record, "--log": log, "--write-task": write_task})
    if write_task is not None:
        return _write_task(arm or "kr210", task_file, write_task)
    if record is not None:
        film.check_ready(record, fps)
    way = chosen_planner(planner)
    sight = _by_sight(arm, task_file, planner) if see else None
    wanted = _task(arm, task_file) if sight is None else sight.pick
    kept, done = _begun(log, wanted.name, seed, _version(arm, task_file, see, way), cycles)
    if len(done) >= cycles:
        if record is not None:
            say(f"nothing is left to do, and nothing to film: {record} is not written")
        return _count(done)
    tell = _Teller(wanted.name, cycles, quiet)
    run = PickAndPlace(wanted, seed=seed, planner=planner, log=tell) if sight is None else _seeing(sight, seed, tell)
    if not quiet and planner is None and run.planner == "direct":
        say("ways are straight ones; to search for them: pip install 'pieper[plan]'")
    if record is not None:
        tell.film = _recording(run, fps, speed, frame)
    ending = _Ending(run)
    with ExitStack() as undo, handled((signal.SIGINT, signal.SIGTERM), ending):
        if isinstance(run, AbstractContextManager):
            undo.enter_context(run)
        if window:
            undo.callback(_shown(run))
        if view:
            tell.page = _opened(run, undo)
        _work(run, done, kept, cycles)
        if tell.page is not None:
            _leave_open(run, tell.page, done, cycles)
    if record is not None and tell.film is not None and tell.film.moments:
        if ending.at_once:
            say(f"asked to end: {record} is not written")
        else:
            _film(tell.film, record, frame)
    code = _count(done, cycles)
    if run.cancelled and len(done) < cycles:
        if log is not None:
            say(f"the same command goes on after cycle {len(done)}")
        raise KeyboardInterrupt
    return code


@dataclass
class _Teller:
    """Says what happens: on the screen, under the film, and on the page."""

    task: str
    cycles: int
    quiet: bool
    film: Recording | None = None
    page: PickView | None = None

    def __call__(self, stage: Stage) -> None:
        if self.film is not None:
            self.film.caption = f"{self.task}  cycle {stage.cycle} of {self.cycles}: {_next_stage(stage)}"
        if self.page is not None:
            failed = f"  FAILED  {stage.reason}" if stage.reason else ""
            self.page.say(f"{stage.cycle}  {stage.target}: {stage.name}{failed}")
        if not self.quiet:
            say(str(stage), None if stage.succeeded else "red")


class _Ending:
    """Ends the run at the first signal, with the arm at rest, and the command at the second."""

    def __init__(self, run: PickAndPlace) -> None:
        self._run = run
        self.at_once = False
        """Whether something asks for the end that does not wait for a film to be drawn: SIGTERM, and not Ctrl-C."""

    def __call__(self, number: int, _: object) -> None:
        if self._run.cancelled:
            raise KeyboardInterrupt
        self.at_once = number == signal.SIGTERM
        self._run.cancel()


def _check(cycles: int, seed: int) -> None:
    if cycles < 1:
        raise ArrayError(f"--cycles must be 1 or more, got {cycles}")
    if seed < 0:
        raise ArrayError(f"--seed must be 0 or more, got {seed}")


def _begun(log: Path | None, task: str, seed: int, version: str, cycles: int) -> tuple[PickLog | None, list[Cycle]]:
    """The log that is kept, and the cycles that are in it already."""
    from pieper.tasks.pick_log import PickLog

    if log is None:
        return None, []
    kept = PickLog(log, task, seed, version=version)
    done: list[Cycle] = kept.done[:cycles]
    if done:
        say(f"{len(done)} cycles are in {log} already, {sum(c.placed for c in done)} of them placed")
    return kept, done


def _work(run: PickAndPlace, done: list[Cycle], kept: PickLog | None, cycles: int) -> None:
    """The cycles that are left, each kept when it is over."""
    with progress_bar("cycles", cycles) as advance:
        advance(len(done))
        for cycle in run.run(cycles - len(done), first=len(done) + 1):
            if run.cancelled and not cycle.placed:
                break
            done.append(cycle)
            if kept is not None:
                kept.add(cycle, [stage for stage in run.stages if stage.cycle == cycle.number])
            advance(len(done))


def _task(arm: str | None, file: Path | None) -> PickTask:
    from pieper.tasks.pick_file import read_pick_task
    from pieper.tasks.pick_tasks import task

    if file is None:
        return task(arm or "kr210")
    if arm is not None:
        raise ArrayError("--arm and --task both say what to do; give one of them (the file names its arm)")
    return read_pick_task(file)


def _by_sight(arm: str | None, file: Path | None, planner: str | None) -> SeeTask:
    from pieper.tasks.see import see_task

    if file is not None or planner is not None:
        raise ArrayError("--see has tasks and ways of its own; leave --task and --planner out")
    return see_task(arm or "kr210")


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


def _version(arm: str | None, file: Path | None, see: bool, planner: str) -> str:
    """What the cycles of a log depend on besides the seed."""
    from pieper.tasks.pick_tasks import task_file

    if see:
        return "see"
    text = task_file(arm or "kr210") if file is None else file.read_bytes()
    return f"{planner} {text.decode(errors='replace')}"


def _recording(run: PickAndPlace, fps: float, speed: float, size: tuple[int, int]) -> Recording:
    """What keeps the film; that it can be drawn is seen now, and not when all is over."""
    from pieper.sim.scene_view import Recording, SceneView
    from pieper.tasks.see import SeeAndPick
    from pieper.tasks.see_film import SeeRecording

    if isinstance(run, SeeAndPick):
        kept: Recording = SeeRecording(run, fps=fps, speed=speed)
    else:
        kept = Recording(run.robot, fps=fps, speed=speed)
    with SceneView(run.robot, size=size):
        pass
    return kept


def _write_task(arm: str, file: Path | None, path: Path) -> int:
    from pieper.atomic_file import write_bytes
    from pieper.tasks.pick_tasks import task_file

    if file is not None:
        raise ArrayError("--write-task writes the task of --arm; of --task there is a file already")
    write_bytes(path, task_file(arm))
    console().print(f"wrote {path}; change it, and: pieper pick --task {path}", markup=False, soft_wrap=True)
    return 0


def _opened(run: PickAndPlace, undo: ExitStack) -> PickView:
    """The page, once somebody looks at it, or has not for a while."""
    from pieper.tasks.pick_view import PickView

    page = undo.enter_context(PickView(run))
    console().print(
        f"{page.url}\nopen this page; the arm begins then, or in {_PATIENCE:.0f} s. Ctrl-C ends it.",
        markup=False,
        soft_wrap=True,
    )
    sys.stdout.flush()
    if has_display():
        import webbrowser

        webbrowser.open(page.url)
    if not page.wait_for_page(longest=_PATIENCE) and not run.cancelled:
        console().print("nobody has opened the page yet; beginning without", markup=False)
    return page


def _leave_open(run: PickAndPlace, page: PickView, done: list[Cycle], cycles: int) -> None:
    """The page stays until it is left, or until Ctrl-C."""
    page.say(f"{sum(cycle.placed for cycle in done)} of {cycles} placed; close this page to end")
    if page.is_watched and not run.cancelled:
        console().print("done; close the page, or Ctrl-C, to end", markup=False)
    while page.is_watched and not run.cancelled:
        time.sleep(0.2)


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


def _film(recording: Recording, path: Path, size: tuple[int, int]) -> None:
    with progress_bar("frames", len(recording.moments)) as advance:
        count = recording.save(path, size=size, progress=advance)
    if recording.is_full:
        say(
            f"{path} ends before the run does: a film has {count} frames at most; for all of it lower --fps or raise --speed"
        )
    say(f"wrote {path}  {size[0]} x {size[1]} pixels, {count} frames")


def _shown(run: PickAndPlace) -> Any:
    """MuJoCo's own window, which follows the simulation in real time; returns what closes it."""
    from pieper.sim.window import open_window

    return open_window(run.robot)
