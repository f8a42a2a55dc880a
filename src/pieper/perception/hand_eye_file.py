"""Captures for a hand-eye calibration on disk, and its result.

Captures are a CSV or YAML file; each row is a pose of the arm and what the camera saw from there.

===================================  ==================================================================================
columns of the CSV                   meaning
===================================  ==================================================================================
``name``                             of the pose, for messages; if there is none, that of the image or ``pose K``
``q1 q2 ...``                        joint values [rad or m], with an arm; or
``x y z qx qy qz qw``                ``T_base_tcp``: position [m] and quaternion, scalar last
``image``                            a picture of the board, beside the file; or
``camera_x ... camera_qw``           ``T_camera_target``, position [m] and quaternion
===================================  ==================================================================================

The YAML file has a list ``poses`` of sections with the fields ``name``, ``q`` or ``T_base_tcp`` (four rows of four), ``image`` or
``T_camera_target``. A folder stands for its ``poses.csv`` or ``poses.yaml``; rows without a camera's column then take its images in the order of
their names.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._version import __version__
from pieper.atomic_file import write_text
from pieper.errors import VisionError
from pieper.perception.image_file import PICTURES
from pieper.spatial import pose, rotation
from pieper.yaml_file import LARGEST, Section, read_yaml, write_yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pieper.arm import Arm
    from pieper.perception.hand_eye import CameraOn, HandEyeCalibration
    from pieper.spatial._checks import FloatArray

FORMAT = "pieper hand-eye 1"

_HAND = ("x", "y", "z", "qx", "qy", "qz", "qw")
_SEEN = tuple(f"camera_{name}" for name in _HAND)
_BEYOND = 0.1  # [rad or m] how far beyond its limits a real arm may say that it is
_ROUGH = 1e-3  # how far a typed quaternion's length may be from 1


@dataclass(frozen=True, eq=False)
class Captures:
    """What was captured.

    Attributes
    ----------
    names : tuple of str
    Ts_base_tcp : (n, 4, 4) array
    Ts_camera_target : (n, 4, 4) array or None
        None where there are images.
    images : tuple of Path
        Empty where there are poses.
    q : (n, joints) array or None
        Joint values, where the file has them.
    """

    names: tuple[str, ...]
    Ts_base_tcp: FloatArray
    Ts_camera_target: FloatArray | None
    images: tuple[Path, ...]
    q: FloatArray | None


def read_captures(path: str | Path, arm: Arm | None = None) -> Captures:
    r"""Read captures from a ``.csv`` or ``.yaml`` file, or from a folder that has one.

    Parameters
    ----------
    path : str or Path
    arm : Arm, optional
        For files that tell joint values.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is malformed; the message names file, line and field.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "poses.csv"
    >>> _ = file.write_text("x,y,z,qx,qy,qz,qw,image\n0.4,0,0.5,1,0,0,0,a.png\n")
    >>> captures = read_captures(file)
    >>> captures.names, captures.Ts_base_tcp[0, :3, 3]
    (('a.png',), array([0.4, 0. , 0.5]))
    """
    file = _file(Path(path))
    rows = _csv_rows(file) if file.suffix.lower() == ".csv" else _yaml_rows(read_yaml(file))
    if not rows:
        raise VisionError(f"{file}: has no poses")
    with_q = [row.q is not None for row in rows]
    if any(with_q) and arm is None:
        raise VisionError(f"{file}: tells joint values; say of which arm")
    hands = []
    for row in rows:
        if row.q is not None and arm is not None:
            if len(row.q) != arm.dof:
                raise VisionError(f"{row.where}: {arm.name} has {arm.dof} joints, got {len(row.q)} values")
            _within_limits(row, arm)
            hands.append(arm.fk(row.q))
        else:
            hands.append(np.asarray(row.T_base_tcp))
    folder = file.parent
    seen = [row.T_camera_target for row in rows]
    images = [row.image for row in rows]
    if Path(path).is_dir() and not any(images) and not any(T is not None for T in seen):
        found = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in PICTURES)
        if len(found) != len(rows):
            raise VisionError(
                f"{folder}: has {len(found)} images, and {file.name} has {len(rows)} poses; name the image of each in a column"
            )
        images = list(found)
    for row, T, image in zip(rows, seen, images, strict=True):
        if (T is None) == (not image):
            raise VisionError(f"{row.where}: needs an image or a T_camera_target, one of them")
    if len({bool(image) for image in images}) > 1:
        raise VisionError(f"{file}: some poses have an image and some a T_camera_target; all need the same")
    names = tuple(row.name or image or f"pose {k + 1}" for k, (row, image) in enumerate(zip(rows, images, strict=True)))
    return Captures(
        names,
        np.array(hands),
        None if any(images) else np.array([T for T in seen if T is not None]),
        tuple(folder / image for image in images if image),
        np.array([row.q for row in rows]) if all(with_q) else None,
    )


def write_captures(path: str | Path, q: FloatArray, *, images: Sequence[str] = ()) -> None:
    """Write joint values, ``(n, joints)``, as a CSV file that `read_captures` reads once the images are there."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*(["image"] if images else []), *(f"q{k + 1}" for k in range(q.shape[1]))])
    for k, row in enumerate(q):
        writer.writerow([*([images[k]] if images else []), *(f"{value:.6f}" for value in row)])
    write_text(path, text.getvalue())


