"""``pieper synthesize``: a film of robots with coloured markers, and the truth about it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import Json
from pieper.cli.pixels import pixels
from pieper.cli.progress import progress_bar
from pieper.cli.show import console, print_json, print_table, say
from pieper.errors import VisionError

if TYPE_CHECKING:
    from pieper.perception.scene import Scene


def synthesize(
    scene: Annotated[
        str | None,
        typer.Argument(metavar="SCENE", help="Name of a scene; --list shows them.", autocompletion=completion.scenes),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Write the result; into the scene's name by default."),
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="List the scenes and leave.")] = False,
    count: Annotated[int | None, typer.Option("--count", metavar="N", help="How many; frames of the film.")] = None,
    fps: Annotated[float | None, typer.Option("--fps", metavar="N", help="Frames a second; of the film.")] = None,
    size: Annotated[
        str, typer.Option("--size", metavar="WxH", help="Pixels, width and height; of a frame.")
    ] = "640x480",
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Of random numbers, the same again for the same; for the noise.")
    ] = 1,
    noise: Annotated[float | None, typer.Option("--noise", metavar="SIGMA", help="Grey levels of 255.")] = None,
    exposure: Annotated[float | None, typer.Option("--exposure", metavar="SECONDS", help="Motion blur.")] = None,
    light: Annotated[
        tuple[float, float] | None,
        typer.Option("--light", metavar="FIRST LAST", help="Light at the first and last frame."),
    ] = None,
    gradient: Annotated[
        float | None, typer.Option("--gradient", metavar="SHARE", help="Light from left to right.")
    ] = None,
    cast: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--cast", metavar="FIRST LAST", help="Colour cast at the first and last frame: red up, blue down."
        ),
    ] = None,
    shadow: Annotated[
        float | None, typer.Option("--shadow", metavar="SHARE", help="Light that a shadow takes.")
    ] = None,
    quality: Annotated[
        int | None, typer.Option("--quality", metavar="1-100", help="JPEG quality of each frame.")
    ] = None,
    lossless: Annotated[bool, typer.Option("--lossless", help="PNG pictures instead of a video.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Write over what is there.")] = False,
    as_json: Json = False,
) -> int:
    """Draw a scene with exact truth: video, truth, calibration, patterns, and regions that show the colours.

    For example:
      pieper synthesize clean --count 30
    """
    from pieper.perception import scene_folder
    from pieper.perception.scene_presets import PRESETS, preset

    if show or scene is None:
        if scene is None and not show:
            raise VisionError(f"name a scene: {', '.join(PRESETS)}")
        _list(as_json)
        return 0
    made = preset(scene, _size(size))
    wanted: dict[str, Any] = {
        "frames": count, "fps": fps, "noise": noise, "exposure": exposure, "light": light, "gradient": gradient, "cast": cast,
        "shadow": shadow, "quality": quality,
    }  # fmt: skip
    made = made.but(seed=seed, **{key: value for key, value in wanted.items() if value is not None})
    folder = out or Path(scene)
    if folder.exists() and not folder.is_dir():
        raise VisionError(f"{folder} is a file, and a scene needs a folder; name another with --out")
    written = _write(made, folder, lossless=lossless, force=force)
    film = scene_folder.FRAMES if lossless else scene_folder.VIDEO
    if as_json:
        print_json({"scene": scene, "folder": str(folder), "film": film, "frames": written, "fps": made.fps})
        return 0
    say(f"wrote {folder}  {film} of {written} frames, {written / made.fps:.2f} s, and {scene_folder.TRUTH}")
    return 0


def _list(as_json: bool) -> None:
    from pieper.perception.scene_presets import PRESETS, preset

    rows: list[dict[str, Any]] = []
    for name in PRESETS:
        made = preset(name)
        spoiled = {k: v for k, v in vars(made.effects).items() if v not in (0, (1.0, 1.0), (0.0, 0.0))}
        rows.append({"scene": name, "things": len(made.things), "seconds": len(made) / made.fps, "effects": spoiled})
    if as_json:
        print_json({"scenes": rows})
        return
    cells = [
        [
            row["scene"],
            str(row["things"]),
            f"{row['seconds']:.1f}",
            ", ".join(f"{k} {_words(v)}" for k, v in row["effects"].items()),
        ]
        for row in rows
    ]
    print_table(console(), ["scene", ">things", ">seconds", "effects"], cells)


def _words(value: Any) -> str:
    return " to ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:.4g}"


def _size(text: str) -> tuple[int, int]:
    width, height = pixels(text)
    if not (16 <= width <= 8192 and 16 <= height <= 8192):
        raise VisionError(f"--size must be 16 to 8192 pixels each way, got {text!r}")
    return width, height


def _write(scene: Scene, folder: Path, *, lossless: bool, force: bool) -> int:
    from pieper.perception import scene_folder

    with progress_bar("frames") as advance:
        return scene_folder.write(scene, folder, lossless=lossless, force=force, progress=advance)
