"""Blobs that are followed by themselves, as markers without a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.perception.blob_places import placed, surest
from pieper.perception.sighting import Sighting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pieper.perception.blobs import Blobs
    from pieper.perception.field_view import View

Follow = Literal["all", "largest"]


def lone_markers(blobs: Blobs, view: View, follow: Mapping[str, Follow]) -> tuple[Sighting, ...]:
    """Return blobs that are followed by themselves, as sightings of kind ``"marker"`` that are named after their colour.

    Parameters
    ----------
    blobs : Blobs
    view : View
    follow : mapping
        Of colours to ``"all"`` or ``"largest"``; the blobs of other colours are left out.

    Returns
    -------
    tuple of Sighting
        One for each blob that is followed.
    """
    rows: list[int] = []
    for name, which in follow.items():
        own = (
            np.flatnonzero(blobs.color == blobs.names.index(name))
            if name in blobs.names
            else np.zeros(0, dtype=np.int64)
        )
        if which == "largest" and len(own):
            own = own[[surest(blobs.area[own], blobs.centroid[own])]]
        rows += own.tolist()
    if not rows:
        return ()
    places, covariances, _ = placed(blobs, view, 0.0, np.array(rows))
    return tuple(
        Sighting("marker", blobs.names[blobs.color[row]], places[i], None, covariances[i], (row,))
        for i, row in enumerate(rows)
        if np.isfinite(places[i]).all()
    )