def save_hand_eye(path: str | Path, found: HandEyeCalibration, *, sources: Iterable[str] = ()) -> None:
    """Write a calibration as YAML, with deviations, residuals and provenance."""
    mount, holder = (f"T_{found.mount}_camera", f"T_{found.holder}_target")
    residual: dict[str, Any] = {
        "position_rms_m": _short(_rms(found.position_residual[found.used])),
        "rotation_rms_rad": _short(_rms(found.rotation_residual[found.used])),
    }
    if found.pixel_rms is not None:
        residual["pixel_rms"] = _short(found.pixel_rms)
    residual["poses"] = [
        {"name": name, "used": bool(used), "position_m": _short(float(p)), "rotation_rad": _short(float(r))}
        for name, used, p, r in zip(
            found.names, found.used, found.position_residual, found.rotation_residual, strict=True
        )
    ]
    data = {
        "format": FORMAT,
        "camera_on": found.camera_on,
        mount: found.T_mount_camera,
        holder: found.T_holder_target,
        "deviation": {"position_m": [_short(v) for v in found.position_deviation], "rotation_rad": [_short(v) for v in found.rotation_deviation]},
        "turns_rad": [_short(v) for v in found.turns],
        "methods": [
            {"name": m.name, "position_rms_m": _short(m.position_rms), "rotation_rms_rad": _short(m.rotation_rms)} for m in found.methods
        ],
        "residual": residual,
        "left_out": list(found.left_out),
        "missing": list(found.missing),
        "provenance": {
            "sources": [str(s) for s in sources],
            "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "by": f"pieper {__version__}",
        },
    }  # fmt: skip
    write_yaml(
        path,
        data,
        comment="Camera on a robot. T_a_b takes coordinates in frame b to frame a; metres; camera axes x right, y down, z ahead.",
    )


def load_hand_eye(path: str | Path) -> tuple[CameraOn, FloatArray, FloatArray]:
    """Read what carries the camera, where the camera is on it, and where the board was.

    Returns
    -------
    camera_on, T_mount_camera, T_holder_target
        See `pieper.perception.hand_eye.HandEyeCalibration`. A person may write these three fields alone.

    Raises
    ------
    OSError
        The file is not there.
    VisionError
        It is malformed; the message names file, line and field.
    """
    top = read_yaml(path)
    said = top.text("format", FORMAT)
    if said != FORMAT:
        raise top.error("format", f"must be {FORMAT!r}, got {said!r}")
    on = top.text("camera_on")
    if on == "hand":
        return "hand", _pose(top, "T_tcp_camera"), _pose(top, "T_base_target")
    if on == "cell":
        return "cell", _pose(top, "T_base_camera"), _pose(top, "T_tcp_target")
    raise top.error("camera_on", f"must be hand or cell, got {on!r}")


# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Row:
    where: str
    name: str
    q: FloatArray | None
    T_base_tcp: FloatArray | None
    T_camera_target: FloatArray | None
    image: str


def _within_limits(row: _Row, arm: Arm) -> None:
    for name, value, (low, high) in zip(arm.joint_names, np.asarray(row.q), arm.limits, strict=True):
        if not low - _BEYOND <= value <= high + _BEYOND:
            raise VisionError(
                f"{row.where}: joint {name!r} at {value:g} is outside its limits [{low:.6g}, {high:.6g}]; joint values are rad or m, not degrees"
            )


