"""OpenCV, asked for when it is needed: the rooms above run without it, and who lacks it is told which extra brings it."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

from pieper.errors import MissingExtraError, MissingLibraryError


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
    MissingLibraryError
        It is installed and does not load; the message says why.
    """
    try:
        return import_module("cv2")
    except ModuleNotFoundError as cause:
        if cause.name != "cv2":
            raise _broken(cause, purpose) from cause
        raise MissingExtraError("OpenCV", "perception", purpose) from cause
    except (ImportError, OSError) as cause:  # a library that it needs, or one made for another NumPy
        raise _broken(cause, purpose) from cause


def _broken(cause: Exception, purpose: str) -> MissingLibraryError:
    return MissingLibraryError(
        f"OpenCV is installed but does not load, and {purpose} needs it: {' '.join(str(cause).split())}; install it anew: "
        "pip install --force-reinstall opencv-python-headless"
    )


def read_image_file(path: str) -> Any:
    """Return a picture with the channels and the depth it has; None where OpenCV cannot or will not read it.

    A header may claim more pixels than OpenCV agrees to take memory for (2^30).
    """
    cv2 = opencv("reading images")
    try:
        return cv2.imread(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    except (cv2.error, MemoryError):
        return None


def has_transparency(path: str) -> bool:
    """Whether the head of a PNG says that its pixels have a fourth channel; OpenCV leaves it out without a word."""
    with Path(path).open("rb") as file:
        head = file.read(26)
    return head.startswith(b"\x89PNG") and len(head) == 26 and head[25] in (4, 6)


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
