"""Quality of service of topics, and the settings that ROS 2 gives each kind of topic."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QoS:
    """Quality of service of a topic; publisher and subscriber have to be compatible, as in ROS 2.

    Attributes
    ----------
    reliable : bool
        Lost samples are sent again. A reliable subscriber does not hear a best-effort publisher.
    transient_local : bool
        Late subscribers still get the last ``depth`` samples ("latched").
    depth : int
        How many samples are kept on either side: the bound of every queue.
    lifespan : float
        Seconds after which a sample is thrown away; infinite by default.
    """

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10
    lifespan: float = float("inf")


DEFAULT = QoS()
SENSOR = QoS(reliable=False, depth=5)
LATCHED = QoS(transient_local=True, depth=1)
TF = QoS(depth=100)
ROSOUT = QoS(transient_local=True, depth=1000, lifespan=10.0)
CLOCK = QoS(reliable=False, depth=1)
SERVICES = QoS(depth=1000)
PARAMETER_EVENTS = QoS(depth=1000)
