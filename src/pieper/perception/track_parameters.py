"""What a tracker assumes: how objects move, and how long they live."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pieper.errors import VisionError

_PIXELS_PER_METRE = 400.0  # of a camera over a small field; for the defaults in pixels alone


@dataclass(frozen=True)
class Motion:
    """How an object may move.

    Attributes
    ----------
    acceleration : float
        Spectral density q of the white acceleration [unit^2/s^3]: over a time T without data, the velocity wanders by ``sqrt(q T)`` and
        the position by ``sqrt(q T^3 / 3)``.
    speed : float
        Standard deviation of the velocity of an object that was just found [unit/s].
    turn_acceleration : float
        As `acceleration`, of the heading [rad^2/s^3].
    turn_rate : float
        As `speed`, of the heading [rad/s].
    jolt, turn_jolt : float
        Further spectral densities [unit^2/s^3, rad^2/s^3], of starts, kicks and collisions: the gate allows for them, and a sighting that cannot
        be explained without them (probability 0.001) is taken with them. 0 for a plain Kalman filter.
    """

    acceleration: float
    speed: float
    turn_acceleration: float = 0.3
    turn_rate: float = 6.0
    jolt: float = 0.0
    turn_jolt: float = 0.0

    def __post_init__(self) -> None:
        for name in ("acceleration", "speed", "turn_acceleration", "turn_rate", "jolt", "turn_jolt"):
            value, least = getattr(self, name), "at least 0" if "jolt" in name else "positive"
            if not (np.isfinite(value) and (value > 0 or (value == 0 and "jolt" in name))):
                raise VisionError(f"{name} must be a number that is {least}, got {value}")


@dataclass(frozen=True)
class TrackerParameters:
    """What the tracker assumes, in the unit of the view.

    Attributes
    ----------
    robot, ball, marker : Motion
        How these may move.
    gate : float
        Share of true sightings that may fall outside the gate: a sighting belongs to a track only if its squared Mahalanobis distance is
        below the value that chi-squared exceeds with this probability.
    confirm : float
        Age [s] at which a track is believed and reported, if it was seen in three frames, two if it has a name, and in half of all; 0: at once.
    forget : float
        Seconds unseen, and at least two frames, after which a track that is not yet believed is dropped.
    end : float
        Seconds unseen after which a track ends. One that was seen for less than a quarter of a second lasts twice as long as it was seen, since
        false ones seldom are for longer.
    floor : float
        Standard deviation [unit] that is added to that of every sighting, of what its covariance cannot know: calibration, light, pixels.
    heading_floor : float
        As `floor`, of the heading [rad].
    """

    robot: Motion
    ball: Motion
    marker: Motion
    gate: float = 1e-5
    confirm: float = 0.03
    forget: float = 0.1
    end: float = 1.0
    floor: float = 0.0
    heading_floor: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.gate < 1:
            raise VisionError(f"gate must be a probability between 0 and 1, got {self.gate}")
        for name in ("confirm", "forget", "end", "floor", "heading_floor"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise VisionError(f"{name} must be a number of at least 0, got {value}")

    @classmethod
    def metres(cls) -> TrackerParameters:
        """Return what fits robots of a small league, of some m/s and some m/s^2."""
        return cls(
            robot=Motion(0.005, 2.0, turn_acceleration=0.2, jolt=10.0, turn_jolt=1000.0),
            ball=Motion(0.05, 3.0, jolt=500.0),
            marker=Motion(0.05, 2.0, jolt=10.0),
        )

    @classmethod
    def pixels(cls) -> TrackerParameters:
        """Return the same for a view in pixels, of some hundred pixels to the metre."""
        k = _PIXELS_PER_METRE
        m = cls.metres()
        robot, ball, marker = (
            replace(motion, acceleration=motion.acceleration * k * k, speed=motion.speed * k, jolt=motion.jolt * k * k)
            for motion in (m.robot, m.ball, m.marker)
        )
        return replace(m, robot=robot, ball=ball, marker=marker, floor=m.floor * k)

    @classmethod
    def of_unit(cls, unit: str) -> TrackerParameters:
        """Return those for the unit of a view, ``"m"`` or ``"px"``."""
        return cls.metres() if unit == "m" else cls.pixels()

    def motion(self, kind: str) -> Motion:
        """Return how a kind of object may move; an unknown kind moves as a marker does."""
        return {"robot": self.robot, "ball": self.ball}.get(kind, self.marker)
