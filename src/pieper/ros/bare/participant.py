"""A participant of a DDS domain: what one node has on the network, and where it waits for what comes."""

from __future__ import annotations

import ctypes
import os
import time
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSException, GuardCondition, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic

from pieper.errors import RosError
from pieper.ros.bare import cyclone
from pieper.ros.bare.loopback import LAST_DOMAIN, close_domain, is_open, open_domain

if TYPE_CHECKING:
    from collections.abc import Callable

    from cyclonedds.sub import DataReader

    from pieper.ros.bare.watchdog import Watchdog

ANY = SampleState.Any | ViewState.Any | InstanceState.Any

SLICE = 0.05
"""Seconds of waiting in C at a time: signals reach Python between two slices."""


class Participant:
    """One DDS participant with its topics and the set of readers that are waited for.

    Parameters
    ----------
    domain : int
        ``ROS_DOMAIN_ID``.
    network : bool
        Leave this machine.
    watchdog : Watchdog
        Watches the domain and the readers of this participant.

    Raises
    ------
    RosError
        The domain cannot be opened; the message says why.
    """

    def __init__(self, domain: int, *, network: bool, watchdog: Watchdog) -> None:
        self._number = domain
        self.watchdog = watchdog
        self._domain: Any = open_domain(domain, network=network)
        try:
            self.dds: Any = DomainParticipant(domain, Qos(Policy.Userdata(b"enclave=/;")))
        except DDSException as error:
            raise RosError(f"Cyclone DDS could not make a participant in domain {domain}: {error}") from error
        watchdog.start(self._domain)
        watchdog.meet(self.dds)
        self._topics: dict[str, Any] = {}
        self._waitset: Any = WaitSet(self.dds)
        self._guard: Any = GuardCondition(self.dds)
        self._conditions: dict[int, tuple[Any, Callable[[], None]]] = {}
        self._triggered = (ctypes.c_ssize_t * 64)()
        self._awake = ctypes.c_bool()
        cyclone.checked(cyclone.waitset_attach(self._waitset._ref, self._guard._ref, 0), "making a participant")

    @property
    def guid(self) -> bytes:
        """The 16 bytes that name the participant in the whole domain."""
        return bytes(self.dds.guid.bytes)

    @property
    def alive(self) -> bool:
        """False once the domain was closed, by whichever node of this process."""
        return self._domain is not None and is_open(self._domain, self._number)

    def topic(self, name: str, kind: Any) -> Any:
        """Return the topic of this name, made at its first use.

        Raises
        ------
        RosError
            This node has the topic with another type.
        """
        topic = self._topics.get(name)
        if topic is None:
            try:
                topic = self._topics[name] = Topic(self.dds, name, kind)
            except DDSException as error:
                raise RosError(f"Cyclone DDS could not make the topic {name!r}: {error}") from error
        if topic.data_type is not kind:
            here, asked = topic.data_type.__idl_typename__, kind.__idl_typename__
            raise RosError(
                f"this node has the topic {name!r} with the type {here}, and is now asked for it with {asked}"
            )
        return topic

    def attach(self, reader: DataReader[Any], on_data: Callable[[], None]) -> int:
        """Call ``on_data()`` from :meth:`wait` whenever this reader has something; return a key for :meth:`detach`."""
        condition: Any = ReadCondition(reader, ANY)
        key = int(condition._ref)
        cyclone.checked(cyclone.waitset_attach(self._waitset._ref, key, key), "waiting for a reader")
        self._conditions[key] = condition, on_data
        return key

    def detach(self, key: int) -> None:
        """Wait no more for a reader."""
        condition, _ = self._conditions.pop(key)
        cyclone.waitset_detach(self._waitset._ref, key)
        cyclone.delete(condition)

    def wait(self, timeout: float) -> bool:
        """Call ``on_data()`` of every reader that has something; if none has, wait for one at most ``timeout`` seconds.

        Returns
        -------
        bool
            Whether there was something, or :meth:`wake` ended the wait.
        """
        deadline = time.monotonic() + timeout
        remaining = timeout
        while True:
            part = int(max(0.0, min(remaining, SLICE)) * 1e9)
            count = cyclone.waitset_wait(self._waitset._ref, self._triggered, len(self._triggered), part)
            if count != 0:
                break
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                return False
        if count < 0 and not self.alive:
            time.sleep(SLICE)
            return False
        cyclone.checked(count, "waiting")
        for key in self._triggered[: min(count, len(self._triggered))]:
            if key == 0:
                cyclone.take_guard(self._guard._ref, self._awake)
            elif key in self._conditions:  # an earlier one may have detached it
                self._conditions[key][1]()
        return True

    def wake(self) -> None:
        """End :meth:`wait`, or the next one; safe from any thread."""
        cyclone.set_guard(self._guard._ref, True)

    def end_domain(self) -> None:
        """Close the domain, for every node of this process that is in it.

        Raises
        ------
        RosError
            A thread of DDS stands still: only a new process heals this.
        """
        self.watchdog.stop()
        close_domain(self._domain)

    def close(self) -> None:
        """Leave the domain with everything that is left of this participant."""
        for key in list(self._conditions):
            self.detach(key)
        for entity in (self._guard, self._waitset, *self._topics.values(), self.dds):
            cyclone.delete(entity)
        self._topics.clear()
        self.watchdog.stop()
        self._domain = None


def domain_id() -> int:
    """Return the domain that ``ROS_DOMAIN_ID`` names; 0 if it is not set.

    Raises
    ------
    RosError
        It is not a number from 0 to 232.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if text and not (text.isdecimal() and int(text) <= LAST_DOMAIN):
        raise RosError(f"ROS_DOMAIN_ID must be a number from 0 to {LAST_DOMAIN}, got {text!r}")
    return int(text or 0)
