"""OpenCV, asked for when it is needed: the rooms above run without it, and who lacks it is told which extra brings it."""

from __future__ import annotations

import os
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


def quiet() -> None:
    """Keep OpenCV and FFmpeg from printing about damaged files, for a command that says it itself; before the first use of them."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
