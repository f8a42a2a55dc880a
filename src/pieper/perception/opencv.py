"""OpenCV, asked for when it is needed: the rooms above run without it, and who lacks it is told which extra brings it."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pieper.errors import MissingExtraError


def opencv(purpose: str) -> Any:
    """Return the module ``cv2``.

    Parameters
    ----------
    purpose : str
        What needs it, for the message.

    Raises
    ------
    MissingExtraError
        OpenCV is not installed.
    """
    try:
        return import_module("cv2")
    except ImportError as cause:
        raise MissingExtraError("OpenCV", "perception", purpose) from cause
