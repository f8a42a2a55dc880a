"""``pieper ros``: the nodes, and what one wants to do to them without a ROS installation."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import bags, completion, topics, tracker
from pieper.cli.arguments import Base, Nominal, Tip, load
from pieper.cli.node import Backend, Domain, Network, RosCommand, joined, ros_arguments
from pieper.cli.verb import Group, Verb
from pieper.errors import PieperError, RosError, unknown_name
from pieper.ros.nodes import NODES

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.arm import Arm
    from pieper.ros.bus import Bus
    from pieper.ros.nodes import Entry

_TOPIC = "topic:"
_TAKES = {"nothing": "", "video": " VIDEO"}

Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="ARM NAME:=VALUE",
        help="A built-in robot, a URDF, xacro or JSON file, or topic:/robot_description; then parameters of the node.",
        autocompletion=completion.robots,
    ),
]


class _Nodes(Group):
    thing = "node"


app = typer.Typer(
    cls=_Nodes,
    rich_markup_mode=None,
    subcommand_metavar="NODE ...",
    help="Nodes on the robot's network, with a ROS 2 installation or without one.",
    epilog="ROS arguments come last: --ros-args -r target:=goal -p rate:=50.0 -r __ns:=/cell2. Ctrl-C ends a node; its exit "
    "code is 0 then.",
)


def _verb(entry: Entry) -> Callable[..., None]:
    def run(
        context: typer.Context,
        words: Words = None,
        base: Base = None,
        tip: Tip = None,
        nominal: Nominal = False,
        backend: Backend = None,
        network: Network = False,
        domain: Domain = None,
    ) -> None:
        arm_name, parameters = _sorted_words(entry, words or [])
        if entry.needs in ("simulator", "robot"):
            from pieper.ros.nodes.joint_states import WHOLE_ROBOTS

            arm_name = WHOLE_ROBOTS.get(arm_name, arm_name)
        given = [word for parameter in parameters for word in ("-p", parameter)]
        arguments = [*(["--ros-args", *given, "--"] if given else []), *ros_arguments(context)]

        from_topic = arm_name.startswith(_TOPIC)
        arm = load(arm_name, base=base, tip=tip, nominal=nominal) if arm_name and not from_topic else None
        joining: dict[str, Any] = {"arguments": arguments, "backend": backend, "network": network, "domain": domain}
        with joined(_node_name(entry, arm), **joining) as bus:
            if entry.needs == "robot":
                entry.load()(bus, arm if arm_name.endswith(".json") or base or tip else arm_name or None)
            else:
                _start(entry, bus, arm or _arm_from_topic(bus, arm_name, base=base, tip=tip))
            _check_declared(entry, bus, parameters)
            bus.spin()

    run.__doc__ = (
        f"{entry.summary}\n\nFor example:\n  pieper ros {entry.name}{'' if entry.needs == 'nothing' else ' mh12'}"
    )
    return run


def _arm_from_topic(bus: Bus, name: str, *, base: str | None, tip: str | None) -> Arm | None:
    if not name:
        return None
    from pieper.ros.nodes.description import arm_from_topic

    try:
        return arm_from_topic(bus, topic=name.removeprefix(_TOPIC) or "robot_description", base=base, tip=tip)
    except RosError:
        if bus.ok:
            raise
        raise typer.Exit from None  # it was ended while it waited


def _start(entry: Entry, bus: Bus, arm: Arm | None) -> object:
    """Make the node; it lives as long as the callbacks that the bus has of it."""
    kind = entry.load()
    if arm is None:
        return kind(bus)
    if entry.needs == "simulator":
        from pieper.sim.kinematic import KinematicSimulator

        return kind(bus, KinematicSimulator(arm.chain))
    return kind(bus, arm)


def _node_name(entry: Entry, arm: Arm | None) -> str:
    """The name of the node, which the source reports give for their arms."""
    name = getattr(import_module(entry.module), "node_name", None)
    return entry.name if name is None or arm is None else str(name(arm))


def _sorted_words(entry: Entry, words: list[str]) -> tuple[str, list[str]]:
    """The arm that was named, and the parameters."""
    parameters = [word for word in words if ":=" in word]
    others = [word for word in words if ":=" not in word]
    if entry.needs == "nothing":
        if others:
            raise PieperError(f"pieper ros {entry.name} takes no arm, and parameters as name:=value; got {others[0]!r}")
        return "", parameters
    if not others and entry.needs == "robot":
        return "", parameters
    if not others:
        raise PieperError(f"name the arm: pieper ros {entry.name} mh12 (see pieper robots), or a URDF file")
    if entry.needs == "robot" and others[0].startswith(_TOPIC):
        raise PieperError(f"pieper ros {entry.name} without an arm passes on what it hears on robot_description")
    if len(others) > 1:
        raise PieperError(f"one arm, then parameters as name:=value; got {others[1]!r} behind the arm {others[0]!r}")
    return others[0], parameters


def _check_declared(entry: Entry, bus: Bus, parameters: list[str]) -> None:
    for parameter in parameters:
        name = parameter.partition(":=")[0].rpartition(":")[2]
        if name not in bus.parameters:
            raise unknown_name("parameter", name, sorted(bus.parameters), f"node {entry.name!r}")


def _list() -> None:
    """List the nodes.

    For example:
      pieper ros list
    """
    from pieper.cli.show import console, print_table

    print_table(
        console(),
        ["node", "what it does", "start it with"],
        [
            [entry.name, entry.summary, f"pieper ros {entry.name}{_TAKES.get(entry.needs, ' ARM')}"]
            for entry in NODES.values()
        ],
    )


for _entry in NODES.values():
    _run = tracker.tracker if _entry.needs == "video" else _verb(_entry)
    app.command(_entry.name, cls=RosCommand, short_help=_entry.summary, rich_help_panel="Nodes")(_run)
app.command("list", cls=Verb, short_help="List the nodes.", rich_help_panel="Nodes")(_list)
app.command("pub", cls=RosCommand, short_help="Send a message to a topic.", rich_help_panel="Topics")(topics.pub)
app.command("echo", cls=RosCommand, short_help="Print the messages of a topic.", rich_help_panel="Topics")(topics.echo)
app.command("call", cls=RosCommand, short_help="Call a service.", rich_help_panel="Services")(topics.call)
app.command("record", cls=RosCommand, short_help="Record topics in a bag.", rich_help_panel="Bags")(bags.record)
app.command("replay", cls=RosCommand, short_help="Send the messages of a bag again.", rich_help_panel="Bags")(
    bags.replay
)
