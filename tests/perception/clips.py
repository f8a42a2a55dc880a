"""Small videos whose frames carry their own number, so that a test can tell which frame it was given."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

SIZE = (96, 32)
_BITS = 6


def numbered(n: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """An image with a number in it, as a row of dark and bright squares that survive compression."""
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    side = size[0] // _BITS
    for bit in range(_BITS):
        image[:, bit * side : (bit + 1) * side] = (230, 230, 230) if n >> bit & 1 else (20, 20, 20)
    return image


def number_in(image: np.ndarray) -> int:
    side = image.shape[1] // _BITS
    middle = image[image.shape[0] // 2, side // 2 :: side].mean(axis=-1)
    return sum(1 << bit for bit in range(_BITS) if middle[bit] > 128)


def write_clip(path: Path, images: Iterable[np.ndarray], *, fps: float = 10.0, code: str = "mp4v") -> Path:
    writer = None
    for image in images:
        if writer is None:
            size = (image.shape[1], image.shape[0])
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*code), fps, size)
        writer.write(image)
    assert writer is not None
    writer.release()
    return path


def numbered_clip(path: Path, count: int = 40, **options) -> Path:
    return write_clip(path, map(numbered, range(count)), **options)


def ffmpeg(*arguments: object) -> None:
    """Run FFmpeg, for what OpenCV cannot write."""
    tool = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    subprocess.run([tool, "-v", "error", "-y", *map(str, arguments)], check=True, timeout=60)
