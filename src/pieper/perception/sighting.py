"""What one frame says of one object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray


@dataclass(frozen=True, eq=False)
class Sighting:
    """A robot, a ball or a lone marker, as seen in one frame.

    Attributes
    ----------
    kind : str
        ``"robot"``, ``"ball"``, or ``"marker"`` for a patch of colour that is followed by itself.
    name : str or None
        Which one, where its pattern (or, for a marker, its colour) tells; None if it does not.
    position : (2,) array
        Where, in the unit of the view: metres on the field, or pixels.
    heading : float or None
        Angle from the field's x to the object's x, about the field's z [rad], in (-pi, pi]; None where nothing shows it.
        In pixels, from right to down.
    covariance : (2, 2) or (3, 3) array
        Of x, y, and heading if there is one.
    blobs : tuple of int
        Rows of the frame's `Blobs` that it was made of.
    confidence : float
        0 to 1: share of the pattern's markers that were found, each weighed by how well it fits.
    """

    kind: str
    name: str | None
    position: FloatArray
    heading: float | None
    covariance: FloatArray
    blobs: tuple[int, ...] = ()
    confidence: float = 1.0
