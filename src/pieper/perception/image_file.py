"""One image: a picture, or a frame of a video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import VisionError
from pieper.perception.opencv import decode_image, opencv

if TYPE_CHECKING:
    from pieper.perception.frame import Image


PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")

_MEDIAN_OF = 25  # frames of a video


def read_image(path: str | Path) -> Image:
    """Read an image file as blue, green, red of 8 bits.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is no image.
    """
    image = decode_image(np.frombuffer(Path(path).read_bytes(), dtype=np.uint8))
    if image is None:
        raise VisionError(f"{path}: is no image that OpenCV can read")
    return np.asarray(image)


def read_view(path: str | Path, *, frame: int | None = None) -> Image:
    """Read what a camera that stands still sees: an image, or of a video one frame, or the median of 25, which leaves out what moves.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It cannot be read, or has no such frame.
    """
    path = Path(path)
    if path.suffix.lower() in PICTURES:
        if frame is not None:
            raise VisionError(f"{path}: an image has no frame {frame}; give a video")
        return read_image(path)
    if not path.exists():
        raise FileNotFoundError(2, "no such file", str(path))
    cv2 = opencv("reading a video")
    video = cv2.VideoCapture(str(path))
    try:
        if path.is_dir() or not video.isOpened():
            raise VisionError(f"{path}: is no image and no video that OpenCV can read")
        count = max(int(video.get(cv2.CAP_PROP_FRAME_COUNT)), 1)
        every = max(1, count // _MEDIAN_OF)
        kept: list[Image] = []
        index = 0
        while video.grab() and len(kept) < _MEDIAN_OF:  # in order: to jump to a frame is inexact with many codecs
            if index == frame or (frame is None and index % every == 0):
                done, image = video.retrieve()
                if done:
                    kept.append(np.asarray(image))
                if frame is not None:
                    break
            index += 1
    finally:
        video.release()
    if not kept:
        what = f"frame {frame}; it has {index}" if frame is not None and index else "frame that can be read"
        raise VisionError(f"{path}: the video has no {what}")
    if any(image.shape != kept[0].shape for image in kept):
        raise VisionError(f"{path}: the size of the images changes in the video; give one frame of it with --frame")
    return np.asarray(np.median(np.stack(kept), axis=0).astype(np.uint8))
