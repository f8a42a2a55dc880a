"""What the tracker believes of one object at one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray

State = Literal["seen", "hidden", "lost"]
"""Measured at this time; predicted, because it was not; given up."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """State of one track.

    Attributes
    ----------
    track : int
        Number of the track, from 1; never given twice.
    kind : str
        ``"robot"``, ``"ball"`` or ``"marker"``.
    name : str or None
        Identity, once it is known.
    time : float
        [s], on the clock of the frames.
    position : (2,) array
        In the unit of the view: metres on the field, or pixels.
    heading : float or None
        [rad], in (-pi, pi]; None for what has none.
    velocity : (2,) array
        Per second.
    turn_rate : float or None
        [rad/s].
    covariance : (4, 4) or (6, 6) array
        Of x, y, their rates; with a heading, of x, y, heading, and the rates of the three.
    state : "seen", "hidden" or "lost"
        Whether this frame showed it.
    unseen : float
        Seconds since it was last seen; 0 when it is.
    age : float
        Seconds since it was first seen.
    """

    track: int
    kind: str
    name: str | None
    time: float
    position: FloatArray
    heading: float | None
    velocity: FloatArray
    turn_rate: float | None
    covariance: FloatArray
    state: State
    unseen: float
    age: float
