"""``pieper plot``: figures as papers print them, in a window or in a file."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import ArmName, Base, Degrees, Nominal, Quaternion, Rpy, Start, Tip, load
from pieper.cli.show import say, small
from pieper.cli.verb import Group, Verb
from pieper.errors import ArrayError, PieperError, UnknownNameError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.ik.iteration import Step
    from pieper.motion.trajectory import Trajectory

_STOP = 1e-3  # [m] where an iteration ends when nothing is said about its end
_MOST_STEPS = 1000  # likewise
_THEMES = ("light", "dark")


class Orientation(str, Enum):
    """How an iteration treats the orientation."""

    IGNORE = "ignore"
    HOLD = "hold"
    REACH = "reach"


class Question(str, Enum):
    """What two models are asked."""

    FK = "fk"
    IK = "ik"


Files = Annotated[
    list[Path] | None,
    typer.Option("--trajectory", metavar="FILE", help="A motion, .csv, .json or .npz; may be repeated."),
]
FromIteration = Annotated[
    bool,
    typer.Option("--from-iteration", help="Draw the steps of the Jacobian iteration to --target instead of a file."),
]
Target = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--target", metavar="X Y Z", help="Position of the tip in the base frame [m]; where the iteration goes."
    ),
]
Orient = Annotated[
    Orientation,
    typer.Option(
        "--orientation", metavar="HOW", help="Iteration: what it does about the orientation: ignore, hold or reach."
    ),
]
Alpha = Annotated[float, typer.Option("--alpha", metavar="A", help="Iteration: gain of the whole step.")]
K1 = Annotated[
    list[float] | None,
    typer.Option(
        "--k1", metavar="K", help="Iteration: gain of the position; 1 by default, may be repeated to compare."
    ),
]
K2 = Annotated[float, typer.Option("--k2", metavar="K", help="Iteration: gain of the rotation.")]
Damping = Annotated[float, typer.Option("--damping", metavar="D", help="Iteration: damping; 0 for the pseudo-inverse.")]
Iterations = Annotated[
    int | None, typer.Option("--iterations", metavar="N", help="Iteration: number of steps at most.")
]
Tolerance = Annotated[
    float | None, typer.Option("--tolerance", metavar="M", help="Iteration: ends this close to the target [m].")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write the result; as .png, .pdf or .svg instead of in a window."),
]
Theme = Annotated[
    str, typer.Option("--theme", metavar="THEME", help="light or dark.", autocompletion=completion.themes)
]
Title = Annotated[str, typer.Option("--title", metavar="TEXT", help="Heading of the figure.")]


class _Figures(Group):
    thing = "figure"


app = typer.Typer(
    cls=_Figures,
    rich_markup_mode=None,
    subcommand_metavar="FIGURE ...",
    help="Figures as papers print them. They open in a window, or --out writes them.",
    epilog="Draws the joint values of --trajectory FILE, or with --from-iteration the steps to --target.",
)


@dataclass(frozen=True)
class Run:
    """Joint values to draw: those of a file, or the steps of an iteration."""

    label: str
    q: Trajectory | NDArray[np.float64]
    steps: tuple[Step, ...] = ()

    @property
    def rows(self) -> NDArray[np.float64]:
        """(m, n) joint values [rad or m]; between the points of a trajectory too."""
        from pieper.motion.trajectory import Trajectory

        return _between(self.q) if isinstance(self.q, Trajectory) else self.q


@dataclass(frozen=True)
class _Look:
    """What every figure of a motion takes."""

    degrees: bool
    title: str
    theme: Any


def _path(robot: Arm, runs: list[Run], asked: _Iteration, look: _Look) -> Any:
    """The path of the tip in three dimensions, and how far it strays from a straight line.

    For example:
      pieper plot path ur5e --trajectory move.csv --out path.png
    """
    from pieper.viewer import plot

    paths = {run.label: robot.fk(run.rows)[:, :3, 3] for run in runs}
    for label, points in paths.items():
        line = plot.straight_line(points, asked.target)
        say(f"{label}: {len(points)} points, at most {small(line.largest, 'm')} off the straight line")
    given = paths if len(paths) > 1 else next(iter(paths.values()))
    return plot.path(given, target=asked.target, title=look.title, theme=look.theme)


def _joints(robot: Arm, runs: list[Run], asked: _Iteration, look: _Look) -> Any:
    """Joint values and velocities over time, with what the limits forbid shaded; --deg draws degrees.

    For example:
      pieper plot joints ur5e --trajectory move.csv --deg --out joints.png
    """
    from pieper.viewer import plot

    if len(runs) > 1:
        raise PieperError(f"joints draws one motion, got {len(runs)}; give one --trajectory, or one --k1")
    return plot.joints(robot, runs[0].q, degrees=look.degrees, title=look.title, theme=look.theme)


def _error(robot: Arm, runs: list[Run], asked: _Iteration, look: _Look) -> Any:
    r"""What is left to the target against the iteration, or against the row of a file, on a logarithmic axis.

    For example:
      pieper plot error ur5e --from-iteration --target 0.5 0.2 0.4 \
          --k1 0.1 --k1 0.5 --out error.png
    """
    import numpy as np

    from pieper.viewer import plot

    if asked.target is None:
        raise PieperError("an error needs the target that it is the distance to: --target X Y Z")
    left: dict[str, Any] = {}
    for run in runs:
        left[run.label] = run.steps or np.linalg.norm(robot.fk(run.rows)[:, :3, 3] - np.array(asked.target), axis=1)
        if run.steps:
            distance, count = small(float(np.linalg.norm(run.steps[-1].error[:3])), "m"), run.steps[-1].iteration
            say(f"{run.label}: {distance} left after {count} steps")
    iterated = all(run.steps for run in runs)
    rate = 1.0 - asked.alpha * asked.gains[0]
    shrinks = iterated and len(runs) == 1 and rate > 0.0 and not asked.damping
    stop = asked.position_stop if iterated else None
    return plot.error(left, rate=rate if shrinks else None, stop=stop, title=look.title, theme=look.theme)


def _manipulability(robot: Arm, runs: list[Run], asked: _Iteration, look: _Look) -> Any:
    """Manipulability along a path, and the distance to the nearest singularity.

    For example:
      pieper plot manipulability ur5e --trajectory move.csv --out w.png
    """
    from pieper.viewer import plot

    return plot.manipulability(robot, {run.label: run.q for run in runs}, title=look.title, theme=look.theme)


def _verb(draw: Callable[[Arm, list[Run], _Iteration, _Look], Any]) -> Callable[..., int]:
    """A figure of a motion as a verb: all of them take the same arguments."""

    def run(
        arm: ArmName,
        trajectory: Files = None,
        from_iteration: FromIteration = False,
        target: Target = None,
        rpy: Rpy = None,
        quaternion: Quaternion = None,
        orientation: Orient = Orientation.IGNORE,
        alpha: Alpha = 1.0,
        k1: K1 = None,
        k2: K2 = 1.0,
        damping: Damping = 0.0,
        iterations: Iterations = None,
        tolerance: Tolerance = None,
        start: Start = None,
        degrees: Degrees = False,
        out: Out = None,
        theme: Theme = "light",
        title: Title = "",
        base: Base = None,
        tip: Tip = None,
        nominal: Nominal = False,
    ) -> int:
        _check(out, theme)
        robot = load(arm, base=base, tip=tip, nominal=nominal)
        asked = _Iteration(
            target, rpy, quaternion, orientation, alpha, k1, k2, damping, iterations, tolerance, start, degrees
        )
        runs = _runs(robot, trajectory, from_iteration, asked)
        _finish(draw(robot, runs, asked, _Look(degrees, title, theme)), out)
        return asked.outcome(runs)

    run.__doc__ = draw.__doc__
    return run


for _draw, _summary in {
    _path: "Path of the tip in 3-D, beside a straight line.",
    _joints: "Joint values and velocities against their limits.",
    _error: "What is left to the target against the iteration.",
    _manipulability: "Manipulability along a path.",
}.items():
    app.command(_draw.__name__[1:], cls=Verb, short_help=_summary, rich_help_panel="A motion")(_verb(_draw))


@app.command(cls=Verb, short_help="Two models side by side, and their difference.", rich_help_panel="Models")
def compare(
    arm: ArmName,
    other: Annotated[
        str, typer.Argument(metavar="OTHER", help="The other model of the same arm.", autocompletion=completion.tables)
    ],
    question: Annotated[
        Question,
        typer.Option("--question", metavar="WHAT", help="fk at the same joint values, or ik of the same pose."),
    ] = Question.FK,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="Q1,Q2,...",
            help="Joint values that the others keep while one sweeps [rad or m; with --deg, deg or m].",
        ),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="Values per joint.")] = 121,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Do not turn the tip frame of OTHER to lie like the first.")
    ] = False,
    degrees: Degrees = False,
    out: Out = None,
    theme: Theme = "light",
    title: Title = "",
    nominal: Nominal = False,
) -> int:
    """Two models side by side, and their difference in mm and mrad while each joint sweeps its range.

    For example:
      pieper plot compare mh12-report mh12 --out models.png
    """
    from pieper.cli.target import start_values
    from pieper.viewer import plot
    from pieper.viewer.compare import Comparison

    _check(out, theme)
    robot, second = load(arm, nominal=nominal), load(other)
    q = None if at is None else start_values(robot, at, degrees=degrees, option="--at")
    for rule in Comparison(robot, second, turn_tip=not as_is).rules:
        say(rule)
    shown: Any = {"degrees": degrees, "title": title, "theme": theme}
    figure = plot.compare(robot, second, question=question.value, q=q, samples=samples, turn_tip=not as_is, **shown)
    _finish(figure, out)
    return 0


@dataclass(frozen=True)
class _Iteration:
    """What was typed about the iteration."""

    target: tuple[float, float, float] | None
    rpy: tuple[float, float, float] | None
    quaternion: tuple[float, float, float, float] | None
    orientation: Orientation
    alpha: float
    k1: list[float] | None
    k2: float
    damping: float
    iterations: int | None
    tolerance: float | None
    start: str | None
    degrees: bool

    @property
    def gains(self) -> list[float]:
        return self.k1 or [1.0]

    @property
    def position_stop(self) -> float | None:
        return _STOP if self.tolerance is None and self.iterations is None else self.tolerance

    def runs(self, robot: Arm) -> list[Run]:
        import numpy as np

        from pieper.cli.target import start_values, wanted
        from pieper.ik.iteration import iterate

        if self.target is None:
            raise PieperError("--from-iteration needs a target: --target X Y Z")
        turns = self.rpy is not None or self.quaternion is not None
        if turns != (self.orientation is Orientation.REACH):
            raise PieperError("--orientation reach and --rpy or --quat belong together; give both or neither")
        goal = wanted(*self.target, rpy=self.rpy, quaternion=self.quaternion, axis=None, degrees=self.degrees)
        goal.target()  # refuses what does not go together
        start = start_values(robot, self.start, degrees=self.degrees)
        made = []
        for gain in self.gains:
            steps = tuple(
                iterate(
                    robot.chain,
                    goal.pose_from(np.eye(3)) if turns else self.target,
                    start,
                    orientation=self.orientation.value,
                    alpha=self.alpha,
                    k1=gain,
                    k2=self.k2,
                    damping=self.damping,
                    iterations=_MOST_STEPS if self.iterations is None else self.iterations,
                    position_stop=self.position_stop,
                    rotation_stop=self.position_stop if turns else None,
                )
            )
            label = "TCP trajectory" if len(self.gains) == 1 else f"k1 = {gain:g}"
            made.append(Run(label, np.array([step.q for step in steps]), steps))
        return made

    def outcome(self, runs: list[Run]) -> int:
        """The exit code: 1 where an iteration ended too far from its target."""
        missed = [
            run for run in runs if run.steps and self.position_stop and run.steps[-1].norm > 2.0 * self.position_stop
        ]
        for run in missed:
            left, count = small(run.steps[-1].norm, "m"), run.steps[-1].iteration
            typer.secho(
                f"pieper: {run.label}: not reached, {left} left after {count} steps", err=True, fg=typer.colors.YELLOW
            )
        return 1 if missed else 0


def _runs(robot: Arm, files: list[Path] | None, from_iteration: bool, asked: _Iteration) -> list[Run]:
    if from_iteration == bool(files):
        raise PieperError("give one of --trajectory FILE and --from-iteration")
    if from_iteration:
        return asked.runs(robot)
    stems = [file.stem for file in files or ()]
    labels = stems if len(set(stems)) == len(stems) else [str(file) for file in files or ()]
    if len(set(labels)) < len(labels):
        raise PieperError("a trajectory is given twice")
    return [Run(label, _read(file, robot)) for label, file in zip(labels, files or (), strict=True)]


def _read(file: Path, robot: Arm) -> Trajectory:
    """The trajectory in a file, in the order of the joints of the arm."""
    from pieper.motion import files

    read = files.read(file)
    try:
        return read.in_order(robot.joint_names)
    except (ArrayError, UnknownNameError) as error:
        raise type(error)(f"{file}: {error}") from error


def _between(trajectory: Trajectory) -> NDArray[np.float64]:
    """(m, n) joint values of a trajectory at its points and between them [rad or m]."""
    import numpy as np

    u = np.linspace(0.0, 1.0, 9)[:-1]
    t = (trajectory.t[:-1, None] + u * np.diff(trajectory.t)[:, None]).ravel()
    return trajectory.sample(np.append(t, trajectory.t[-1])).q


def _check(out: Path | None, theme: str) -> None:
    """Complain before any work where the figure can go nowhere."""
    from pieper.viewer import plot

    if theme not in _THEMES:
        raise unknown_name("theme", theme, _THEMES)
    if out is None:
        plot.need_screen()
    else:
        plot.checked_file(out)


def _finish(figure: Any, out: Path | None) -> None:
    from pieper.viewer import plot

    if out is None:
        plot.show(figure)
    else:
        plot.save(figure, out)
        typer.echo(f"wrote {out}", err=True)
