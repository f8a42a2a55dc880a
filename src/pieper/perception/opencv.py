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


def read_image_file(path: str) -> Any:
    """Return a picture with the channels and the depth it has; None where OpenCV cannot or will not read it.

    A header may claim more pixels than OpenCV agrees to take memory for (2^30).
    """
    cv2 = opencv("reading images")
    try:
        return cv2.imread(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    except (cv2.error, MemoryError):
        return None


def decode_image(raw: Any) -> Any:
    """Return a picture in three channels of 8 bits from the bytes of a file; None where OpenCV cannot or will not read it."""
    cv2 = opencv("reading images")
    try:
        return cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
    except (cv2.error, MemoryError):
        return None


def quiet() -> None:
    """Keep OpenCV and FFmpeg from printing about damaged files, for a command that says it itself; before the first use of them."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
