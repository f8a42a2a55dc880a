"""``pieper learn-colour``: colour models from regions on chosen frames of a video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.outputs import keep_apart
from pieper.errors import PieperError, VisionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pieper.perception.color_learning import Learned
    from pieper.perception.color_regions import Region


def learn_colour(
    video: Annotated[Path, typer.Argument(metavar="VIDEO", help="A video file, or a folder of images.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Write the result; the colours, .yaml.")
    ] = Path("colors.yaml"),
    color: Annotated[
        list[str] | None,
        typer.Option(
            "--color", metavar="NAME[=DRAW]", help="A colour, drawn in #rrggbb or a word; once for each colour."
        ),
    ] = None,
    roi: Annotated[
        list[str] | None,
        typer.Option(
            "--roi",
            metavar="[NAME:]FRAME,X,Y,W,H",
            help="A box that shows a colour; several for a colour are several captures. Without a name they go to the "
            "colours in their order, --captures to each.",
        ),
    ] = None,
    rois: Annotated[Path | None, typer.Option("--rois", metavar="FILE", help="Boxes in a YAML or CSV file.")] = None,
    captures: Annotated[
        int | None, typer.Option("--captures", metavar="N", min=1, help="Boxes that each colour has to have.")
    ] = None,
    pick: Annotated[bool, typer.Option("--pick", help="Drag the boxes in a page in the browser.")] = False,
    port: Annotated[
        int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port of the page; with --pick, 0 for any.")
    ] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser; with --pick.")] = True,
    save_rois: Annotated[
        Path | None, typer.Option("--save-rois", metavar="FILE", help="Write the boxes as YAML, for --rois.")
    ] = None,
    space: Annotated[
        str,
        typer.Option(
            "--space",
            metavar="SPACE",
            help="log-chroma, which follows the light, or hsv.",
            autocompletion=completion.spaces,
        ),
    ] = "log-chroma",
    threshold: Annotated[
        float, typer.Option("--threshold", metavar="D", help="Mahalanobis distance (not squared) of a colour's pixels.")
    ] = 4.0,
    light: Annotated[
        float,
        typer.Option(
            "--light-sigma",
            metavar="SIGMA",
            help="Standard deviation of the light that is allowed for, as a logarithm.",
        ),
    ] = 0.35,
    background: Annotated[
        int, typer.Option("--background", metavar="N", min=0, max=64, help="Gaussians of the background.")
    ] = 12,
    also: Annotated[
        list[int] | None, typer.Option("--also", metavar="FRAME", help="A frame that shows more of the background.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE", help="Draw a picture; of a frame and of what is found in it, .png."),
    ] = None,
) -> int:
    """Learn colours from boxes on frames of a video, and test them.

    For example:
      pieper learn-colour clean/video.mp4 --rois clean/regions.yaml
    """
    from pieper.perception.color_learning import learn
    from pieper.perception.color_regions import read_regions, regions_as_data
    from pieper.perception.opencv import quiet
    from pieper.perception.source import probe, read_frames
    from pieper.yaml_file import write_yaml

    quiet()
    if picture is not None and picture.suffix.lower() != ".png":
        raise VisionError(f"--picture must end in .png, got {str(picture)!r}")
    keep_apart([video], {"--out": out, "--save-rois": save_rois, "--picture": picture})
    keep_apart([rois], {"--out": out, "--picture": picture})  # boxes that were corrected may replace those before
    names, draw = _named(color or [])
    info = probe(video)
    regions = _typed(roi or [], names, captures)
    if rois is not None:
        more, drawn = read_regions(rois)
        regions += more
        draw = {**drawn, **draw}
    if pick:
        regions = _picked(video, names or list(dict.fromkeys(r.color for r in regions)), regions, port, browser)
    regions = _in_order(regions, names, captures)
    numbers = list(dict.fromkeys([*(r.frame for r in regions), *(also or [])]))
    if not regions:
        raise PieperError("no boxes are given; give --roi NAME:FRAME,X,Y,W,H, or --rois FILE, or --pick")
    frames = {frame.index: frame.image for frame in read_frames(video, numbers)}
    learned = learn(
        frames.__getitem__,
        regions,
        draw=draw,
        space=space,
        threshold=threshold,
        light=light,
        background=background,
        more_frames=also or [],
        source={"source": video.name, "size": list(info.size) if info.size else None},
    )
    if save_rois is not None:
        write_yaml(save_rois, regions_as_data(regions), comment="Boxes as frame, x, y, width, height.")
    learned.model.save(out)
    _tell(learned)
    if picture is not None:
        _picture(picture, frames[regions[0].frame], learned)
        typer.echo(f"wrote {picture}", err=True)
    typer.echo(f"wrote {out}", err=True)
    return 0


def _named(words: list[str]) -> tuple[list[str], dict[str, tuple[int, int, int]]]:
    """The colours of the command line in their order, and how they are drawn where that was said."""
    from pieper.perception.drawn_color import draw_color

    names: list[str] = []
    draw = {}
    for word in words:
        name, equals, how = word.partition("=")
        if not name.strip() or name in names:
            raise PieperError(f"--color needs a name that was not there before, got {word!r}")
        names.append(name)
        if equals:
            draw[name] = draw_color(how)
    return names, draw


def _typed(words: list[str], names: list[str], captures: int | None) -> list[Region]:
    """Regions of the command line; those without a name go to the colours in their order."""
    from dataclasses import replace

    from pieper.perception.color_regions import parse_region

    regions = [parse_region(word, "") for word in words]
    bare = [i for i, region in enumerate(regions) if not region.color]
    if not bare:
        return regions
    if not names:
        raise VisionError(f"whose colour is the region {words[bare[0]]!r}? write name:frame,x,y,w,h, or give --color")
    each = captures or 1
    if len(names) == 1 and captures is None:
        each = len(bare)
    if len(bare) != each * len(names):
        raise VisionError(
            f"{len(names)} colours with {each} captures each need {each * len(names)} regions without a name, "
            f"got {len(bare)}"
        )
    for place, i in enumerate(bare):
        regions[i] = replace(regions[i], color=names[place // each])
    return regions


def _in_order(regions: list[Region], names: list[str], captures: int | None) -> list[Region]:
    """Regions in the order of the colours that were named, each with as many as it has to have."""
    from pieper.errors import unknown_name

    if names:
        for region in regions:
            if region.color not in names:
                raise unknown_name("colour", region.color, names, "--color")
        regions = sorted(regions, key=lambda region: names.index(region.color))
    for name in names or dict.fromkeys(region.color for region in regions):
        count = sum(region.color == name for region in regions)
        if count == 0 or (captures is not None and count != captures):
            wanted = f"{captures} captures" if captures is not None else "one capture at least"
            raise VisionError(f"colour {name!r} needs {wanted}, got {count}")
    return regions


def _picked(video: Path, names: list[str], regions: list[Region], port: int, browser: bool) -> list[Region]:
    import webbrowser

    from pieper.perception.color_page import ColorPage

    with ColorPage(video, names=names, regions=regions, port=port) as page:
        typer.echo(f"drag a box for each colour, then press Done: {page.url}", err=True)
        if browser:
            webbrowser.open(page.url)
        return page.wait()


def _tell(learned: Learned) -> None:
    from pieper.perception.color_learning import hsv_of

    model = learned.model
    for name in model.names:
        group = [c for c in learned.captures if c.region.color == name]
        for i, capture in enumerate(group, start=1):
            typer.echo(
                f"{name}, capture {i} of {len(group)}: frame {capture.region.frame}, box {capture.region.box}, "
                f"{len(capture.pixels)} pixels ({capture.share:.0%})"
            )
            _tell_hsv(capture.hsv_mean, capture.hsv_covariance)
        if len(group) > 1:
            typer.echo(f"{name}, {len(group)} captures together, within and between")
            _tell_hsv(*hsv_of(group))
    typer.echo(
        f"threshold: Mahalanobis distance {model.threshold:g}, within which {model.share_inside:.2%} "
        f"of the pixels of a Gaussian colour lie ({model.space})"
    )
    report: dict[str, Any] = dict(model.notes["validation"])
    wide = max(len(name) for name in ("colour", *model.names)) + 1
    columns = ("none", *model.names)
    typer.echo("what the pixels of each colour are taken for [%]")
    typer.echo("colour".ljust(wide) + "".join(c.rjust(max(len(c), 5) + 1) for c in columns) + "  held out")
    for name in model.names:
        row = report["confusion"][name]
        held = report["held_out"].get(name)
        shares = "".join(f"{100 * row[c]:.1f}".rjust(max(len(c), 5) + 1) for c in columns)
        typer.echo(f"{name.ljust(wide)}{shares}  {'-' if held is None else f'{100 * held:.1f}'}")
    typer.echo("share of each frame that each colour explains [%]")
    for number, row in report["explained"].items():
        typer.echo(f"frame {number}: " + ", ".join(f"{name} {100 * share:.2f}" for name, share in row.items()))
    for remark in learned.remarks:
        typer.secho(f"note: {remark}", fg=typer.colors.YELLOW)


def _tell_hsv(mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
    typer.echo("  Media HSV: [" + " ".join(f"{x:.2f}" for x in mean) + "]")
    for i, row in enumerate(covariance):
        head = "  Covarianza HSV: [" if i == 0 else " " * 19
        tail = "]]" if i == 2 else "]"
        typer.echo(head + "[" + " ".join(f"{x:9.2f}" for x in row) + tail)


def _picture(path: Path, image: NDArray[np.uint8], learned: Learned) -> None:
    from pieper.atomic_file import write_bytes
    from pieper.perception.color_learning import classified
    from pieper.perception.opencv import opencv

    good, raw = opencv("a preview").imencode(".png", classified(image, learned.model))
    if not good:
        raise VisionError(f"{path}: the picture cannot be written")
    write_bytes(path, raw.tobytes())
