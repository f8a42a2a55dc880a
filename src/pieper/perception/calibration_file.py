"""Calibrations on disk: ``camera.yaml`` holds a lens, ``field.yaml`` a lens and where the field lies before it.

All numbers are metres and pixels; keys that end in ``_mm`` are millimetres, for people. ``residual`` and ``provenance`` are told by whoever made
the file and read by whoever doubts it: `load_camera` and `load_view` need neither.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from pieper.errors import ArrayError
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView
from pieper.spatial import pose
from pieper.yaml_file import Section, read_yaml, write_yaml

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
"""Names of the distortion coefficients, in their order."""

_CAMERA = ("size", "matrix", "distortion", "model", "deviation", "residual", "provenance")
_FIELD = ("T_camera_field", "camera", "field", "assumed", "residual", "provenance")
_ORDER = "in the order " + " ".join(COEFFICIENTS) + ", as OpenCV has it."
_ROUGH = 1e-6  # how far a typed rotation may be from one; the nearest is taken


def save_camera(path: str | Path, camera: Camera, **told: Any) -> None:
    """Write ``camera.yaml``, whole or not at all.

    Parameters
    ----------
    path : str or Path
    camera : Camera
    told : mappings
        Further sections: ``model``, ``deviation`` (standard deviations of the parameters), ``residual``, ``provenance``.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "camera.yaml"
    >>> save_camera(path, Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [0.1, 0, 0, 0], (640, 480)))
    >>> load_camera(path).distortion
    array([0.1, 0. , 0. , 0. ])
    """
    write_yaml(path, {**_as_data(camera), **told}, comment="Camera: size and matrix in pixels; distortion " + _ORDER)


def load_camera(path: str | Path) -> Camera:
    """Read ``camera.yaml``.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is malformed: the message names file, line and field.
    """
    return _camera(read_yaml(path))


def save_view(
    path: str | Path,
    view: FieldView,
    *,
    field: tuple[float, float] | None = None,
    camera_file: str | Path | None = None,
    **told: Any,
) -> None:
    """Write ``field.yaml``, whole or not at all.

    Parameters
    ----------
    path : str or Path
    view : FieldView
    field : (float, float), optional
        Length (along x) and width (along y) of the field [m].
    camera_file : str or Path, optional
        Refer to this ``camera.yaml``, relative to the new file, instead of writing the camera into it.
    told : mappings
        Further sections: ``assumed`` (in words, what was not measured), ``residual``, ``provenance``.
    """
    data: dict[str, Any] = {"T_camera_field": view.T_camera_field}
    if field is not None:
        data["field"] = {"length": float(field[0]), "width": float(field[1])}
    if camera_file is None:
        data["camera"] = _as_data(view.camera)
    else:
        data["camera"] = _reference(Path(camera_file), Path(path))
    words = (
        "Field: pose in the camera's frame in metres, x and y on the floor and z up; distortion of the camera " + _ORDER
    )
    write_yaml(path, {**data, **told}, comment=words)


def load_view(path: str | Path) -> FieldView:
    """Read ``field.yaml``, and the camera that it names.

    Raises
    ------
    OSError
        The file, or the camera's, is not there.
    VisionError
        One of them is malformed: the message names file, line and field.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "field.yaml"
    >>> camera = Camera([[800, 0, 320], [0, 800, 240], [0, 0, 1]], [], (640, 480))
    >>> save_view(path, FieldView(camera, [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]]), field=(1.5, 1.3))
    >>> load_view(path).to_field([720, 240])
    array([1., 0.])
    >>> load_field_size(path)
    (1.5, 1.3)
    """
    top = read_yaml(path)
    top.only(*_FIELD)
    T = top.array("T_camera_field", (4, 4))
    try:
        if abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() <= _ROUGH:
            T[:3, :3] = pose.nearest(T)[:3, :3]
        return FieldView(_camera_of(top, Path(path)), T)
    except ArrayError as error:
        raise top.error("T_camera_field", f"is no pose: {error}") from None


def load_field_size(path: str | Path) -> tuple[float, float] | None:
    """Read length and width of the field [m] from ``field.yaml``; None where it does not tell."""
    top = read_yaml(path)
    if "field" not in top:
        return None
    section = top.section("field")
    return section.number("length", least=0.0), section.number("width", least=0.0)


def _as_data(camera: Camera) -> dict[str, Any]:
    return {"size": list(camera.size), "matrix": camera.matrix, "distortion": camera.distortion}


def _camera_of(top: Section, path: Path) -> Camera:
    if "camera" not in top:
        raise top.error("camera", "is missing: the name of a camera.yaml, or its fields")
    try:
        name = top.text("camera")
    except ValueError:  # no word, so a section
        return _camera(top.section("camera"))
    beside = path.parent / name
    if not beside.is_file():
        raise top.error("camera", f"there is no file {beside}")
    return load_camera(beside)


def _camera(section: Section) -> Camera:
    section.only(*_CAMERA)
    size = section.array("size", (2,))
    if (size != size.round()).any() or size.min() < 1:
        raise section.error("size", f"must be width and height in whole pixels, got {size.tolist()}")
    matrix, distortion = section.array("matrix", (3, 3)), section.array("distortion", (None,))
    try:
        return Camera(matrix, distortion, (int(size[0]), int(size[1])))
    except ArrayError as error:
        raise section.error("distortion" if str(error).startswith("distortion") else "matrix", str(error)) from None


def _reference(camera: Path, beside: Path) -> str:
    try:
        return Path(os.path.relpath(camera.resolve(), beside.resolve().parent)).as_posix()
    except ValueError:  # another drive
        return str(camera.resolve())
