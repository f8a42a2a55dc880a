"""Ghosts: arms that one can look through, laid over a picture, so that other answers and other times show in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.sim.offscreen import Pixels

COINCIDE = 6e-6
"""Of the depth; links that a ghost shares with an arm are in the same place up to rounding."""


class Ghost(NamedTuple):
    """An arm to look through: joint values `q` (n,) [rad or m], `color` ``"#rrggbb"`` or None for its own, `opacity` from 0 to 1."""

    q: ArrayLike
    color: str | None = None
    opacity: float = 0.3


def laid_over(
    colors: NDArray[np.float32], depth: NDArray[np.float32], ghosts: Sequence[tuple[float, Pixels]]
) -> NDArray[np.float32]:
    """Colours (h, w, 3) with ghosts laid over them, the farthest first at every pixel.

    Each ghost is drawn alone and laid over what is behind it, so that its own parts do not show through each other.

    Parameters
    ----------
    colors, depth : (h, w, 3) and (h, w) arrays
        What is solid.
    ghosts : sequence of (float, Pixels)
        Opacity of each, and what it looks like alone.
    """
    if not ghosts:
        return colors
    depths = np.stack([ghost.depth for _, ghost in ghosts])
    images = np.stack([ghost.colors for _, ghost in ghosts])
    opacities = np.array([opacity for opacity, _ in ghosts], dtype=np.float32)
    order = np.argsort(-depths, axis=0)
    for which in order:
        here = np.take_along_axis(depths, which[None], 0)[0]
        paint = np.take_along_axis(images, which[None, ..., None], 0)[0]
        weight = opacities[which] * (here < depth - COINCIDE)
        colors = np.asarray(colors + weight[..., None] * (paint - colors), dtype=np.float32)
    return colors
