"""``pieper calibrate-hand-eye``: where a camera is on a robot, from poses of the arm and what the camera saw; and from where to look."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pieper.cli import completion
from pieper.cli.calibrate_camera import BoardName
from pieper.cli.outputs import keep_apart
from pieper.cli.progress import progress_bar
from pieper.cli.show import say
from pieper.errors import VisionError

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.perception.capture_plan import CapturePlan
    from pieper.perception.hand_eye import CameraOn, HandEyeCalibration
    from pieper.perception.hand_eye_file import Captures
    from pieper.spatial._checks import FloatArray


def calibrate_hand_eye(
    source: Annotated[
        Path | None,
        typer.Argument(metavar="[CAPTURES]", help="A .csv or .yaml file of poses, or a folder with poses.csv and images."),
    ] = None,
    camera_on: Annotated[
        str, typer.Option("--camera-on", metavar="WHERE", help="hand, with the board standing still; or cell, with the board in the hand.", autocompletion=completion.mounts)
    ] = "hand",
    arm: Annotated[
        str | None, typer.Option("--arm", metavar="ARM", help="A built-in robot, or a URDF, xacro or JSON file; for captures that tell joint values, and for a plan.", autocompletion=completion.robots)
    ] = None,
    tip: Annotated[str | None, typer.Option("--tip", metavar="LINK", help="Link where the arm ends.")] = None,
    camera: Annotated[
        Path | None, typer.Option("--camera", metavar="FILE", help="The lens, camera.yaml; for images and for a plan.")
    ] = None,
    board: BoardName = "charuco:7x5:0.03:0.022",
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Write the result; the calibration, .yaml.")] = Path("hand_eye.yaml"),
    plan: Annotated[
        Path | None, typer.Option("--plan", metavar="FILE", help="Write arm poses to look from, or to add, into a .csv.")
    ] = None,
    count: Annotated[int, typer.Option("--count", metavar="N", help="How many; poses of the plan.")] = 12,
    guess: Annotated[
        Path | None,
        typer.Option("--guess", metavar="FILE", help="For a plan without captures: about where camera and board are, as in the file that --out writes."),
    ] = None,
) -> int:  # fmt: skip
    """Find out where a camera is: on the hand of an arm, or in its cell. Without captures, plan from where to look.

    For example:
      pieper calibrate-hand-eye captures.csv --camera-on hand
    """
    from pieper.cli import arguments
    from pieper.perception.hand_eye_file import read_captures, save_hand_eye

    if camera_on not in ("hand", "cell"):
        raise VisionError(f"--camera-on must be hand or cell, got {camera_on!r}")
    if source is None and plan is None:
        raise VisionError("give captures to calibrate from, or --plan FILE to plan them")
    if plan is not None and plan.suffix.lower() != ".csv":
        raise VisionError(f"--plan writes a .csv, got {str(plan)!r}")
    keep_apart([source, camera, guess], {"--out": None if source is None else out, "--plan": plan})
    robot = None if arm is None else arguments.load(arm, tip=tip)
    captures = found = have = None
    if source is not None:
        captures = read_captures(source, robot)
        found, rows = _calibrated(captures, "hand" if camera_on == "hand" else "cell", camera, board)
        have = captures.Ts_base_tcp[rows][found.used]
        say(found.report())
        save_hand_eye(out, found, sources=[source.name])
        say(f"wrote {out}")
    if plan is not None:
        near = None if captures is None or captures.q is None else captures.q[-1]
        _plan(plan, robot, camera, board, count, guess, found, have, near)
    return 0


def _calibrated(
    captures: Captures, camera_on: CameraOn, camera: Path | None, board: str
) -> tuple[HandEyeCalibration, list[int]]:
    from pieper.perception.board import Board
    from pieper.perception.board_views import BoardView
    from pieper.perception.calibration_file import load_camera
    from pieper.perception.hand_eye import calibrate_hand_eye, calibrate_hand_eye_from_views
    from pieper.perception.image_file import read_image

    if captures.Ts_camera_target is not None:
        found = calibrate_hand_eye(
            captures.Ts_base_tcp, captures.Ts_camera_target, camera_on=camera_on, names=captures.names
        )
        return found, list(range(len(captures.names)))
    if camera is None:
        raise VisionError("the captures name images: give the lens with --camera, see pieper calibrate-camera")
    lens, shown = load_camera(camera), Board.parse(board)
    views, rows = [], []
    with progress_bar("images") as progress:
        for row, path in enumerate(captures.images):
            image = read_image(path)
            if (image.shape[1], image.shape[0]) != lens.size:
                raise VisionError(
                    f"{path}: the image is {image.shape[1]} x {image.shape[0]} pixels and the camera is calibrated for {lens.size[0]} x {lens.size[1]}"
                )
            corners = shown.find(image)
            if corners is not None:
                views.append(BoardView(captures.names[row], *corners))
                rows.append(row)
            progress(row + 1, len(captures.images))
    say(f"board {shown} found in {len(views)} of {len(captures.images)} images")
    return calibrate_hand_eye_from_views(captures.Ts_base_tcp[rows], views, shown, lens, camera_on=camera_on), rows


def _plan(
    path: Path,
    arm: Arm | None,
    camera: Path | None,
    board: str,
    count: int,
    guess: Path | None,
    found: HandEyeCalibration | None,
    have: FloatArray | None,
    near: FloatArray | None,
) -> None:
    import numpy as np

    from pieper.perception.board import Board
    from pieper.perception.calibration_file import load_camera
    from pieper.perception.capture_plan import plan_captures
    from pieper.perception.hand_eye_file import load_hand_eye, write_captures

    if arm is None or camera is None:
        raise VisionError("a plan needs the arm and the lens: give --arm and --camera")
    if found is not None:
        where = found.camera_on, found.T_mount_camera, found.T_holder_target
    elif guess is not None:
        where = load_hand_eye(guess)
    else:
        raise VisionError("a plan needs to know about where camera and board are: give --guess FILE, or captures")
    planned: CapturePlan = plan_captures(
        arm, load_camera(camera), Board.parse(board), camera_on=where[0], T_mount_camera=where[1], T_holder_target=where[2], count=count,
        have=have, q_near=near,
    )  # fmt: skip
    write_captures(path, planned.q, images=[f"capture_{k + 1:02d}.png" for k in range(count)])
    say(
        f"wrote {path}  {count} poses of {planned.reached} that the arm reaches; with them the camera is known to about "
        f"{1e3 * planned.position_deviation:.2f} mm and {np.degrees(planned.rotation_deviation):.3f} deg"
    )