def _file(path: Path) -> Path:
    if not path.is_dir():
        if path.suffix.lower() not in (".csv", ".yaml", ".yml"):
            raise VisionError(f"{path}: captures are a .csv or a .yaml file, or a folder with poses.csv or poses.yaml")
        return path
    for name in ("poses.csv", "poses.yaml", "poses.yml"):
        if (path / name).is_file():
            return path / name
    raise VisionError(f"{path}: the folder has no poses.csv or poses.yaml that tells where the arm was")


def _yaml_rows(top: Section) -> list[_Row]:
    top.only("poses")
    rows = []
    for section in top.sections("poses"):
        section.only("name", "q", "T_base_tcp", "image", "T_camera_target")
        where = f"{section.file}, line {section.line}, {section.field}"
        if ("q" in section) == ("T_base_tcp" in section):
            raise section.error("", "needs q or T_base_tcp, one of them")
        rows.append(
            _Row(
                where,
                section.text("name", ""),
                section.array("q", (None,), None),
                _pose(section, "T_base_tcp") if "T_base_tcp" in section else None,
                _pose(section, "T_camera_target") if "T_camera_target" in section else None,
                section.text("image", ""),
            )
        )
    return rows


def _pose(section: Section, key: str) -> FloatArray:
    T = section.array(key, (4, 4))
    if (
        abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > _ROUGH
        or np.linalg.det(T[:3, :3]) < 0
        or (T[3] != (0, 0, 0, 1)).any()
    ):
        raise section.error(key, "is no pose: its 3x3 block is no rotation, or its last row is not 0 0 0 1")
    T[:3, :3] = rotation.nearest(T[:3, :3])
    return np.asarray(T)


def _csv_rows(file: Path) -> list[_Row]:
    with file.open("rb") as handle:
        raw = handle.read(LARGEST + 1)
    if len(raw) > LARGEST:
        raise VisionError(f"{file}: is larger than {LARGEST} bytes, the most that is read")
    try:
        lines = list(csv.reader(io.StringIO(raw.decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error) as cause:
        raise VisionError(f"{file}: is no CSV file in UTF-8: {cause}") from None
    if not lines:
        raise VisionError(f"{file}, line 1: the file is empty")
    head = [word.strip() for word in lines[0]]
    joints = [word for word in head if word[:1] == "q" and word[1:].isdecimal()]
    known = {"name", "image", *_HAND, *_SEEN, *joints}
    for word in head:
        if word not in known or head.count(word) > 1:
            raise VisionError(f"{file}, line 1: column {word!r} is {'there twice' if word in known else 'not known'}; columns are name, q1 q2 ... or "
                              f"{' '.join(_HAND)}, image or {' '.join(_SEEN)}")  # fmt: skip
    if joints != [f"q{k + 1}" for k in range(len(joints))]:
        raise VisionError(f"{file}, line 1: joint values are columns q1, q2, ... in order, got {' '.join(joints)}")
    if bool(joints) == bool(set(_HAND) & set(head)):
        raise VisionError(f"{file}, line 1: needs columns q1 q2 ... or {' '.join(_HAND)}, one of them")
    rows = []
    for number, words in enumerate(lines[1:], start=2):
        if not any(word.strip() for word in words):
            continue
        where = f"{file}, line {number}"
        if len(words) != len(head):
            raise VisionError(f"{where}: has {len(words)} columns, and the first line has {len(head)}")
        cells = dict(zip(head, (word.strip() for word in words), strict=True))
        q = np.array([_number(where, cells, name) for name in joints]) if joints else None
        hand = None if joints else _from_columns(where, cells, _HAND)
        seen = _from_columns(where, cells, _SEEN) if set(_SEEN) & set(head) else None
        rows.append(_Row(where, cells.get("name", ""), q, hand, seen, cells.get("image", "")))
    return rows


def _from_columns(where: str, cells: dict[str, str], names: Sequence[str]) -> FloatArray:
    values = np.array([_number(where, cells, name) for name in names])
    length = float(np.linalg.norm(values[3:]))
    if abs(length - 1.0) > _ROUGH:
        raise VisionError(f"{where}: the quaternion {' '.join(names[3:])} must have length 1, got {length:.4g}")
    return pose.from_position_rotation(values[:3], rotation.from_quaternion(values[3:] / length))


def _number(where: str, cells: dict[str, str], name: str) -> float:
    if name not in cells:
        raise VisionError(f"{where}: there is no column {name!r}")
    try:
        value = float(cells[name])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise VisionError(f"{where}, {name}: must be a finite number, got {cells[name]!r}")
    return value


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
