"""The nodes, by the names that the command line and the ROS package give them.

A node is a class that is made on a :class:`~pieper.ros.bus.Bus`; it works while the bus is spun. Modules are imported when a
node is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from pieper.errors import unknown_name


@dataclass(frozen=True)
class Entry:
    """A node in the list of nodes.

    Attributes
    ----------
    name : str
        Of the node on the network, unless it is renamed, and of its verb.
    summary : str
        What it does, on one line.
    module, kind : str
        Where its class is, and its name.
    needs : str
        What the class takes beside the bus: ``"nothing"``, ``"arm"``, a ``"simulator"`` of the arm, or ``"robot"``: what an
        arm is loaded from, if anything, ``"video"``: a tracker of what a camera shows, which hands over what it finds.
    """

    name: str
    summary: str
    module: str
    kind: str
    needs: str

    def load(self) -> Any:
        """Import the class."""
        return getattr(import_module(self.module), self.kind)


NODES = {
    entry.name: entry
    for entry in (
        Entry("forward", "Joint states in, pose and frames out.", "pieper.ros.nodes.forward", "Forward", "arm"),
        Entry("inverse", "Targets in, joint states out.", "pieper.ros.nodes.inverse", "Inverse", "arm"),
        Entry("description", "The robot description, latched.", "pieper.ros.nodes.description", "Description", "robot"),
        Entry("controller", "Moves a simulated arm.", "pieper.ros.nodes.controller", "Controller", "simulator"),
        Entry("ik_server", "Inverse kinematics as services.", "pieper.ros.nodes.ik_server", "IkServer", "arm"),
        Entry("rotations", "Quaternion conversions as services.", "pieper.ros.nodes.rotations", "Rotations", "nothing"),
        Entry("tracker", "Robots and balls that a camera sees.", "pieper.ros.nodes.tracker", "Tracker", "video"),
    )
}


def find(name: str) -> Entry:
    """Return the entry of a node.

    Raises
    ------
    UnknownNameError
        There is no such node.

    Examples
    --------
    >>> find("inverse").summary
    'Targets in, joint states out.'
    >>> find("screws")
    Traceback (most recent call last):
    ...
    pieper.errors.UnknownNameError: no node 'screws'; nodes are: forward, inverse, ...
    """
    try:
        return NODES[name]
    except KeyError:
        raise unknown_name("node", name, NODES) from None
