"""``pieper calibrate-field``: where the field lies before a camera, from corners, field lines or AprilTags."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.outputs import keep_apart
from pieper.cli.show import say
from pieper.errors import VisionError

if TYPE_CHECKING:
    from pieper.perception.camera import Camera
    from pieper.perception.field import FieldCalibration

_NO_LENS = "without --camera only"


def calibrate_field(
    source: Annotated[Path, typer.Argument(metavar="IMAGE_OR_VIDEO", help="What the camera sees.")],
    camera: Annotated[
        Path | None,
        typer.Option("--camera", metavar="FILE", help="The lens, camera.yaml; one is assumed, and said, by default."),
    ] = None,
    corner: Annotated[
        list[str] | None,
        typer.Option(
            "--corner",
            metavar="U,V=X,Y[,Z]",
            help="A pixel and its place on the field [m]; four or more. With --lines, where the search begins.",
        ),
    ] = None,
    lines: Annotated[
        str | None,
        typer.Option(
            "--lines",
            metavar="FIELD",
            help="Fit the lines of vsss, ssl-a, ssl-b, or those in a .yaml file.",
            autocompletion=completion.field_lines,
        ),
    ] = None,
    tags: Annotated[
        Path | None, typer.Option("--tags", metavar="FILE", help="YAML file with the places of AprilTags 36h11.")
    ] = None,
    field: Annotated[
        str | None,
        typer.Option("--field-size", metavar="LxW", help="Length and width of the field [m], such as 1.5x1.3."),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option("--camera-height", metavar="M", help=f"Of the camera above the field [m]; {_NO_LENS}."),
    ] = None,
    radial: Annotated[
        int | None,
        typer.Option("--radial", metavar="N", help=f"Radial coefficients to find, 0 to 2; {_NO_LENS}."),
    ] = None,
    frame: Annotated[
        int | None, typer.Option("--frame", metavar="N", help="Frame of a video; else the median of 25 frames.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Write the result; the field, .yaml.")
    ] = Path("field.yaml"),
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="FILE", help="Draw a picture; of field and misses over the image, .png or .jpg."
        ),
    ] = None,
) -> int:
    """Find where the field lies before a camera, without a window.

    For example:
      pieper calibrate-field field.png --camera camera.yaml --lines vsss
    """
    from pieper.perception.calibration_file import load_camera
    from pieper.perception.calibration_picture import save_picture
    from pieper.perception.image_file import read_view

    if lines is not None and tags is not None:
        raise VisionError("--lines and --tags both say how to find the field; give one of them")
    if lines is None and tags is None and not corner:
        raise VisionError("say how to find the field: --corner u,v=x,y four times, --lines vsss, or --tags tags.yaml")
    if tags is not None and corner:
        raise VisionError("--tags needs no --corner; give one of them")
    if picture is not None and picture.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise VisionError(f"--picture must end in .png or .jpg, got {str(picture)!r}")
    keep_apart([source, camera, lines, tags], {"--out": out, "--picture": picture})
    lens = None if camera is None else load_camera(camera)
    if lens is not None and (camera_height is not None or radial is not None):
        raise VisionError("--camera tells the lens; --camera-height and --radial are for a lens that is not known")
    image = read_view(source, frame=frame)
    size = _size(field) if field is not None else None
    known: dict[str, Any] = {"camera": lens, "camera_height": camera_height}
    result = _find(image, corner or [], lines, tags, radial, size, known)
    result.save(out, sources=[source.name, *([camera.name] if camera else [])])
    say(result.report())
    say(f"wrote {out}")
    if picture is not None:
        save_picture(picture, result.picture(image))
        say(f"wrote {picture}")
    return 0


def _find(
    image: Any,
    corners: list[str],
    lines: str | None,
    tags: Path | None,
    radial: int | None,
    size: tuple[float, float] | None,
    known: dict[str, Any],
) -> FieldCalibration:
    from pieper.perception import field, field_lines

    shape = (int(image.shape[1]), int(image.shape[0]))
    if known["camera"] is not None:
        _same_size(known["camera"], shape)
    if tags is not None:
        return field.from_tags(image, field.load_tags(tags), radial=radial or 0, size=size, **known)
    points = [_corner(text) for text in corners]
    if lines is None:
        uv, p = [point[:2] for point in points], [point[2:] for point in points]
        return field.from_points(uv, p, image_size=shape, radial=radial or 0, size=size, **known)
    model = field_lines.lines(lines)
    start = None
    if points:
        uv, p = [point[:2] for point in points], [point[2:] for point in points]
        start = field.from_points(uv, p, image_size=shape, **known).view
    return field.from_lines(image, model, start=start, radial=1 if radial is None else radial, **known)


def _same_size(camera: Camera, size: tuple[int, int]) -> None:
    if camera.size != size:
        raise VisionError(
            f"the image is {size[0]} x {size[1]} pixels and the camera is calibrated for {camera.size[0]} x {camera.size[1]}; "
            "calibrate it at the resolution that is used"
        )


def _corner(text: str) -> tuple[float, ...]:
    pixel, _, place = text.partition("=")
    try:
        numbers = [float(word) for word in pixel.split(",")], [float(word) for word in place.split(",")]
    except ValueError:
        numbers = [], []
    if len(numbers[0]) != 2 or len(numbers[1]) not in (2, 3):
        raise VisionError(
            f"--corner must be u,v=x,y in pixels and metres, with the height as a third if it has one, got {text!r}"
        )
    return (*numbers[0], *numbers[1], *([0.0] if len(numbers[1]) == 2 else []))


def _size(text: str) -> tuple[float, float]:
    try:
        length, width = (float(word) for word in text.lower().split("x"))
    except ValueError:
        length = width = 0.0
    if not (0 < length < 1e3 and 0 < width < 1e3):
        raise VisionError(f"--field-size must be length x width in metres, such as 1.5x1.3, got {text!r}")
    return length, width
