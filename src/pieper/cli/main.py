"""The command ``pieper``: its verbs, its exit codes, and how it speaks of errors.

Exit codes: 0 done, or target reached; 1 target not reached, the nearest answer is printed; 2 the input is at fault; 3 an
optional package is missing; 4 a fault in pieper itself; 130 interrupted.
"""

from __future__ import annotations

import json
import os
import re
import sys
import traceback
import warnings
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import (
    calibrate_arm,
    calibrate_camera,
    calibrate_field,
    calibrate_hand_eye,
    convert,
    doctor,
    evaluate,
    fk,
    ik,
    info,
    launch,
    learn_colour,
    move,
    pick,
    place,
    plan,
    plot,
    reach,
    render,
    robots,
    ros,
    synthesize,
    track,
    view,
    workspace,
)
from pieper.cli.node import RosCommand
from pieper.cli.signals import ended_by_a_signal
from pieper.cli.verb import Group, Verb
from pieper.errors import MissingExtraError, MissingLibraryError, PieperError, PieperWarning

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

DONE, NOT_REACHED, BAD_INPUT, MISSING_PACKAGE, FAULT, INTERRUPTED = 0, 1, 2, 3, 4, 130

_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-(inf|nan)", re.IGNORECASE)
_NUMBERS_WITH_COMMAS = re.compile(r"[-+0-9.eE]+(,[-+0-9.eE]+)+")
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # typer exports the child alone

