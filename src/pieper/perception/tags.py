"""AprilTags on a field: where they lie, read from a file, and where they are in an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError
from pieper.perception.opencv import opencv
from pieper.yaml_file import Section, read_yaml

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray


@dataclass(frozen=True)
class Tag:
    """An AprilTag on the field: its number, the middle of it and its height [m], the turn of its upper edge [rad], and its side [m]."""

    number: int
    x: float
    y: float
    z: float
    yaw: float
    side: float

    @property
    def corners(self) -> FloatArray:
        """Upper left, upper right, lower right, lower left of its print, ``(4, 3)``."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        square = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * self.side / 2
        return np.pad(square @ np.array([[c, s], [-s, c]]) + (self.x, self.y), ((0, 0), (0, 1)), constant_values=self.z)


def load_tags(path: str | Path) -> tuple[Tag, ...]:
    """Read where tags lie: ``family: 36h11``, a ``size`` for all or for each, and ``tags`` with ``id, x, y, z, yaw``.

    Lengths are metres, or millimetres where the key ends in ``_mm``; `yaw` is in radians, `yaw_deg` in degrees.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is malformed: the message names file, line and field.
    """
    top = read_yaml(path)
    top.only("family", "size", "size_mm", "tags")
    family = top.text("family", "36h11").lower().removeprefix("tag").replace("_", "")
    if family not in ("36h11", "apriltag36h11"):
        raise top.error("family", f"must be 36h11, got {family!r}")
    common = _length(top, "size", None)
    tags: dict[int, Tag] = {}
    for row in top.sections("tags"):
        row.only("id", "x", "x_mm", "y", "y_mm", "z", "z_mm", "yaw", "yaw_deg", "size", "size_mm")
        number = row.integer("id", least=0, most=586)
        if number in tags:
            raise row.error("id", f"tag {number} is there twice")
        side = _length(row, "size", common)
        if side is None:
            raise row.error("size", "is missing, here or for all tags: the side of the black square [m]")
        if side <= 0:
            raise row.error("size", f"must be positive, got {side:g}")
        if "yaw" in row and "yaw_deg" in row:
            raise row.error("yaw", "is given in radians and in degrees; give one")
        yaw = np.radians(row.number("yaw_deg")) if "yaw_deg" in row else row.number("yaw", 0.0)
        x, y, z = (_length(row, "x"), _length(row, "y"), _length(row, "z", 0.0))
        tags[number] = Tag(number, x or 0.0, y or 0.0, z or 0.0, float(yaw), side)
    if not tags:
        raise top.error("tags", "is empty; one tag at least")
    return tuple(tags.values())


def find_tags(image: NDArray[np.uint8]) -> dict[int, FloatArray]:
    """Find AprilTags of the family 36h11: corners ``(4, 2)`` of each by its number [px], upper left first and clockwise.

    Raises
    ------
    VisionError
        A number is in the image twice.
    """
    cv2 = opencv("finding AprilTags")
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family, settings).detectMarkers(gray)
    found: dict[int, FloatArray] = {}
    for number, uv in zip([] if ids is None else np.ravel(ids), corners, strict=True):
        if int(number) in found:
            raise VisionError(f"tag {number} is in the image twice; each number must be there once")
        found[int(number)] = np.asarray(uv, dtype=np.float64).reshape(4, 2)
    return found


def _length(row: Section, key: str, default: Any = ...) -> float | None:
    """A length in metres, from ``key`` or, in millimetres, from ``key_mm``."""
    millimetres = f"{key}_mm"
    if key in row and millimetres in row:
        raise row.error(key, "is given in metres and in millimetres; give one")
    if millimetres in row:
        return row.number(millimetres, least=-1e6, most=1e6) / 1e3
    if default is not ... and key not in row:
        return default  # type: ignore[no-any-return]
    return row.number(key, least=-1e3, most=1e3)
