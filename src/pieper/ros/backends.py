"""Which network a node is on: rclpy, bare DDS, or a fake one."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import TYPE_CHECKING

from pieper.errors import RosError
from pieper.ros.arguments import parse
from pieper.ros.bus import Bus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.ros.wire import Wire

BACKENDS = ("rclpy", "bare")


def choose_backend(backend: str | None = None) -> str:
    """Return the backend that :func:`open_bus` takes, ``"rclpy"`` or ``"bare"``.

    An explicit choice comes first, then the environment's ``PIEPER_ROS_BACKEND``; otherwise it is rclpy where that can
    be imported, and bare DDS where not.

    Raises
    ------
    RosError
        There is no backend of that name.
    """
    chosen = backend or os.environ.get("PIEPER_ROS_BACKEND") or ("rclpy" if find_spec("rclpy") else "bare")
    if chosen not in BACKENDS:
        raise RosError(f"no ROS backend {chosen!r}; backends are: {', '.join(BACKENDS)}")
    return chosen


def open_bus(
    node: str,
    *,
    arguments: Sequence[str] = (),
    backend: str | None = None,
    network: bool = False,
    domain: int | None = None,
) -> Bus:
    """Join the network as a node.

    Parameters
    ----------
    node : str
        Name of the node, unless the arguments rename it.
    arguments : sequence of str
        Command-line arguments of ROS: ``["--ros-args", "-r", "target:=goal", "-p", "rate:=100.0"]``.
    backend : str, optional
        See `choose_backend`.
    network : bool
        Bare backend: whether other machines may take part. They are not asked who they are, so the default is this
        machine alone. The rclpy backend follows the settings of its ROS (``ROS_AUTOMATIC_DISCOVERY_RANGE``).
    domain : int, optional
        DDS domain, 0 to 232; by default the environment's ``ROS_DOMAIN_ID``, or 0.

    Returns
    -------
    Bus
        The node; its first line of log names the backend.

    Raises
    ------
    RosError
        A name, an argument or a network setting is not what it has to be.
    MissingExtraError
        The packages that the bare backend needs are not installed.
    MissingLibraryError
        rclpy is wanted and cannot be imported.
    """
    parsed = parse(list(arguments), node_name=node)
    name, namespace = parsed.node or node, parsed.namespace or "/"
    chosen = choose_backend(backend)
    wire: Wire
    if chosen == "rclpy":
        from pieper.ros.rcl import RclWire

        number = os.environ.get("ROS_DOMAIN_ID", "0") if domain is None else domain
        wire, where = RclWire(name, namespace=namespace, domain=domain), f"domain {number}"
    else:
        from pieper.ros.bare import DdsWire

        dds = DdsWire(name, namespace=namespace, domain=domain, network=network)
        wire, where = dds, f"domain {dds.domain}, {'this machine and its network' if network else 'this machine alone'}"
    bus = Bus(wire, node=name, arguments=parsed, backend=chosen)
    bus.log("info", f"on the ROS 2 network by {chosen} ({where})")
    if network and chosen == "bare":
        bus.log("warn", "open to the network: DDS has no authentication, so anyone there can command this node")
    return bus
