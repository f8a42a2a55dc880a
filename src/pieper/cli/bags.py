"""``pieper ros record`` and ``pieper ros replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pieper.cli import completion
from pieper.cli.node import Backend, Domain, Network, joined, ros_arguments
from pieper.errors import RosError, unknown_name

_SPEAKING_TIME = 0.5  # seconds before the first message of a replay, in which subscribers find it


def record(
    context: typer.Context,
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="TOPIC...",
            help="/joint_states, /target and others of usual names; else with the type: /x:std_msgs/msg/String, and "
            "perhaps :latched or :sensor behind it.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Write the result; a folder named by the time by default."),
    ] = None,
    storage: Annotated[
        str,
        typer.Option("--storage", "-s", metavar="NAME", help="mcap or sqlite3.", autocompletion=completion.storages),
    ] = "mcap",
    seconds: Annotated[
        float | None, typer.Option("--seconds", metavar="SECONDS", help="How long; else until Ctrl-C.")
    ] = None,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> None:
    """Record topics in a bag.

    For example:
      pieper ros record /joint_states /target --seconds 5 --out lab1
    """
    from datetime import datetime

    from pieper.ros import bags
    from pieper.ros.topics import Topic

    if storage not in bags.STORAGES:
        raise unknown_name("storage", storage, bags.STORAGES)
    topics = [Topic.parse(name) for name in names]
    path = out or Path(datetime.now().astimezone().strftime("bag_%Y_%m_%d-%H_%M_%S"))
    with joined(
        "pieper_record", arguments=ros_arguments(context), backend=backend, network=network, domain=domain
    ) as bus:
        bus.log("info", f"recording {', '.join(topic.name for topic in topics)} in {path}; Ctrl-C ends it")
        counts = bags.record(bus, topics, path, storage=storage, seconds=seconds)
    for name, count in counts.items():
        typer.echo(f"{count:8d}  {name}")
    typer.echo(f"written: {path}")


def replay(
    context: typer.Context,
    path: Annotated[
        Path,
        typer.Argument(metavar="BAG", help="A folder of ros2 bag, an .mcap or .db3 file, or a .bag file of ROS 1."),
    ],
    topics: Annotated[
        list[str] | None, typer.Option("--topic", metavar="TOPIC", help="Only this one; may be given again.")
    ] = None,
    rate: Annotated[float, typer.Option("--rate", "-r", metavar="N", help="N times as fast.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", "-l", help="Begin again at the end.")] = False,
    delay: Annotated[
        float, typer.Option("--delay", "-d", metavar="SECONDS", help="Time before the first message.")
    ] = _SPEAKING_TIME,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> None:
    """Send the messages of a bag again, as far apart in time as they were recorded.

    For example:
      pieper ros replay lab1 --rate 10
    """
    from pieper.ros import bags

    if not path.exists():
        raise RosError(f"there is no bag at {path}")
    with joined(
        "pieper_replay", arguments=ros_arguments(context), backend=backend, network=network, domain=domain
    ) as bus:
        sent = bags.replay(bus, path, topics=topics or [], rate=rate, loop=loop, delay=delay)
    typer.echo(f"{sent} messages sent")