app = typer.Typer(
    name="pieper",
    cls=Group,
    help="Kinematics and inverse kinematics of serial robot arms.",
    subcommand_metavar="VERB ...",
    epilog="pieper VERB --help tells more, with an example. Lengths in metres, angles in radians unless --deg is given. "
    "Exit codes: 0 done or reached, 1 not reached, 2 bad input, 3 optional package missing.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
_PARTS: dict[str, dict[ModuleType, str]] = {
    "Arms": {
        robots: "List the built-in robots.",
        info: "Joints, limits, DH rows, screws, reach of an arm.",
        fk: "Pose of the tip at given joint values.",
        ik: "Joint values that reach a target.",
        reach: "Reach a target from zero, and show the way.",
        convert: "Write an arm as DH rows, screws, URDF, formulas.",
    },
    "Motion": {
        move: "A motion within limits, into a file.",
        plan: "A motion around obstacles.",
        pick: "Pick things and place them in a bin, by physics.",
    },
    "Space": {
        workspace: "Where an arm reaches, and how well.",
        place: "Where to put the base, or which arm to take.",
    },
    "Show": {
        view: "Open an arm in the browser.",
        render: "Draw an arm, or a film of its motion.",
        plot: "Figures of paths, joints, errors and models.",
    },
    "Camera": {
        learn_colour: "Colours, from boxes on frames of a video.",
        track: "Follow coloured markers in a video or camera.",
        synthesize: "A film of robots with markers, with exact truth.",
        evaluate: "Tracks against the truth.",
    },
    "Measure": {
        calibrate_camera: "A lens, from pictures of a printed board.",
        calibrate_field: "Where the field lies before a camera.",
        calibrate_hand_eye: "Where a camera is on a robot.",
        calibrate_arm: "The axes of an arm, from measured tips.",
    },
    "ROS 2": {
        ros: "Nodes, topics and services, without or with ROS.",
        launch: "Start several nodes together.",
    },
    "Here": {
        doctor: "What works here, and what to do about gaps.",
    },
}
for _part, _verbs in _PARTS.items():
    for _module, _summary in _verbs.items():
        _name = _module.__name__.rpartition(".")[2]
        _words: dict[str, Any] = {"name": _name.replace("_", "-"), "short_help": _summary, "rich_help_panel": _part}
        if _module in (plot, ros):
            app.add_typer(_module.app, **_words)
        else:
            app.command(cls=RosCommand if _module is launch else Verb, **_words)(getattr(_module, _name))
app.command("learn-color", cls=Verb, hidden=True)(learn_colour.learn_colour)


def _print_version(wanted: bool) -> None:
    if wanted:
        from pieper._version import __version__

        typer.echo(f"pieper {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command with these arguments, those of the process by default.

    Returns
    -------
    int
        The exit code.

    Examples
    --------
    >>> main(["--version"])
    pieper ...
    0
    """
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    finally:
        _give_up_a_log_that_cannot_be_written()


def _give_up_a_log_that_cannot_be_written() -> None:
    """What is left in the buffer of standard error would fail once more when Python ends, and change the exit code."""
    try:
        sys.stderr.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def _run(typed: list[str]) -> int:
    # A leading space keeps a negative number from being taken for an option; float() does not mind it.
    words = [" " + word if _NEGATIVE_NUMBER.fullmatch(word) else word for word in typed]
    complain = _complain_in_json if "--json" in words else _complain
    with warnings.catch_warnings(), ended_by_a_signal():
        warnings.simplefilter("always", PieperWarning)
        warnings.showwarning = _warnings_once()
        try:
            code = int(app(words, prog_name="pieper", standalone_mode=False) or DONE)
            if code == INTERRUPTED:  # typer makes it of Ctrl-C, and is silent
                return complain("Interrupted", "interrupted", code)
            return code
        except BrokenPipeError:  # the reader of a pipe has seen enough, as `| head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return DONE
        except Exception as error:  # noqa: BLE001  a script must not take a crash for "not reached"
            return complain(type(error).__name__, *_what_is_wrong(error, words))
        except KeyboardInterrupt:
            return complain("Interrupted", "interrupted", INTERRUPTED)


def _what_is_wrong(error: Exception, words: Sequence[str]) -> tuple[str, int]:
    """An error in a sentence, and the exit code; `words` is what was typed."""
    if isinstance(error, typer.Abort):
        return "interrupted", INTERRUPTED
    if isinstance(error, _UsageError):
        return _usage(error, words), BAD_INPUT
    if isinstance(error, MissingExtraError | MissingLibraryError):
        return str(error), MISSING_PACKAGE
    if isinstance(error, UnicodeEncodeError):
        odd = error.object[error.start : error.end]
        return f"the output is {error.encoding}, which cannot show {odd!r}; set PYTHONIOENCODING=utf-8", BAD_INPUT
    if isinstance(error, PieperError | OSError):
        return _sentence(error), BAD_INPUT
    traceback.print_exception(error)
    return "this is a fault in pieper; please report it with the lines above", FAULT


def _usage(error: Exception, words: Sequence[str]) -> str:
    """What is wrong with the arguments, and where to look."""
    context = getattr(error, "ctx", None)
    command = "pieper VERB" if context is None or context.parent is None else context.command_path
    text = str(getattr(error, "format_message", lambda: error)()).strip()
    text = text.replace(": Value error, ", ": ").replace(": Input should be ", ": it must be ")
    commas = next((word for word in words if _NUMBERS_WITH_COMMAS.fullmatch(word)), None)
    if commas is not None and "valid number" in text:
        text = f"{text.partition(':')[0]}: numbers stand apart here, as in {' '.join(commas.split(','))}, got {commas}"
    elif "No such option: --target" in text and command in ("pieper ik", "pieper reach"):
        text = "No such option: --target; the target stands behind the arm, as X Y Z"
    return f"{text.rstrip('.')}; see: {command} --help"


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error)


def _complain(_: str, sentence: str, code: int) -> int:
    typer.secho(f"pieper: {' '.join(sentence.split())}", err=True, fg=typer.colors.RED)
    return code


def _complain_in_json(kind: str, sentence: str, code: int) -> int:
    """The same in one line for a script, which is the last one on standard error."""
    error = {"error": " ".join(sentence.split()), "kind": kind, "exit_code": code}
    typer.echo(json.dumps(error, ensure_ascii=False), err=True)
    return code


def _warnings_once() -> Callable[..., None]:
    """What shows a warning; the same words, of a mesh that is drawn by many links and ghosts, only once."""
    told: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        if str(message) not in told:
            told.add(str(message))
            typer.secho(f"pieper: {message}", err=True, fg=typer.colors.YELLOW)

    return show
