"""``pieper launch``: the nodes that belong together, started together."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from pieper.cli import completion
from pieper.cli.arguments import Base, Tip, load
from pieper.cli.node import Backend, Domain, Network, endings, ros_arguments
from pieper.cli.signals import handled
from pieper.errors import PieperError

_WORDS = {"mode": "MODE", "arm": "--arm", "ur_type": "--ur-type"}


def launch(
    context: typer.Context,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="MODE NAME:=VALUE",
            help="forward, inverse or ik; then parameters for the nodes.",
            autocompletion=completion.modes,
        ),
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            metavar="ARM",
            help="A built-in robot, or a URDF, xacro or JSON file.",
            autocompletion=completion.robots,
        ),
    ] = None,
    ur_type: Annotated[
        str | None,
        typer.Option(
            "--ur-type",
            metavar="TYPE",
            help="The same as --arm: ur3 ... ur30.",
            autocompletion=completion.universal_robots,
        ),
    ] = None,
    base: Base = None,
    tip: Tip = None,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> int:
    """Start the nodes of a mode, one process each; Ctrl-C ends them.

    forward: description, controller (moves a simulated arm) and forward. inverse: description, controller and inverse.
    ik: description and ik_server. As in launch files of ROS, mode:=, arm:= and ur_type:= are understood too.

    For example:
      pieper launch inverse --arm mh12
    """
    from pieper.ros import launch as processes
    from pieper.ros.arguments import parse

    modes, settings, parameters = _sorted_words(words or [])
    mode = _one("mode", [*modes, settings.get("mode")], "pieper launch forward --arm mh12")
    name = _one("arm", [arm, ur_type, settings.get("arm"), settings.get("ur_type")], f"pieper launch {mode} --arm mh12")
    chosen = processes.find(mode)
    namespace = (parse(ros_arguments(context), node_name="launch").namespace or "").rstrip("/")
    joint = load(name, base=base, tip=tip).joint_names[
        0
    ]  # and what cannot be loaded is said once, before anything is started
    ends = [*(["--base", base] if base else []), *(["--tip", tip] if tip else [])]
    options = [*(["--backend", backend] if backend else []), *(["--network"] if network else [])]
    options += ["--domain", str(domain)] if domain is not None else []
    ros = [word for parameter in parameters for word in ("-p", parameter)]
    options += [*(["--ros-args", *ros, "--"] if ros else []), *ros_arguments(context)]

    run = processes.Launch(processes.commands(mode, name, ends=ends, options=options), _say)

    def say_what_is_next() -> None:
        for what, without_ros, with_ros in chosen.hints:
            run.say(f"to {what}:")
            for line in (without_ros, with_ros):
                run.say(f"  {line.format(joint=joint).replace(' /', f' {namespace}/')}")
        run.say("to end all: Ctrl-C")

    with handled(endings(), lambda *_: run.stop()):
        return run.run(started=say_what_is_next)


def _say(line: str) -> None:
    try:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # what is still in the buffer has to go somewhere
        raise


def _sorted_words(words: list[str]) -> tuple[list[str], dict[str, str], list[str]]:
    """Modes that were named, settings of the launch, and parameters of the nodes."""
    settings: dict[str, str] = {}
    modes, parameters = [], []
    for word in words:
        name, assigned, value = word.partition(":=")
        if not assigned:
            modes.append(word)
        elif name in _WORDS:
            settings[name] = value
        else:
            parameters.append(word)
    return modes, settings, parameters


def _one(what: str, given: list[str | None], example: str) -> str:
    named = [value for value in given if value]
    if not named:
        raise PieperError(f"name the {what}, as in: {example}")
    if len(set(named)) > 1:
        raise PieperError(f"one {what}, got {' and '.join(repr(value) for value in named)}")
    return named[0]
