"""Measured positions and poses of a tip as a CSV file: one row a measurement.

The first line names the columns: the joints of the arm, or ``q1 ... qn`` [rad or m]; ``x y z`` [m]; for poses also ``qx qy qz qw``, a
quaternion with the scalar last. Other columns are passed over, empty lines and lines that begin with ``#`` too.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.atomic_file import write_text
from pieper.errors import ArrayError, DescriptionError
from pieper.spatial import rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]

_POSITION, _QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_UNIT = 1e-2  # a quaternion printed with three digits is of unit length to this


def read_measurements(path: str | Path, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Joint values and what was measured.

    Parameters
    ----------
    path : str or path
    chain : Chain
        Whose joints the columns name.

    Returns
    -------
    q : (k, n) array
        Joint values as the file has them.
    measured : (k, 3) or (k, 4, 4) array
        Positions, or poses if the file has quaternions [m].

    Raises
    ------
    DescriptionError
        A column is missing or twice there, a value is no finite number; the message names the line and the column.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as cause:
        raise DescriptionError(str(path), "file", "is not text in UTF-8; save it as CSV in that encoding") from cause
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise DescriptionError(str(path), "file", "is empty; its first line must name the columns")
    header = [name.strip() for name in next(csv.reader([lines[0][1]], delimiter=_separator(lines[0][1])))]
    joints = _joint_columns(str(path), header, chain)
    has_poses = any(name in header for name in _QUATERNION)
    wanted = [*joints, *_POSITION, *(_QUATERNION if has_poses else ())]
    for name in wanted:
        if header.count(name) != 1:
            count = "no column" if name not in header else f"{header.count(name)} columns"
            raise DescriptionError(
                str(path), "header", f"there must be one column {name!r}, got {count}: {', '.join(header)}"
            )
    places = [header.index(name) for name in wanted]
    rows = [
        _row(str(path), number, line, header, places, separator=_separator(lines[0][1])) for number, line in lines[1:]
    ]
    if not rows:
        raise DescriptionError(str(path), "file", "holds no measurements, only the names of the columns")
    table = np.array(rows)
    n = chain.dof
    if not has_poses:
        return table[:, :n], table[:, n:]
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3, 3] = table[:, n : n + 3]
    lengths = np.linalg.norm(table[:, n + 3 :], axis=1)
    for (number, _), length in zip(lines[1:], lengths, strict=True):
        if abs(length - 1.0) > _UNIT:
            raise DescriptionError(
                str(path), f"line {number}", f"qx qy qz qw must be of length 1, got length {length:.4g}"
            )
    T[:, :3, :3] = rotation.from_quaternion(table[:, n + 3 :] / lengths[:, None])
    return table[:, :n], T


def write_measurements(path: str | Path, chain: Chain, q: FloatArray, measured: FloatArray | None = None) -> None:
    """Write joint values and what was measured; without it the columns stay empty, to be filled in.

    Parameters
    ----------
    path : path
        Is written as CSV.
    chain : Chain
        Whose joint names head the columns.
    q : (k, n) array
        Joint values [rad or m].
    measured : (k, 3) or (k, 4, 4) array, optional
        Positions or poses of the tip [m, -].

    Raises
    ------
    ArrayError
        Shapes that do not go together.
    """
    names = [*chain.joint_names, *_POSITION]
    if q.ndim != 2 or q.shape[1] != chain.dof or (measured is not None and len(measured) != len(q)):
        raise ArrayError(f"q must have shape (k, {chain.dof}), and measured as many rows, got {q.shape}")
    told: list[list[str]]
    if measured is None:
        told = [[""] * 3 for _ in q]
    elif measured.ndim == 2:
        told = [[repr(float(value)) for value in row] for row in measured]
    else:
        names += _QUATERNION
        whole = np.hstack([measured[:, :3, 3], rotation.as_quaternion(measured[:, :3, :3])])
        told = [[repr(float(value)) for value in row] for row in whole]
    lines = [",".join(names)]
    lines += [",".join([*(repr(float(value)) for value in row), *rest]) for row, rest in zip(q, told, strict=True)]
    write_text(path, "\n".join(lines) + "\n")


def _separator(header: str) -> str:
    return max(",;\t", key=header.count)


def _joint_columns(file: str, header: Sequence[str], chain: Chain) -> list[str]:
    """Names of the columns of joint values: those of the joints, or ``q1 ... qn``."""
    numbered = [f"q{i + 1}" for i in range(chain.dof)]
    if all(name in header for name in chain.joint_names):
        return list(chain.joint_names)
    if all(name in header for name in numbered):
        return numbered
    missing = [name for name in chain.joint_names if name not in header]
    raise DescriptionError(
        file,
        "header",
        f"no column for {', '.join(missing)}; columns must be named after the joints of {chain.name!r} or {numbered[0]} ... "
        f"{numbered[-1]}, got: {', '.join(header)}",
    )


def _row(
    file: str, number: int, line: str, header: Sequence[str], places: Sequence[int], *, separator: str
) -> list[float]:
    cells = next(csv.reader([line], delimiter=separator))
    if len(cells) != len(header):
        raise DescriptionError(file, f"line {number}", f"has {len(cells)} values for {len(header)} columns")
    values = []
    for place in places:
        try:
            value = float(cells[place])
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise DescriptionError(
                file,
                f"line {number}, column {header[place]!r}",
                f"must be a finite number, got {cells[place].strip()!r}",
            )
        values.append(value)
    return values
