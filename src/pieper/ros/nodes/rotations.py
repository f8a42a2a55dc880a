"""Rotations as services: a quaternion as rotation vector, and as yaw, pitch and roll."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.ros.nodes.complaints import Complaints
from pieper.spatial import rotation

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.model.chain import FloatArray
    from pieper.ros.bus import Bus


class Rotations:
    """Answers ``quat2rodrigues`` and ``quat2zyx``.

    ``q`` and ``-q`` get the same answer, and a quaternion of any length but 0 is normalised. What is no rotation (a zero
    quaternion, or a component that is not finite) is refused: the response has no place for a reason, so its numbers are NaN and
    the reason goes to the log.

    Parameters
    ----------
    bus : Bus

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> node, user = Rotations(network.bus("rotations")), network.bus("user")
    >>> client = user.client("quat2zyx", "pieper_interfaces/srv/QuatToZYX")
    >>> answer = user.call(client, 1.0, q={"x": 0.0, "y": 0.0, "z": 1.0, "w": 1.0})  # a quarter turn about z
    >>> round(answer.z.data, 6), answer.y.data, answer.x.data
    (1.570796, 0.0, 0.0)
    """

    def __init__(self, bus: Bus) -> None:
        self._complaints = Complaints(bus)
        rotation.as_rotation_vector(
            rotation.from_quaternion([0.0, 0.0, 0.0, 1.0])
        )  # loads what it needs now, not when asked
        bus.serve("quat2rodrigues", "pieper_interfaces/srv/QuatToRodrigues", self._convert_quat2rodrigues)
        bus.serve("quat2zyx", "pieper_interfaces/srv/QuatToZYX", self._convert_quat2zyx)
        bus.log("info", "Ready to convert quaternions: quat2rodrigues, quat2zyx")

    def _convert_quat2rodrigues(self, request: Any) -> dict[str, Any]:
        return self._answer("quat2rodrigues", request.q, "xyz", rotation.as_rotation_vector)

    def _convert_quat2zyx(self, request: Any) -> dict[str, Any]:
        return self._answer("quat2zyx", request.q, "zyx", lambda R: rotation.as_rpy(R)[::-1])

    def _answer(self, service: str, q: Any, names: str, convert: Callable[[FloatArray], FloatArray]) -> dict[str, Any]:
        values = np.full(3, np.nan)
        try:
            values = convert(rotation.from_quaternion([q.x, q.y, q.z, q.w]))
        except ArrayError as error:
            self._complaints.say("warn", f"{service}: refused: {error}")
        return {name: {"data": value + 0.0} for name, value in zip(names, values, strict=True)}
