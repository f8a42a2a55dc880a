"""Ruckig, which plans jerk-limited profiles in this process, and is asked from one state to one state only.

Its way points, which it would send over the network, are not used.
"""

from __future__ import annotations

from typing import Any

from pieper.errors import MissingExtraError, MotionError


def planned(asked: Any) -> Any:
    """Ruckig's answer to one question, from one state to one state."""
    ruckig = module()
    found = ruckig.Trajectory(asked.degrees_of_freedom)
    result = ruckig.Ruckig(asked.degrees_of_freedom).calculate(asked, found)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise MotionError(
            f"no motion within limits was found ({result}); limits of very different sizes, or a move too small to time? raise the smallest limit"
        )
    return found


def module() -> Any:
    """Ruckig, or what to install."""
    try:
        import ruckig
    except ImportError:
        raise MissingExtraError("ruckig", "plan", "jerk-limited timing") from None
    return ruckig
