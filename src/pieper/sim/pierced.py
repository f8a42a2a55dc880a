"""Capsules in boxes: the one pair of solids that MuJoCo's collision detection may not see.

It looks for the contact of a capsule with a box near the capsule's ends and the box's edges, and finds none where the middle of a capsule has
gone right through a thin board. So these pairs are measured here: the distance of a segment from a box, exactly, see `pieper.motion.clearance`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.motion.clearance import segment_to_box
from pieper.sim.offscreen import import_mujoco

if TYPE_CHECKING:
    from numpy.typing import NDArray


class CapsulesAndBoxes:
    """All pairs of a capsule and a box of a MuJoCo model that may collide.

    Parameters
    ----------
    model : mujoco.MjModel

    Examples
    --------
    >>> import mujoco
    >>> bodies = '<body><freejoint/><geom type="capsule" size=".05 .4"/></body><geom type="box" size="1 1 .001"/>'
    >>> model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_forward(model, data)
    >>> data.ncon, CapsulesAndBoxes(model).near(data, 0.0)
    (0, array([[1, 0]]))
    """

    def __init__(self, model: Any) -> None:
        kind = import_mujoco().mjtGeom
        capsules = np.flatnonzero(model.geom_type == kind.mjGEOM_CAPSULE)
        boxes = np.flatnonzero(model.geom_type == kind.mjGEOM_BOX)
        first, second = (grid.ravel() for grid in np.meshgrid(capsules, boxes, indexing="ij"))
        bodies = np.stack([model.geom_bodyid[first], model.geom_bodyid[second]], axis=1)
        low, high = np.sort(bodies, axis=1).T
        welded = model.body_weldid[bodies]
        parents = model.body_weldid[model.body_parentid[welded]]
        family = ((parents == welded[:, ::-1]) & (parents != 0)).any(axis=1)
        meant = (model.geom_contype[first] & model.geom_conaffinity[second]) | (
            model.geom_contype[second] & model.geom_conaffinity[first]
        )
        wanted = (meant != 0) & (welded[:, 0] != welded[:, 1]) & ~family
        wanted &= ~np.isin((low.astype(np.int64) << 16) + high, model.exclude_signature)
        self._capsule, self._box, self._bodies = first[wanted], second[wanted], bodies[wanted]
        self._radius, self._length = model.geom_size[self._capsule, 0], model.geom_size[self._capsule, 1]
        self._half = model.geom_size[self._box]
        self._reach = self._radius + self._length

    def near(self, data: Any, margin: float) -> NDArray[np.intp]:
        """(k, 2) bodies of the pairs that are nearer than a margin [m], where `data` has them."""
        center = data.geom_xpos[self._capsule] - data.geom_xpos[self._box]
        R = data.geom_xmat[self._box].reshape(-1, 3, 3)
        local = np.einsum("ki,kij->kj", center, R)
        outside = np.maximum(np.abs(local) - self._half, 0.0)
        close = np.flatnonzero(np.einsum("ki,ki->k", outside, outside) < (self._reach + margin) ** 2)
        if not len(close):
            return np.zeros((0, 2), dtype=np.intp)
        axis = data.geom_xmat[self._capsule[close]].reshape(-1, 3, 3)[:, :, 2] * self._length[close, None]
        along = np.einsum("ki,kij->kj", axis, R[close])
        gap = segment_to_box(local[close] - along, local[close] + along, self._half[close]) - self._radius[close]
        return np.asarray(self._bodies[close[gap < margin]], dtype=np.intp)
