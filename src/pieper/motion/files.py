"""Trajectories in files: CSV for people and spreadsheets, JSON for other programs, NPZ for many points.

``.csv``
    A line of names, then one line for each point: ``t`` [s], then a column for each joint [rad or m], named after it; velocities and
    accelerations in columns ``NAME.velocity`` and ``NAME.acceleration``, for every joint or for none. Columns named ``1, 2, 3, ...`` are
    joints without names, in the order of the arm.
``.json``
    An object with ``t`` (m numbers), ``q`` (m lists of n numbers) and, where known, ``dq``, ``ddq`` and ``joint_names``.
``.npz``
    Arrays of the same names.
"""

from __future__ import annotations

import csv
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import replacing
from pieper.errors import ArrayError
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

FORMATS = (".csv", ".json", ".npz")

LARGEST_FILE = 500_000_000
"""Bytes of a file, unpacked, beyond which it is refused: two hours of a seven-joint arm at a kilohertz, with velocities."""

_SUFFIXES = {"dq": ".velocity", "ddq": ".acceleration"}
_KEYS = ("t", "q", "dq", "ddq", "joint_names")


def read(path: str | os.PathLike[str]) -> Trajectory:
    r"""The trajectory in a file; what it is follows from the suffix.

    Parameters
    ----------
    path : path
        A ``.csv``, ``.json`` or ``.npz`` file as described above.

    Returns
    -------
    Trajectory
        `Trajectory.in_order` puts its columns in the order of an arm.

    Raises
    ------
    ArrayError
        Another suffix, a file that is too large or malformed, or numbers that make no trajectory; the message begins with the file
        and, for CSV, the line.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> name = Path(tempfile.mkdtemp()) / "move.csv"
    >>> _ = name.write_text("t, shoulder, elbow\n0.0, 0.0, 0.0\n2.0, 1.0, 0.5\n")
    >>> move = read(name)
    >>> move, move.joint_names
    (Trajectory(2 points, 2 joints, 2 s), ('shoulder', 'elbow'))
    """
    file = Path(path)
    reader = _by_suffix(file, {".csv": _read_csv, ".json": _read_json, ".npz": _read_npz})
    size = file.stat().st_size
    if size > LARGEST_FILE:
        raise ArrayError(f"{file} must not be larger than {LARGEST_FILE // 10**6} MB, got {size // 10**6} MB")
    fields = reader(file)
    try:
        return Trajectory(**fields)
    except ArrayError as cause:
        raise ArrayError(f"{file}: {cause}") from cause


def write(trajectory: Trajectory, path: str | os.PathLike[str]) -> None:
    """Write a trajectory to a file; `read` gives it back to the last bit.

    A file of that name is replaced, and only once the new one is complete.

    Parameters
    ----------
    trajectory : Trajectory
    path : path
        Ends in ``.csv``, ``.json`` or ``.npz``.

    Raises
    ------
    ArrayError
        Another suffix, or, for CSV, names of joints that could not be told from the names of other columns.
    OSError
        The file cannot be written.
    """
    file = Path(path)
    writer = _by_suffix(file, {".csv": _write_csv, ".json": _write_json, ".npz": _write_npz})
    with replacing(file) as unfinished:
        writer(trajectory, unfinished)


