"""``pieper render``: a picture of an arm, or a film of its motion, without a screen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import ArmName, Axis, Base, Degrees, Nominal, Quaternion, Rpy, Tip, load
from pieper.cli.pixels import pixels
from pieper.cli.progress import progress_bar
from pieper.cli.show import say
from pieper.cli.target import start_values, wanted
from pieper.errors import ArrayError, unknown_name

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.cli.target import Wanted
    from pieper.ik.solutions import IKSolutions
    from pieper.model.dh import DhTable
    from pieper.motion.trajectory import Trajectory
    from pieper.sim.picture import Picture

_GHOST = 0.22
_STILL, _MOVING = "960x720", "640x480"


def render(
    arm: ArmName,
    out: Annotated[Path, typer.Argument(metavar="FILE", help="A .png picture, or an .mp4 or .gif film.")],
    q: Annotated[
        str | None,
        typer.Option(
            "--q", metavar="Q1,Q2,...", help="Joint values, zero by default [rad or m; with --deg, deg or m]."
        ),
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option("--trajectory", metavar="FILE", help="A motion, .csv, .json or .npz.")
    ] = None,
    target: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--target", metavar="X Y Z", help="Position of the tip in the base frame [m]; the arm moves there from --q."
        ),
    ] = None,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    degrees: Degrees = False,
    frames: Annotated[bool, typer.Option("--frames", help="Draw every frame of the arm, with its name.")] = False,
    axes: Annotated[bool, typer.Option("--axes", help="Draw the joint axes, with their names.")] = False,
    dh: Annotated[
        str | None,
        typer.Option(
            "--dh",
            metavar="TABLE",
            help="Draw the arm of a DH table with its frames: simplified or full for the youBot; standard, modified or "
            "hayati for any arm.",
            autocompletion=completion.drawings,
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size",
            metavar="WxH",
            help="Pixels, width and height; 960x720 for a picture, 640x480 for a film by default.",
        ),
    ] = None,
    view: Annotated[
        str,
        typer.Option(
            "--seen-from",
            metavar="VIEW",
            help="corner, front, back, left, right, top; or AZIMUTH,ELEVATION [deg].",
            autocompletion=completion.views,
        ),
    ] = "corner",
    theme: Annotated[
        str, typer.Option("--theme", metavar="THEME", help="light or dark.", autocompletion=completion.themes)
    ] = "light",
    color: Annotated[str | None, typer.Option("--arm-color", metavar="#RRGGBB", help="Colour of the arm.")] = None,
    grid: Annotated[bool, typer.Option("--grid/--no-grid", help="Floor with a grid, or nothing.")] = True,
    meshes: Annotated[
        bool, typer.Option("--meshes/--no-meshes", help="Meshes of the description, or a shape made from the joints.")
    ] = True,
    fps: Annotated[float | None, typer.Option("--fps", metavar="N", help="Frames a second; of a film.")] = None,
    speed: Annotated[float, typer.Option("--speed", metavar="X", help="Play it X times as fast; a film.")] = 1.0,
    hold: Annotated[float, typer.Option("--hold", metavar="SECONDS", help="Show the end of a film this long.")] = 0.0,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
) -> int:
    """Draw an arm into a PNG picture, or its motion into an MP4 or GIF film; needs no screen.

    For example:
      pieper render mh12 mh12.png --frames
    """
    from pieper.motion import files
    from pieper.sim.picture import Picture

    film = _is_film(out)
    if target is not None and trajectory is not None:
        raise ArrayError("--target and --trajectory both say how to move; give one of them")
    if target is None and (rpy, quaternion, axis) != (None, None, None):
        raise ArrayError("--rpy, --quat and --axis speak of the orientation at a target; give --target X Y Z too")
    if film and target is None and trajectory is None:
        raise ArrayError(f"{out.name} is a film, which needs --target or --trajectory; a picture ends in .png")
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    if dh is not None:
        robot = _arm_of_table(robot, dh)
    picture = Picture(size=pixels(size or (_MOVING if film else _STILL)), theme=theme, view=_view(view), grid=grid)
    shown: dict[str, Any] = {"color": color, "frames": frames or dh is not None, "axes": axes, "meshes": meshes}
    start = start_values(robot, q, degrees=degrees, option="--q")
    move, answers = None, None
    if target is not None:
        goal = wanted(*target, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
        move, answers = _move_to(robot, start, goal)
        picture.add_frame(goal.pose_from(robot.fk(move.q[-1])[:3, :3]), label="target")
    elif trajectory is not None:
        move = files.read(trajectory).in_order(robot.joint_names)
    picture.add_arm(robot, start if move is None else move, trace=move is not None, **shown)
    if move is not None and not film:
        picture.add_arm(robot, move.q[0], opacity=_GHOST, color=picture.stage.arms[0].color, meshes=meshes)
    if film:
        _save_film(picture, out, fps=fps, speed=speed, hold=hold)
    else:
        picture.save(out, t=picture.duration)
        say(f"wrote {out}  {_pixels(picture)}")
    if answers is None or answers.reached:
        return 0
    say(f"not reached  {answers.reason}", "red")
    return 1


def _is_film(out: Path) -> bool:
    suffix = out.suffix.lower()
    if suffix not in (".png", ".mp4", ".gif"):
        raise ArrayError(f"FILE must end in .png, .mp4 or .gif, got {str(out)!r}")
    return suffix != ".png"


def _view(text: str) -> str | tuple[float, float]:
    from math import isfinite, radians

    if "," not in text:
        return text
    try:
        azimuth, elevation = (float(word) for word in text.split(","))
    except ValueError:
        azimuth, elevation = float("nan"), 0.0
    if not (isfinite(azimuth) and -90.0 <= elevation <= 90.0):
        raise ArrayError(
            f"--seen-from must be a name, or AZIMUTH,ELEVATION in degrees, the latter from -90 to 90, got {text!r}"
        )
    return radians(azimuth), radians(elevation)


def _arm_of_table(robot: Arm, label: str) -> Arm:
    """The arm that a table describes; its frames have the names that the reports give them, or ``dh_1``, ``dh_2``, ..."""
    from pieper.arm import Arm
    from pieper.model import catalog
    from pieper.model.chain import Frame
    from pieper.model.dh import as_dh, from_dh
    from pieper.ros.nodes.transforms import DH_FRAMES

    tables: dict[str, DhTable] = {}
    if robot.description is not None and robot.name in catalog.names():
        tables = catalog.dh_tables(robot.name)
    computed = ("standard", "modified", "hayati")
    if label in tables:
        table, prefix = tables[label], DH_FRAMES.get(label, "dh_")
    elif label in computed:
        table, prefix = as_dh(robot.chain, convention=label), "dh_"  # type: ignore[arg-type]
    else:
        raise unknown_name("table", label, [*tables, *computed], f"robot {robot.name!r}")
    chain = from_dh(table)
    names = {chain.frames[1 + row].name: f"{prefix}{number}" for number, row in enumerate(table.moving, start=1)}
    ends = (chain.base, chain.tip)
    kept = [Frame(names.get(f.name, f.name), f.after, f.home) for f in chain.frames if f.name in (*names, *ends)]
    if any((kept[-1].home == frame.home).all() for frame in kept[:-1]):  # the tip is the last frame of the table
        kept.pop()
    return Arm(replace(chain, frames=tuple(kept), tip=kept[-1].name))


def _move_to(robot: Arm, start: Any, goal: Wanted) -> tuple[Trajectory, IKSolutions]:
    """From the start to the target, or as near to it as can be."""
    from pieper.ik.solve import solve
    from pieper.motion.joint_move import joint_move

    answers = solve(robot.chain, goal.target(), seed=start)
    return joint_move(robot.chain, start, answers.q[0] if answers.reached else answers.nearest.q), answers


def _save_film(picture: Picture, out: Path, *, fps: float | None, speed: float, hold: float) -> None:
    from pieper.sim import film

    with progress_bar("frames") as advance:
        count = film.save(picture, out, fps=fps, speed=speed, hold=hold, progress=advance)
    say(f"wrote {out}  {_pixels(picture)}, {count} frames, motion {picture.duration:.2f} s")


def _pixels(picture: Picture) -> str:
    return "{} x {} pixels".format(*picture.stage.size)
