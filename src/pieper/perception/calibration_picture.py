"""Pictures of what a calibration leaves over, drawn with OpenCV alone: every miss as an arrow, magnified."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import write_bytes
from pieper.errors import VisionError
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from pieper.perception.calibration import CameraCalibration
    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

_INK, _PAPER, _GRID = (40, 40, 40), (255, 255, 255), (225, 225, 225)
_ARROW, _POINT, _MODEL = (30, 60, 220), (160, 110, 30), (80, 200, 255)
_WIDTH = 1000
_LINE = 26
_ARROW_LENGTH = 14.0  # px of a typical miss, once magnified
_BARS = 120
_MOST_ARROWS = 250


def save_picture(path: str | Path, image: Image) -> None:
    """Write a PNG or JPEG file, whole or not at all.

    Raises
    ------
    VisionError
        The name ends in neither.
    """
    ending = str(path).lower().rpartition(".")[2]
    if ending not in ("png", "jpg", "jpeg"):
        raise VisionError(f"a picture must end in .png or .jpg, got {str(path)!r}")
    done, raw = opencv("a picture").imencode(f".{ending}", image)
    if not done:
        raise VisionError(f"{path}: the picture could not be encoded")
    write_bytes(path, raw.tobytes())


def camera_picture(calibration: CameraCalibration) -> Image:
    """Draw where corners were seen and how far they are from where the lens puts them, and the residual of each view below."""
    cv2 = opencv("a picture")
    width, height = calibration.camera.size
    scale = _WIDTH / width
    page = np.full((round(height * scale), _WIDTH, 3), 255, np.uint8)
    counts = calibration.coverage
    rows, columns = counts.shape
    for (row, column), count in np.ndenumerate(counts):
        corner = (round(column * _WIDTH / columns), round(row * page.shape[0] / rows))
        opposite = (round((column + 1) * _WIDTH / columns) - 1, round((row + 1) * page.shape[0] / rows) - 1)
        share = min(float(count) / max(float(counts.max()), 1.0), 1.0)
        shade = (245, int(250 - 30 * share), int(245 - 60 * share)) if count else (235, 235, 250)
        cv2.rectangle(page, corner, opposite, shade, -1)
        cv2.rectangle(page, corner, opposite, _GRID, 1)
    uv = np.concatenate([view.uv for view in calibration.views])
    miss = np.concatenate(calibration.residuals)
    times = _magnification(calibration.rms * scale)
    _arrows(cv2, page, uv * scale, miss * scale * times)
    worst, where = calibration.worst
    head = _words(
        cv2,
        [
            f"RMS {calibration.rms:.3f} px over {len(uv)} corners in {len(calibration.views)} views, worst {worst:.3f} px in {where}",
            f"arrows: seen minus projected, x {times:g}; cells without corners are reddish ({(counts > 0).mean():.0%} have some)",
        ],
    )
    return np.concatenate([head, page, _bars(cv2, calibration)])


def field_picture(
    image: Image, outlines: Sequence[FloatArray], uv: FloatArray, miss: FloatArray, sentences: Sequence[str]
) -> Image:
    """Draw the model of the field over an image, and the misses of the points that it was fitted to.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    outlines : list of (n, 2) arrays
        Pixels of lines, NaN where they leave the reach of the lens.
    uv : (n, 2) array
        Points in the image.
    miss : (n, 2) array
        Seen minus projected [px].
    sentences : list of str
        Written above.
    """
    cv2 = opencv("a picture")
    page = np.ascontiguousarray(image[..., :3] if image.ndim == 3 else np.repeat(image[..., None], 3, axis=-1)).copy()
    page = (page * 0.75).astype(np.uint8)
    for line in outlines:
        for a, b in pairwise(line):
            if np.isfinite([a, b]).all() and np.abs([a, b]).max() < 1e4:
                cv2.line(page, _at(a), _at(b), _MODEL, 1, cv2.LINE_AA, _SHIFT)
    rms = float(np.sqrt((miss**2).sum(axis=-1).mean())) if len(miss) else 0.0
    times = _magnification(rms)
    some = slice(None, None, max(1, len(uv) // _MOST_ARROWS))
    _arrows(cv2, page, uv[some], (miss * times)[some])
    return np.concatenate([_words(cv2, [*sentences, f"arrows: seen minus model, x {times:g}"], page.shape[1]), page])


_SHIFT = 4  # fractional bits of OpenCV's drawing


def _at(point: FloatArray) -> tuple[int, int]:
    u, v = np.rint(point * 2**_SHIFT).astype(int)
    return int(u), int(v)


def _arrows(cv2: Any, page: Image, uv: FloatArray, way: FloatArray) -> None:
    way = way * np.minimum(1.0, 80.0 / np.maximum(np.hypot(*way.T), 1e-9))[:, None] if len(way) else way
    for start, step in zip(uv, way, strict=True):
        cv2.line(page, _at(start), _at(start + step), _ARROW, 1, cv2.LINE_AA, _SHIFT)
        cv2.circle(page, _at(start), 24, _POINT, -1, cv2.LINE_AA, _SHIFT)


def _magnification(typical: float) -> float:
    """1, 2 or 5 times a power of ten, so that what is typical is about as long as a letter is high."""
    wanted = _ARROW_LENGTH / max(typical, 1e-4)
    power = 10 ** np.floor(np.log10(wanted))
    return float(max(next(m for m in (5, 2, 1) if m * power <= wanted * 1.0001) * power, 1.0))


def _words(cv2: Any, sentences: Sequence[str], width: int = _WIDTH) -> Image:
    head = np.full((len(sentences) * _LINE + 10, width, 3), 255, np.uint8)
    for i, text in enumerate(sentences):
        text = text.encode("ascii", "replace").decode()
        long = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.55, 1)[0][0]
        size = 0.55 * min(1.0, (width - 20) / max(long, 1))
        cv2.putText(head, text, (10, 24 + _LINE * i), cv2.FONT_HERSHEY_SIMPLEX, size, _INK, 1, cv2.LINE_AA)
    return head


def _bars(cv2: Any, calibration: CameraCalibration) -> Image:
    foot = np.full((_BARS + _LINE, _WIDTH, 3), 255, np.uint8)
    rms = calibration.view_rms
    step = (_WIDTH - 20) / len(rms)
    for i, value in enumerate(rms):
        top = round(_BARS - (_BARS - 30) * value / rms.max()) if rms.max() > 0 else _BARS
        left, right = round(10 + i * step), round(10 + (i + 0.8) * step)
        cv2.rectangle(foot, (left, top), (max(right, left + 1), _BARS), _POINT, -1)
    words = f"RMS of each view; the highest is {rms.max():.3f} px"
    cv2.putText(foot, words, (10, _BARS + 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _INK, 1, cv2.LINE_AA)
    return foot
