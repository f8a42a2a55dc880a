"""How the tip moves when the joints do: twist, its derivative, and the third derivative of the position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.kinematics.jacobian import jacobian, jacobian_rate

if TYPE_CHECKING:
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray


def twist_and_rate(chain: Chain, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Twist and its derivative, (k, 6) each, base axes: ``J dq`` and ``J ddq + dJ dq``."""
    J, dJ = jacobian(chain, q), jacobian_rate(chain, q, dq)
    return (J @ dq[..., None])[..., 0], (J @ ddq[..., None] + dJ @ dq[..., None])[..., 0]


def tip_jerk(chain: Chain, q: FloatArray, dq: FloatArray, ddq: FloatArray, dddq: FloatArray) -> FloatArray:
    """(k, 3) third derivative of the position: the acceleration along the third-order continuation of the motion, differenced."""
    sizes = (np.abs(d).max(axis=1) ** (1.0 / order) for order, d in ((1, dq), (2, ddq), (3, dddq)))
    h = (1e-4 / np.maximum(np.max(list(sizes), axis=0), 1e-3))[:, None]  # [s], in which the joints move 0.1 mrad

    def acceleration(e: FloatArray) -> FloatArray:
        ahead = q + e * (dq + e * (ddq / 2.0 + e * dddq / 6.0)), dq + e * (ddq + e * dddq / 2.0), ddq + e * dddq
        return twist_and_rate(chain, *ahead)[1][:, :3]

    return np.asarray((acceleration(h) - acceleration(-h)) / (2.0 * h))
