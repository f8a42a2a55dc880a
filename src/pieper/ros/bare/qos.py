"""Quality of service of ROS as the policies of DDS, and what endpoints tell of themselves in their user data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cyclonedds.qos import Policy, Qos

from pieper.errors import RosError

if TYPE_CHECKING:
    from pieper.ros.qos import QoS

LONGEST_WRITE = 0.01
"""Seconds that a reliable writer waits for a subscriber that does not keep up, before it gives a sample up."""

_CDR = Policy.DataRepresentation(use_cdrv0_representation=True)  # ROS is plain CDR, version 1
_UNLIMITED = -1

POLICIES = {2: "durability", 11: "reliability"}
"""Numbers in DDS of the policies that ROS nodes differ in."""


def writer_policies(qos: QoS, user_data: str) -> Qos:
    """Return the policies of a writer; ``user_data`` is what other nodes read about it."""
    policies = [*_policies(qos, user_data), Policy.WriterDataLifecycle(autodispose=False)]
    if math.isfinite(qos.lifespan):
        policies.append(Policy.Lifespan(round(qos.lifespan * 1e9)))
    if qos.transient_local:
        history = Policy.History.KeepLast(qos.depth)
        policies.append(Policy.DurabilityService(0, history, _UNLIMITED, _UNLIMITED, _UNLIMITED))
    return Qos(*policies)


def reader_policies(qos: QoS, user_data: str) -> Qos:
    """Return the policies of a reader; it keeps the newest ``qos.depth`` samples, and never stops a writer."""
    return Qos(*_policies(qos, user_data))


def _policies(qos: QoS, user_data: str) -> list[object]:
    if qos.depth < 1:
        raise RosError(f"the depth of a quality of service must be at least 1, got {qos.depth}")
    return [
        Policy.Reliability.Reliable(round(LONGEST_WRITE * 1e9)) if qos.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if qos.transient_local else Policy.Durability.Volatile,
        Policy.History.KeepLast(qos.depth),
        _CDR,
        Policy.Userdata(user_data.encode()),
    ]
