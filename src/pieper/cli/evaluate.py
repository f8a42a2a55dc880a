"""``pieper evaluate``: tracks against the truth, or everything against what it must reach."""

from __future__ import annotations

from math import isnan, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pieper.cli.arguments import Json
from pieper.cli.show import console, print_json, print_table
from pieper.errors import VisionError

if TYPE_CHECKING:
    from pieper.perception.evaluate import Evaluation
    from pieper.perception.metrics import Consistency, Spread
    from pieper.perception.pass_marks import Mark


def evaluate(
    tracks: Annotated[
        Path | None, typer.Argument(metavar="TRACKS", help="Tracks as .csv, .jsonl or .parquet, from pieper track.")
    ] = None,
    truth: Annotated[Path | None, typer.Argument(metavar="TRUTH", help="truth.jsonl, from pieper synthesize.")] = None,
    reach: Annotated[
        float | None,
        typer.Option("--reach", metavar="D", help="How near an estimate has to be; 0.05 m, or 15 px, by default."),
    ] = None,
    every: Annotated[
        bool,
        typer.Option("--marks", help="Instead: draw all scenes, track them, and compare with what must be reached."),
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="With --marks: shorter scenes, for a first look.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Write the result; with --marks, everything as JSON."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Print how far tracks are from the truth: errors, detection, identity and consistency.

    With --marks, exit code 1 says that a mark was missed.

    For example:
      pieper evaluate tracks.csv clean/truth.jsonl
    """
    if every:
        if tracks is not None:
            raise VisionError("--marks draws its own scenes; leave the files out")
        return _all(quick, out, as_json)
    if tracks is None or truth is None:
        raise VisionError("evaluate needs TRACKS and TRUTH, or --marks")
    from pieper.perception import truth as truths
    from pieper.perception.evaluate import evaluate as compare
    from pieper.perception.output import read_tracks

    result = compare(truths.read(truth), read_tracks(tracks), reach=reach)
    if as_json:
        print_json(result.as_data())
    else:
        _table(result)
    return 0


def _table(result: Evaluation) -> None:
    long, factor = ("mm", 1e3) if result.unit == "m" else ("px", 1.0)
    screen = console()
    errors = (
        ("position, seen", result.position, long, factor),
        ("position, hidden", result.hidden, long, factor),
        ("heading, seen", result.heading, "deg", 180 / pi),
        ("velocity, seen", result.velocity, long + "/s", factor),
    )
    rows = [[f"{name} [{unit}]", *_spread(row, scale)] for name, row, unit, scale in errors]
    print_table(screen, ["error", ">RMS", ">95 %", ">largest", ">count"], rows)
    screen.print()
    c, same, both = result.clear, result.identity, result.hota
    figures: list[tuple[str, float | str]] = [
        ("precision", c.precision),
        ("recall", c.recall),
        ("MOTA", c.mota),
        ("identity switches", str(c.switches)),
        ("IDF1", same.idf1),
        ("HOTA", both.hota),
        ("  detection", both.detection),
        ("  association", both.association),
        ("right names", result.named),
        ("NEES of places", _consistency(result.nees)),
        ("NEES of headings", _consistency(result.heading_nees)),
        ("frames", f"{result.frames}, {result.frames_without} of them not in the tracks"),
        ("a match is within", f"{result.reach * factor:g} {long}"),
    ]
    figures += [(f"{stage} [ms]", ms) for stage, ms in result.milliseconds.items()]
    told = [[name, value if isinstance(value, str) else _share(value)] for name, value in figures]
    print_table(screen, ["figure", "value"], told)


def _share(value: float) -> str:
    return "-" if isnan(value) else f"{value:.4f}"


def _spread(row: Spread, scale: float) -> list[str]:
    if not row.count:
        return ["-", "-", "-", "0"]
    return [f"{value * scale:.3f}" for value in (row.rms, row.p95, row.largest)] + [str(row.count)]


def _consistency(row: Consistency) -> str:
    return f"{row.inside:.1%} inside the 95 % band; mean over degrees of freedom {row.mean:.2f}" if row.count else "-"


def _all(quick: bool, out: Path | None, as_json: bool) -> int:
    from rich.console import Console

    from pieper.atomic_file import write_text
    from pieper.perception import pass_marks

    screen = Console(stderr=True)

    def begin(title: str) -> None:
        screen.print(f"-- {title}", markup=False, highlight=False)

    marks = pass_marks.measure(quick=quick, begin=begin)
    if out is not None:
        import json

        write_text(out, json.dumps(pass_marks.as_data(marks), indent=1) + "\n")
    if as_json:
        print_json({"marks": pass_marks.as_data(marks)})
    else:
        _marks(marks)
    return 0 if all(mark.reached for mark in marks) else 1


def _marks(marks: list[Mark]) -> None:
    rows = [[m.what, m.shown(m.report), m.shown(m.ours), m.must, "reached" if m.reached else "MISSED"] for m in marks]
    print_table(console(), ["what", ">report", ">pieper", "must", ""], rows)
