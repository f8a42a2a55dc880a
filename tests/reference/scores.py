"""What the answers of groups of poses are worth, written out in NumPy: the oracle of the compiled kernel."""

from __future__ import annotations

import numpy as np

from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain


def score_answers(
    arm: Chain, q: np.ndarray, counted: np.ndarray, poses: int, rows: int, alike: float
) -> dict[str, np.ndarray]:
    """Of answers (g * poses, k, n), those marked (g * poses, k), one group after the other.

    ``reached``, ``solutions``, ``most``, ``manipulability``, ``singularity``, ``margin``: (g,), the last three NaN without answers.
    """
    groups = len(q) // poses
    found = {name: np.zeros(groups, dtype=np.int64) for name in ("reached", "solutions", "most")}
    found |= {name: np.full(groups, np.nan) for name in ("manipulability", "singularity", "margin")}
    lower, upper = arm.limits.T
    for g in range(groups):
        some = slice(g * poses, (g + 1) * poses)
        kept = q[some][counted[some]]
        here = counted[some].sum(axis=1)
        found["reached"][g], found["solutions"][g] = np.count_nonzero(here), here.sum()
        found["most"][g] = here.max(initial=0)
        if not len(kept):
            continue
        values = np.linalg.svd(jacobian(arm, kept)[:, :rows], compute_uv=False)
        product = values.prod(axis=1)
        found["manipulability"][g] = product.max()
        found["singularity"][g] = values[product >= product.max() * (1.0 - alike), -1].max()
        found["margin"][g] = np.minimum(kept - lower, upper - kept).min(axis=1).max()
    return found
