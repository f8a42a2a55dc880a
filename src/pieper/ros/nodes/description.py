"""``description``: the description of a robot on the network, and an arm from such a description.

``robot_description`` is published once, latched, as robot_state_publisher does. ``robot_description_latch`` has the same text for
those that come late: latched, and sent again from time to time for subscribers that do not ask for latched samples.
"""

from __future__ import annotations

import warnings
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.arm import Arm, load
from pieper.errors import DescriptionError, PieperError, PieperWarning, RosError, UrdfError
from pieper.model.urdf import as_urdf, from_urdf
from pieper.model.xacro import is_xacro
from pieper.ros.nodes.checks import seconds
from pieper.ros.nodes.complaints import Complaints
from pieper.ros.qos import DEFAULT, LATCHED

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from pieper.ros.bus import Bus

STRING = "std_msgs/msg/String"

FROM_TOPIC = "topic:"
"""What an arm is called that is to be read from a topic: ``topic:/robot_description``."""


class Description:
    """Publishes the description of a robot, for early and for late subscribers.

    Parameter of the node: ``repeat``, seconds after which ``robot_description_latch`` is sent again; 0: never.

    Parameters
    ----------
    bus : Bus
        The network.
    robot : Arm, str or path, optional
        An arm, the name of a built-in one, a URDF or xacro file, or the text of a URDF. Without it the node passes on what
        another node publishes on ``robot_description``.

    Attributes
    ----------
    text : str
        The URDF; empty until one has come.

    Raises
    ------
    PieperError
        There is no such robot, or its description is malformed.

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> node = Description(network.bus("description"), "ur5e")
    >>> late = network.bus("late")
    >>> arm_from_topic(late, timeout=1.0)
    Arm('ur5e', 6 joints, 'base_link' -> 'tool0')
    """

    def __init__(self, bus: Bus, robot: Arm | str | os.PathLike[str] | None = None) -> None:
        self._bus, self.text = bus, ""
        self._complaints = Complaints(bus)
        self._repeat = bus.parameter(
            "repeat",
            1.0,
            description="seconds until robot_description_latch is sent again; 0: never",
            check=seconds,
        )
        self._latch = bus.publisher("robot_description_latch", STRING, qos=LATCHED)
        self._sent_at = 0
        if robot is None:
            for qos in (LATCHED, DEFAULT):
                bus.subscribe("robot_description", STRING, self._on_description, qos=qos)
        else:
            with _doubts_to(bus, "warn"):
                self.text = urdf_text(robot)
            bus.publisher("robot_description", STRING, qos=LATCHED).send(data=self.text)
            self._send()
        bus.timer(0.1, self._look)

    def _on_description(self, message: Any) -> None:
        if message.data == self.text:
            return
        try:
            with _doubts_to(self._bus, "debug"):
                arm = arm_from_text(message.data, source="robot_description")
        except PieperError as error:
            self._complaints.say("error", f"description refused: {error}")
            return
        self.text = message.data
        self._bus.log("info", f"Latched the description of {arm.name!r}")
        self._send()

    def _send(self) -> None:
        self._latch.send(data=self.text)
        self._sent_at = self._bus.now()

    def _look(self) -> None:
        period = self._repeat.value * 1e9
        if self.text and period and not 0 <= self._bus.now() - self._sent_at < period:
            self._send()


def urdf_text(robot: Arm | str | os.PathLike[str]) -> str:
    """Return the URDF of a robot: a file in UTF-8 or a text that is one as it is, anything else written as one.

    Raises
    ------
    PieperError
        There is no such robot, or its description is malformed.

    Examples
    --------
    >>> urdf_text("mh12").splitlines()[1]
    '<robot name="yaskawa_mh12">'
    """
    arm = robot if isinstance(robot, Arm) else load(robot)
    if not isinstance(robot, Arm):
        if isinstance(robot, str) and _is_xml(robot) and not is_xacro(robot):
            return robot
        if Path(robot).suffix == ".urdf":
            with suppress(UnicodeDecodeError):  # messages are UTF-8; a file in another encoding is written anew
                return Path(robot).read_text(encoding="utf-8")
    return as_urdf(arm.description or arm.chain)


def arm_from_topic(
    bus: Bus,
    timeout: float = 5.0,
    *,
    topic: str = "robot_description",
    base: str | None = None,
    tip: str | None = None,
) -> Arm:
    """Wait for the description of a robot on a topic and load the arm from it; not from inside a callback.

    Parameters
    ----------
    bus : Bus
        Spun meanwhile.
    timeout : float
        Seconds to wait.
    topic : str
        Of type ``std_msgs/msg/String``, latched or not.
    base, tip : str, optional
        See `pieper.load`.

    Raises
    ------
    RosError
        Nothing has come in time.
    UrdfError
        What came is no URDF; the message says why. Nothing else than a URDF is read: xacro can run programs.
    """
    heard: list[Any] = []
    subscriptions = [bus.subscribe(topic, STRING, heard.append, qos=qos) for qos in (LATCHED, DEFAULT)]
    name = subscriptions[0].topic
    bus.log("info", f"Waiting for a robot description on {name}")
    try:
        bus.spin_until(lambda: bool(heard), timeout=timeout)
    finally:
        for subscription in subscriptions:
            subscription.close()
    if not heard:
        raise RosError(
            f"no robot description on {name} within {timeout:g} s; start the node that publishes it, or name a robot or a file"
        )
    with _doubts_to(bus, "debug"):
        return arm_from_text(heard[0].data, source=name, base=base, tip=tip)


def arm_from_text(text: str, *, source: str, base: str | None = None, tip: str | None = None) -> Arm:
    """Load an arm from the text of a URDF that came from outside; an encoding header does no harm.

    Raises
    ------
    UrdfError
        It is no URDF. A text that is no XML is refused here and never taken for the name of a file.
    """
    if not _is_xml(text):
        raise UrdfError(source, "document", f"is not a URDF, which starts with <: it starts with {text[:40]!r}")
    if is_xacro(text) or "<xacro:" in text:
        raise UrdfError(
            source, "document", "is xacro, which can run programs and is not expanded here; publish the URDF"
        )
    try:
        description = from_urdf(text, source=source)
        return Arm(description.chain(base, tip), description)
    except UrdfError:
        raise
    except DescriptionError as error:
        raise UrdfError(error.source, error.element, error.reason) from None


def find_arm(bus: Bus, what: str, *, timeout: float = 5.0, base: str | None = None, tip: str | None = None) -> Arm:
    """Load an arm by a name, from a file, or with ``topic:/robot_description`` from the network.

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> node = Description(network.bus("description"), "youbot")
    >>> find_arm(network.bus("forward"), "topic:/robot_description").dof
    5
    """
    if what.startswith(FROM_TOPIC):
        return arm_from_topic(bus, timeout, topic=what.removeprefix(FROM_TOPIC), base=base, tip=tip)
    return load(what, base=base, tip=tip)


@contextmanager
def _doubts_to(bus: Bus, level: str) -> Iterator[None]:
    """What a description leaves open or lacks goes to the log of the node, and is no warning of Python."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PieperWarning)
        yield
    for warning in caught:
        bus.log(level, str(warning.message))


def _is_xml(text: str) -> bool:
    return text.lstrip("\ufeff \t\r\n").startswith("<")
