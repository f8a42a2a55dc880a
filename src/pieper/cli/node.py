"""How the verbs of ROS join a network: ``--ros-args``, shared options, and the signals that end them."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.signals import handled
from pieper.cli.verb import Verb

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pieper.ros.bus import Bus

_ROS_ARGUMENTS = "pieper.ros_arguments"
_LOOK = 1.0  # seconds between looks at whether the launch is still there

Backend = Annotated[
    str | None,
    typer.Option(
        "--backend",
        metavar="NAME",
        help="rclpy or bare; by itself rclpy where it is installed.",
        autocompletion=completion.backends,
    ),
]
Network = Annotated[
    bool, typer.Option("--network", help="Bare backend: open to other machines. DDS asks nobody who they are.")
]
Domain = Annotated[
    int | None, typer.Option("--domain", metavar="N", help="DDS domain; by itself $ROS_DOMAIN_ID, or 0.")
]


class RosCommand(Verb):
    """A verb that leaves what stands between ``--ros-args`` and ``--`` to ROS."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the ROS arguments out, and parse the others."""
        ours, ctx.meta[_ROS_ARGUMENTS] = split(args)
        return super().parse_args(ctx, ours)


def split(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words that are not for ROS, and those that are.

    Examples
    --------
    >>> split("mh12 --ros-args -r target:=goal -- --domain 3".split())
    (['mh12', '--domain', '3'], ['--ros-args', '-r', 'target:=goal', '--'])
    """
    ours: list[str] = []
    ros: list[str] = []
    inside = False
    for word in words:
        starts, ends = word == "--ros-args", inside and word == "--"
        (ros if inside or starts else ours).append(word)
        inside = (inside or starts) and not ends
    return ours, ros


def ros_arguments(context: typer.Context) -> list[str]:
    """What stood between ``--ros-args`` and ``--``."""
    return list(context.meta.get(_ROS_ARGUMENTS, ()))


def endings() -> tuple[signal.Signals, ...]:
    """The signals that ask for the end: SIGINT, SIGTERM, and SIGHUP of a terminal that closes, unless nohup has it ignored."""
    hangup = getattr(signal, "SIGHUP", None)
    heard = hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *((hangup,) if heard else ()))


class Ending:
    """What the signals of :func:`endings` do while :func:`ending` holds: end the process, or the spin of a bus, with exit code 0."""

    def __init__(self) -> None:
        self.asked = False
        self._bus: Bus | None = None

    def watch(self, bus: Bus) -> None:
        """From now on, stop this bus."""
        self._bus = bus

    def __call__(self, *_: object) -> None:
        """Handle a signal; a second one finds nothing more to do."""
        if self.asked:
            return
        self.asked = True
        if self._bus is None:
            raise SystemExit(0)
        self._bus.stop()


@contextmanager
def ending() -> Iterator[Ending]:
    """Take the signals of :func:`endings` for a wish to end, and not for a failure."""
    handler = Ending()
    with handled(endings(), handler):
        yield handler


@contextmanager
def joined(
    node: str,
    *,
    arguments: Sequence[str] = (),
    backend: str | None,
    network: bool,
    domain: int | None,
) -> Iterator[Bus]:
    """A bus that signals stop; a node of that name on the network."""
    from pieper.ros import open_bus

    with (
        ending() as handler,
        open_bus(node, arguments=arguments, backend=backend, network=network, domain=domain) as bus,
    ):
        handler.watch(bus)
        with _as_long_as_the_launch(bus):
            yield bus


@contextmanager
def _as_long_as_the_launch(bus: Bus) -> Iterator[None]:
    """Stop a node that a launch started when that is gone, be it killed: nobody would end it, or its arm."""
    from pieper.ros.launch import PARENT

    launch = os.environ.get(PARENT)
    left = threading.Event()

    def watch() -> None:
        while not left.wait(_LOOK):
            if str(os.getppid()) != launch:
                bus.stop()
                return

    if launch:
        threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        left.set()
