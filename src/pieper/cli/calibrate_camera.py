"""``pieper calibrate-camera``: a lens, from pictures of a board; and the board itself, to be printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pieper.cli.outputs import keep_apart
from pieper.cli.progress import progress_bar
from pieper.cli.show import say
from pieper.errors import VisionError

BoardName = Annotated[
    str,
    typer.Option(
        "--board",
        metavar="BOARD",
        help="charuco:COLUMNSxROWS:SQUARE:MARKER in squares and metres, or chessboard:COLUMNSxROWS:SQUARE in inner corners "
        "and metres.",
    ),
]


def calibrate_camera(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="[SOURCE]...", help="Images, folders of images, videos.")
    ] = None,
    board: BoardName = "charuco:7x5:0.03:0.022",
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Write the result; the camera, .yaml.")
    ] = Path("camera.yaml"),
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE", help="Draw a picture; of what is left over, .png or .jpg."),
    ] = None,
    distortion: Annotated[
        int | None,
        typer.Option(
            "--distortion", metavar="N", help="Coefficients: 0, 4, 5 or 8; five, or by a stated rule, if not given."
        ),
    ] = None,
    most: Annotated[int, typer.Option("--views", metavar="N", help="Views that are used at most.")] = 40,
    draw: Annotated[
        Path | None, typer.Option("--draw", metavar="FILE", help="Draw the board to scale into a .png, and leave.")
    ] = None,
    dpi: Annotated[int, typer.Option("--dpi", metavar="N", help="Dots per inch of the drawing.")] = 300,
) -> int:
    """Calibrate a lens from pictures or a video of a printed board, without a window.

    For example:
      pieper calibrate-camera --draw board.png
      pieper calibrate-camera pictures --out camera.yaml
    """
    from pieper.perception.board import Board
    from pieper.perception.board_views import find_views
    from pieper.perception.calibration import calibrate_camera as calibrate
    from pieper.perception.calibration_picture import camera_picture, save_picture

    shown = Board.parse(board)
    if draw is not None:
        if draw.suffix.lower() != ".png":
            raise VisionError(f"--draw writes a .png, got {str(draw)!r}")
        shown.save_drawing(draw, dpi)
        width, height = ((n + 2) * shown.square * 1e3 for n in shown.squares)
        say(f"wrote {draw}  {shown}, {width:g} x {height:g} mm with its margin, {dpi} dots per inch; print at 100 %")
        return 0
    if not sources:
        raise VisionError("give images, a folder or a video that show the board; --draw FILE makes a board to print")
    if picture is not None and picture.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise VisionError(f"--picture must end in .png or .jpg, got {str(picture)!r}")
    keep_apart(sources, {"--out": out, "--picture": picture})
    with progress_bar("images") as progress:
        found = find_views(sources, shown, most=most, progress=progress)
    result = calibrate(found, shown, coefficients=distortion)
    result.save(out, sources=[source.name for source in sources])
    say(f"board found in {len(found.views)} views that are used, of {found.looked_at} images")
    say(result.report())
    say(f"wrote {out}")
    if picture is not None:
        save_picture(picture, camera_picture(result))
        say(f"wrote {picture}")
    return 0