def _by_suffix(file: Path, choices: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    try:
        return choices[file.suffix.lower()]
    except KeyError:
        raise ArrayError(f"a trajectory file must end in {', '.join(FORMATS)}, got {str(file)!r}") from None


# --------------------------------------------------------------------------------------------------------------------
# CSV


def _read_csv(file: Path) -> dict[str, Any]:
    try:
        with file.open(newline="", encoding="utf-8-sig") as text:
            lines = csv.reader(text, skipinitialspace=True, strict=True)
            names = next(lines, None)
            if names is None:
                raise ArrayError(f"{file}: is empty; its first line must be: t, then the names of the joints")
            columns = _columns([name.strip() for name in names], f"{file}, line 1")
            rows: list[list[float]] = [
                _numbers(row, len(names), f"{file}, line {lines.line_num}")
                for row in lines
                if row and any(cell.strip() for cell in row)
            ]
    except (UnicodeDecodeError, csv.Error) as cause:
        raise ArrayError(f"{file}: is not CSV: {cause}") from cause
    if not rows:
        raise ArrayError(f"{file}: has no points, only names")
    table = np.array(rows)
    joints = columns.pop("joint_names")
    fields: dict[str, Any] = {key: table[:, where] for key, where in columns.items()}
    if joints != [str(k + 1) for k in range(len(joints))]:
        fields["joint_names"] = joints
    return {**fields, "t": table[:, 0]}


def _columns(names: list[str], where: str) -> dict[str, Any]:
    """Which columns hold the positions, velocities and accelerations, in the order of the joints; and the joints."""
    if names[0].lower() not in ("t", "time"):
        raise ArrayError(f"{where}: the first column must be the time, t [s], got {names[0]!r}")
    at = {name: k for k, name in enumerate(names) if k}
    if len(at) < len(names) - 1:
        twice = next(name for k, name in enumerate(names) if k and at[name] != k)
        raise ArrayError(f"{where}: column {twice!r} is there twice")
    joints = [name for name in names[1:] if not name.endswith(tuple(_SUFFIXES.values()))]
    if not joints:
        raise ArrayError(f"{where}: there must be a column for each joint behind the time, got {', '.join(names)}")
    columns: dict[str, Any] = {"joint_names": joints, "q": [at[name] for name in joints]}
    for key, suffix in _SUFFIXES.items():
        given = [name for name in names[1:] if name.endswith(suffix)]
        wanted = [name + suffix for name in joints]
        if not given:
            continue
        odd = [name for name in given if name not in wanted] + [name for name in wanted if name not in given]
        if odd:
            raise ArrayError(
                f"{where}: columns that end in {suffix} must be there for every joint or for none; see {odd[0]!r}"
            )
        columns[key] = [at[name] for name in wanted]
    return columns


def _numbers(row: list[str], count: int, where: str) -> list[float]:
    if len(row) != count:
        raise ArrayError(f"{where}: must have {count} numbers, as many as there are names, got {len(row)}")
    try:
        return [float(cell) for cell in row]
    except ValueError as cause:
        raise ArrayError(f"{where}: must be numbers: {cause}") from None


def _write_csv(trajectory: Trajectory, file: Path) -> None:
    counted = [str(k + 1) for k in range(trajectory.dof)]
    joints = list(trajectory.joint_names) or counted
    odd = [name for name in trajectory.joint_names if name.endswith(tuple(_SUFFIXES.values())) or name != name.strip()]
    if trajectory.joint_names and joints == counted:
        odd = joints
    if odd:
        raise ArrayError(
            f"joint {odd[0]!r} could not be told from other columns in a CSV file; write a .json or .npz file"
        )
    names, blocks = ["t", *joints], [trajectory.t[:, None], trajectory.q]
    for key, suffix in _SUFFIXES.items():
        values = getattr(trajectory, key)
        if values is not None:
            names += [name + suffix for name in joints]
            blocks.append(values)
    with file.open("w", newline="", encoding="utf-8") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(names)
        lines.writerows(map(repr, row) for row in np.hstack(blocks).tolist())


# --------------------------------------------------------------------------------------------------------------------
# JSON and NPZ


def _read_json(file: Path) -> dict[str, Any]:
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as cause:
        raise ArrayError(f"{file}: is not JSON: {cause}") from cause
    if not isinstance(record, dict):
        raise ArrayError(f"{file}: must be an object with the keys t and q, got {type(record).__name__}")
    return _fields(record, file)


def _fields(record: dict[str, Any], file: Path) -> dict[str, Any]:
    missing = [key for key in ("t", "q") if key not in record]
    if missing:
        raise ArrayError(f"{file}: lacks {' and '.join(missing)}; it has: {', '.join(map(str, record)) or 'nothing'}")
    fields = {key: record[key] for key in _KEYS if record.get(key) is not None}
    names = fields.get("joint_names", ())
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise ArrayError(f"{file}: joint_names must be a list of names, got {names!r:.80}")
    return fields


def _write_json(trajectory: Trajectory, file: Path) -> None:
    record = {"joint_names": list(trajectory.joint_names)}
    for key in ("t", "q", "dq", "ddq"):
        values = getattr(trajectory, key)
        if values is not None:
            record[key] = values.tolist()
    file.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="utf-8")


def _read_npz(file: Path) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(file) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > LARGEST_FILE:
            raise ArrayError(
                f"{file} must not be larger than {LARGEST_FILE // 10**6} MB, got {unpacked // 10**6} MB unpacked"
            )
        with np.load(file, allow_pickle=False) as arrays:
            record: dict[str, Any] = {key: arrays[key] for key in _KEYS if key in arrays}
    except (ValueError, EOFError, zipfile.BadZipFile) as cause:
        if isinstance(cause, ArrayError):
            raise
        raise ArrayError(f"{file}: is not an NPZ file of plain arrays: {cause}") from cause
    if "joint_names" in record:
        record["joint_names"] = record["joint_names"].ravel().tolist()
    return _fields(record, file)


def _write_npz(trajectory: Trajectory, file: Path) -> None:
    arrays = {key: getattr(trajectory, key) for key in ("t", "q", "dq", "ddq") if getattr(trajectory, key) is not None}
    if trajectory.joint_names:
        arrays["joint_names"] = np.array(trajectory.joint_names)
    with file.open("wb") as binary:
        np.savez_compressed(binary, **arrays)
