"""ROS 2: a node on the robot's network, with a ROS installation or without one.

:func:`open_bus` joins the network; :mod:`pieper.ros.nodes` has the nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pieper.ros.backends import open_bus
    from pieper.ros.bus import Bus
    from pieper.ros.endpoints import Reply
    from pieper.ros.qos import QoS

__all__ = ["Bus", "QoS", "Reply", "open_bus"]

# Loaded when first used, so that `pieper ros --help` stays quick.
_HOMES = {
    "Bus": "pieper.ros.bus",
    "QoS": "pieper.ros.qos",
    "Reply": "pieper.ros.endpoints",
    "open_bus": "pieper.ros.backends",
}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'pieper.ros' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
