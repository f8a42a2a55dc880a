"""Joint states by name: from ``sensor_msgs/msg/JointState`` to the joint vector of an arm, and back.

The order of the names in a message means nothing, and other joints (of a gripper, say) may be among them. Without any
names the positions are taken in the order of the robot's joints, and only if there are as many.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import RosError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"

# What the report on the MH12 says about messages that it cannot use.
MALFORMED = "Mensaje JointState sin campos name/position válidos"
NOT_ENOUGH = "JointState no contiene suficientes posiciones y no se encontraron nombres esperados"

# The five screws of that report: the robot's joint 5 turns the other way round, and its joint 4, before it, is held at 0.
_TURNED = {"joint_5_b_inverted": "joint_5_b"}
_HELD_BEFORE = {"joint_5_b_inverted": "joint_4_r"}

WHOLE_ROBOTS = {"mh12-report": "mh12"}
"""Arms that are a model of some joints of a robot, and the robot that moves and has links: what a controller or a description is of."""


def on_network(joint: str) -> tuple[str, float]:
    """Name of a joint on the network and the sign of its value there.

    >>> on_network("joint_3_u"), on_network("joint_5_b_inverted")
    (('joint_3_u', 1.0), ('joint_5_b', -1.0))
    """
    return (_TURNED[joint], -1.0) if joint in _TURNED else (joint, 1.0)


class JointStates:
    """The joints of an arm as joint states name them.

    Parameters
    ----------
    chain : Chain
        The arm. That of ``mh12-report``, which has five joints, is written as the six of the robot.

    Attributes
    ----------
    names : tuple of str
        Joints in the messages that are written: those of the chain, in its order.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> from pieper.ros import messages
    >>> joints = JointStates(catalog.describe("mh12-report").chain())
    >>> joints.write([0.1, 0.2, 0.3, 0.4, 0.5])
    [0.1, 0.2, 0.3, 0.0, -0.4, 0.5]
    >>> joints.read(messages.make(JOINT_STATE, name=list(joints.names), position=[1, 2, 3, 0, -4, 5])).tolist()
    [1.0, 2.0, 3.0, 4.0, 5.0]
    """

    def __init__(self, chain: Chain) -> None:
        self._wanted = [on_network(name)[0] for name in chain.joint_names]
        self._signs = np.array([on_network(name)[1] for name in chain.joint_names])
        self._same_signs = bool((self._signs == 1.0).all())
        names: list[str] = []
        places: list[int] = []
        for own, name in zip(chain.joint_names, self._wanted, strict=True):
            if own in _HELD_BEFORE:
                names.append(_HELD_BEFORE[own])
            places.append(len(names))
            names.append(name)
        self.names: tuple[str, ...] = tuple(names)
        self._places = np.array(places, dtype=np.intp)
        self._seen: object = None
        self._count = 0
        self._order: NDArray[np.intp] | None = None
        self._fault = ""

    def read(self, message: Any) -> FloatArray:
        """Return the (n,) joint values [rad or m] of a message; whether they are finite is left to whoever uses them.

        Raises
        ------
        RosError
            A joint is missing or named twice, or there are not as many positions as names. Without any names: as many
            positions as the robot has joints are expected.
        """
        if message.name != self._seen:
            self._look(message.name)
        if len(message.position) != self._count or self._fault:
            raise RosError(self._fault or self._miscounted(len(message.position)))
        q: FloatArray = message.position if self._order is None else message.position[self._order]
        return q if self._same_signs else q * self._signs

    def velocity(self, message: Any) -> FloatArray:
        """Return the (n,) joint velocities of a message that `read` has just accepted; 0 where it gives none."""
        if len(message.velocity) != self._count or not np.isfinite(message.velocity).all():
            return np.zeros(len(self._signs))
        dq: FloatArray = message.velocity if self._order is None else message.velocity[self._order]
        return np.asarray(dq * self._signs)

    def write(self, q: ArrayLike) -> list[float]:
        """Return the values of `names` for joint values, or for joint velocities; what is held gets 0."""
        values = np.zeros(len(self.names))
        values[self._places] = np.asarray(q) * self._signs
        return [float(value) for value in values + 0.0]  # + 0.0 turns -0.0 into 0.0

    def _look(self, names: Sequence[str]) -> None:
        """Find out where the joints are in messages with these names; done once for each new list of names."""
        names = list(names)
        self._seen, self._fault, self._order = names, "", None
        self._count = len(names) or len(self.names)
        twice = [name for name in self._wanted if names.count(name) > 1]
        missing = [name for name in self._wanted if name not in names]
        if twice:
            self._fault = f"{MALFORMED}: joint {twice[0]!r} is named {names.count(twice[0])} times"
        elif names and missing:
            self._fault = f"{NOT_ENOUGH}: missing {', '.join(missing)}"
        else:
            order = np.array([names.index(name) for name in self._wanted]) if names else self._places
            whole = np.arange(self._count)
            self._order = None if np.array_equal(order, whole) else order

    def _miscounted(self, positions: int) -> str:
        if self._seen:
            return f"{MALFORMED}: {self._count} names and {positions} positions; there must be as many"
        if not positions:
            return f"{MALFORMED}: both are empty"
        return (
            f"{NOT_ENOUGH}: {positions} positions without names; "
            f"without names there must be {self._count}, of {', '.join(self.names)}"
        )
