"""What was tracked, in files: tables as CSV, JSON lines or Parquet, and the video with everything drawn in.

A table has a row for each track in each frame; a frame in which nothing is tracked has one row without a track, so that it is known to
have been looked at. JSON lines have one line for each frame instead.

===========================  ===============================================================================================
`frame`, `time`              number of the frame, time of its capture [s]
`track`, `kind`, `name`      number of the track, ``robot``, ``ball`` or ``marker``, and which one, where that is known
`state`                      ``seen``, ``hidden``, or once at the end ``lost``
`x`, `y`, `heading`          filtered; in the unit of the file, and [rad]
`vx`, `vy`, `turn_rate`      per second
`xx`, `xy`, `yy`, `hh`       covariance of x and y, and variance of the heading [rad^2]
===========================  ===============================================================================================

What the file is comes first: ``{"format": "pieper tracks 1", "unit": "m", "source": "clip.mp4"}``, in CSV after a ``#`` (for pandas,
``comment="#"``), in JSON lines as the first line, in Parquet as the metadata ``pieper``.

CSV and JSON lines are written frame by frame, so they are good at any time up to the last line. Parquet and video become a file when
they are closed, by Ctrl-C too.
"""

from __future__ import annotations

import csv
import io
import json
import math
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib import import_module
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

from pieper.atomic_file import replacing
from pieper.errors import MissingExtraError, VisionError
from pieper.perception.video_file import VideoFile, naming, video_path, with_suffix

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from pieper.perception.estimate import Estimate

__all__ = [
    "COLUMNS",
    "FORMAT",
    "KINDS",
    "STATES",
    "TABLES",
    "TrackFile",
    "TrackRow",
    "TrackWriter",
    "TrackedFrame",
    "VideoFile",
    "continue_tracks",
    "create_tracks",
    "read_tracks",
    "table_path",
    "track_rows",
    "video_path",
]

FORMAT = "pieper tracks 1"
TABLES = (".csv", ".jsonl", ".parquet")
COLUMNS = (
    "frame",
    "time",
    "track",
    "kind",
    "name",
    "state",
    "x",
    "y",
    "heading",
    "vx",
    "vy",
    "turn_rate",
    "xx",
    "xy",
    "yy",
    "hh",
)
_WHOLE, _WORDS = ("frame", "track"), ("kind", "name", "state")
KINDS, STATES = ("robot", "ball", "marker"), ("seen", "hidden", "lost")
_DIGITS = 9  # of all but the time, which may count from 1970
_GROUP = 4096  # rows that Parquet writes at once


@dataclass(frozen=True)
class TrackRow:
    """One track in one frame; the columns of a table."""

    frame: int
    time: float
    track: int | None
    kind: str | None = None
    name: str | None = None
    state: str | None = None
    x: float | None = None
    y: float | None = None
    heading: float | None = None
    vx: float | None = None
    vy: float | None = None
    turn_rate: float | None = None
    xx: float | None = None
    xy: float | None = None
    yy: float | None = None
    hh: float | None = None

    @classmethod
    def of(cls, frame: int, estimate: Estimate) -> TrackRow:
        """Return the row of an estimate."""
        P = estimate.covariance
        return cls(
            frame,
            float(estimate.time),
            estimate.track,
            estimate.kind,
            estimate.name,
            estimate.state,
            _short(estimate.position[0]),
            _short(estimate.position[1]),
            _short(estimate.heading),
            _short(estimate.velocity[0]),
            _short(estimate.velocity[1]),
            _short(estimate.turn_rate),
            _short(P[0, 0]),
            _short(P[0, 1]),
            _short(P[1, 1]),
            _short(P[2, 2]) if estimate.heading is not None else None,
        )


@dataclass(frozen=True)
class TrackedFrame:
    """The tracks of one frame."""

    index: int
    time: float
    rows: tuple[TrackRow, ...]


@dataclass(frozen=True)
class TrackFile:
    """A table of tracks.

    Attributes
    ----------
    unit : str
        Of places: ``"m"`` or ``"px"``.
    source : str
        What was tracked.
    frames : tuple of TrackedFrame
    """

    unit: str
    source: str
    frames: tuple[TrackedFrame, ...]


class TrackWriter(Protocol):
    """Takes the estimates of frames, one frame after another."""

    def write(self, index: int, time: float, estimates: Iterable[Estimate]) -> None:
        """Write a frame."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


def track_rows(index: int, time: float, estimates: Iterable[Estimate]) -> list[TrackRow]:
    """Return the rows of a frame; one without a track where there are no estimates.

    Parameters
    ----------
    index : int
        Number of the frame.
    time : float
        [s]
    estimates : iterable of Estimate
        What is believed at that time.

    Returns
    -------
    list of TrackRow
    """
    return [TrackRow.of(index, e) for e in estimates] or [TrackRow(index, float(time), None)]


def create_tracks(path: str | os.PathLike[str], *, unit: str, source: str = "") -> TrackWriter:
    """Begin a table of tracks; what it is follows from the suffix.

    Parameters
    ----------
    path : path
        Ends in ``.csv``, ``.jsonl`` or ``.parquet``. A file of that name is replaced.
    unit : str
        Of places: ``"m"`` or ``"px"``.
    source : str
        What is tracked.

    Returns
    -------
    TrackWriter
        Takes estimates frame by frame; close it, or use it in a ``with`` statement.

    Raises
    ------
    VisionError
        Another suffix.
    MissingExtraError
        Parquet is wanted, and PyArrow is not installed.
    OSError
        It cannot be written there.
    """
    file = table_path(path)
    head = {"format": FORMAT, "unit": unit, "source": source}
    if file.suffix.lower() == ".parquet":
        return _Parquet(file, head, ())
    return _Lines(file, head, file.suffix.lower(), None)


def continue_tracks(path: str | os.PathLike[str], *, unit: str, source: str = "") -> tuple[TrackWriter, TrackFile]:
    """Go on with a table that was left unfinished.

    A half-written last line is dropped. Of CSV the last frame goes too, since nothing tells whether all its rows are there.

    Parameters
    ----------
    path : path
        The table.
    unit, source
        As for `create_tracks`; the same as when it was begun.

    Returns
    -------
    TrackWriter
        Appends to what was kept.
    TrackFile
        What was kept.

    Raises
    ------
    VisionError
        It is not a table of tracks, or one of another unit or another source.
    """
    file = table_path(path)
    kept, end = _read(file, partial=True)
    for what, is_, wanted in (("unit", kept.unit, unit), ("source", kept.source, source)):
        if is_ != wanted:
            raise VisionError(
                f"{file} has the {what} {is_!r}, and now it is {wanted!r}; it cannot be continued with that"
            )
    head = {"format": FORMAT, "unit": unit, "source": source}
    if file.suffix.lower() == ".parquet":
        return _Parquet(
            file, head, [row for f in kept.frames for row in f.rows or [TrackRow(f.index, f.time, None)]]
        ), kept
    return _Lines(file, head, file.suffix.lower(), end), kept


def read_tracks(path: str | os.PathLike[str]) -> TrackFile:
    """Read a table of tracks back. A half-written last line is left out.

    Raises
    ------
    VisionError
        It is not one; the message names the line.
    """
    return _read(table_path(path), partial=False)[0]


def table_path(path: str | os.PathLike[str]) -> Path:
    """Return the path, if a table can have that name."""
    return with_suffix(path, TABLES, "a table of tracks")


class _Lines:
    """CSV and JSON lines: a frame is written at once, and passed on to the system at once."""

    def __init__(self, path: Path, head: dict[str, str], suffix: str, keep: int | None) -> None:
        self._csv, self._path = suffix == ".csv", path
        self._file: BinaryIO
        if keep is None:
            self._file = path.open("wb")
            first = json.dumps(head)
            self._put(f"# {first}\n{','.join(COLUMNS)}\n" if self._csv else f"{first}\n")
        else:
            self._file = path.open("r+b")
            self._file.truncate(keep)
            self._file.seek(keep)

    def write(self, index: int, time: float, estimates: Iterable[Estimate]) -> None:
        rows = track_rows(index, time, estimates)
        if not self._csv:
            tracks = [{c: getattr(row, c) for c in COLUMNS[2:]} for row in rows if row.track is not None]
            self._put(json.dumps({"frame": index, "time": float(time), "tracks": tracks}, allow_nan=False) + "\n")
            return
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        for row in rows:
            table.writerow(
                ["" if (v := getattr(row, c)) is None else repr(v) if isinstance(v, float) else v for c in COLUMNS]
            )
        self._put(text.getvalue())

    def _put(self, text: str) -> None:
        with naming(self._path):
            self._file.write(text.encode())
            self._file.flush()

    def close(self) -> None:
        self._file.close()


class _Parquet:
    """Written beside the file, which it becomes when closed."""

    def __init__(self, path: Path, head: dict[str, str], kept: Iterable[TrackRow]) -> None:
        arrow, parquet = _pyarrow()
        kinds = {
            **{c: arrow.float64() for c in COLUMNS},
            **{c: arrow.int64() for c in _WHOLE},
            **{c: arrow.string() for c in _WORDS},
        }
        self._schema = arrow.schema([(c, kinds[c]) for c in COLUMNS], metadata={"pieper": json.dumps(head)})
        self._arrow, self._path, self._rows = arrow, path, list(kept)
        self._stack = ExitStack()
        unfinished = self._stack.enter_context(replacing(path))
        with naming(path):
            self._writer: Any = parquet.ParquetWriter(str(unfinished), self._schema)

    def write(self, index: int, time: float, estimates: Iterable[Estimate]) -> None:
        self._rows += track_rows(index, time, estimates)
        if len(self._rows) >= _GROUP:
            self._flush()

    def _flush(self) -> None:
        columns = {c: [getattr(row, c) for row in self._rows] for c in COLUMNS}
        with naming(self._path):
            self._writer.write_table(self._arrow.table(columns, schema=self._schema))
        self._rows.clear()

    def close(self) -> None:
        if self._writer is None:
            return
        with self._stack, naming(self._path):
            self._flush()
            self._writer.close()
            self._writer = None


def _short(value: Any) -> float | None:
    """A number in nine digits; None for none and for what is not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{float(value):.{_DIGITS}g}")


def _pyarrow() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError as cause:
        raise MissingExtraError("PyArrow", "parquet", "a Parquet file") from cause


def _read(file: Path, *, partial: bool) -> tuple[TrackFile, int]:
    """What a file holds, and the byte after it. With `partial`, what may be incomplete is left out."""
    if file.suffix.lower() == ".parquet":
        return _read_parquet(file), 0
    lines, end = [], 0
    with file.open("rb") as raw:
        for line in raw:
            if line.endswith(b"\n"):
                lines.append((line, end))
                end += len(line)
    head = _head(file, lines[0][0].lstrip(b"# ") if lines else b"")
    body = lines[2:] if file.suffix.lower() == ".csv" else lines[1:]
    if file.suffix.lower() == ".csv" and len(lines) > 1 and tuple(lines[1][0].decode().strip().split(",")) != COLUMNS:
        raise VisionError(f"{file}: line 2 must name the columns {','.join(COLUMNS)}")
    if file.suffix.lower() == ".jsonl":
        frames = [_parsed(file, number, _json_frame, line) for number, (line, _) in enumerate(body, start=2)]
        return TrackFile(*head, _in_order(file, frames)), end
    if len(lines) < 2 and partial:
        raise VisionError(f"{file} ends before its names of columns; remove it, and begin again")
    rows = [_parsed(file, number, _csv_row, line) for number, (line, _) in enumerate(body, start=3)]
    if partial and rows:
        last = rows[-1].frame
        whole = sum(row.frame != last for row in rows)
        rows, end = rows[:whole], body[whole][1]
    return TrackFile(*head, _by_frame(file, rows)), end


def _head(file: Path, line: bytes | str) -> tuple[str, str]:
    with suppress(ValueError, KeyError, TypeError):
        head = json.loads(line)
        if head["format"] == FORMAT:
            return str(head["unit"]), str(head["source"])
    raise VisionError(f"{file}: line 1 does not say that this is a {FORMAT!r} file")


def _parsed(file: Path, number: int, parse: Any, line: bytes) -> Any:
    try:
        return parse(line.decode())
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        raise VisionError(f"{file}: line {number} is not of a {FORMAT!r} file: {cause}") from cause


def _json_frame(line: str) -> TrackedFrame:
    record = json.loads(line)
    index, time = int(record["frame"]), float(record["time"])
    rows = tuple(_checked(TrackRow(index, time, **{c: track[c] for c in COLUMNS[2:]})) for track in record["tracks"])
    return TrackedFrame(index, time, rows)


def _csv_row(line: str) -> TrackRow:
    cells = next(csv.reader([line]))
    if len(cells) != len(COLUMNS):
        raise ValueError(f"{len(cells)} cells instead of {len(COLUMNS)}")
    values: dict[str, Any] = dict(zip(COLUMNS, cells, strict=True))
    for column, text in values.items():
        if text == "":
            values[column] = None
        elif column not in _WORDS:
            values[column] = int(text) if column in _WHOLE else float(text)
    return _checked(TrackRow(**values))


def _read_parquet(file: Path) -> TrackFile:
    arrow, parquet = _pyarrow()
    try:
        table = parquet.read_table(str(file))
    except arrow.ArrowInvalid as cause:
        raise VisionError(f"{file} is not a Parquet file: {cause}") from cause
    head = _head(file, (table.schema.metadata or {}).get(b"pieper", b""))
    if tuple(table.column_names) != COLUMNS:
        raise VisionError(f"{file} must have the columns {', '.join(COLUMNS)}, got {', '.join(table.column_names)}")
    return TrackFile(*head, _by_frame(file, [_parsed_row(file, n, row) for n, row in enumerate(table.to_pylist())]))


def _parsed_row(file: Path, number: int, row: dict[str, Any]) -> TrackRow:
    try:
        return _checked(TrackRow(**row))
    except (ValueError, TypeError) as cause:
        raise VisionError(f"{file}: row {number} is not of a {FORMAT!r} file: {cause}") from cause


def _checked(row: TrackRow) -> TrackRow:
    """The row, if a tracker can have written it."""
    for column in COLUMNS[:2] + (COLUMNS[6:] if row.track is not None else ()):
        value = getattr(row, column)
        if value is not None and not (isinstance(value, (int, float)) and math.isfinite(value)):
            raise ValueError(f"{column} must be a finite number, got {value!r}")
    if row.track is not None:
        for column, known in (("kind", KINDS), ("state", STATES)):
            if getattr(row, column) not in known:
                raise ValueError(f"{column} must be one of {', '.join(known)}, got {getattr(row, column)!r}")
        for column in ("xx", "yy", "hh"):
            if (getattr(row, column) or 0.0) < 0:
                raise ValueError(f"{column} is a variance and must not be negative, got {getattr(row, column)!r}")
    return row


def _in_order(file: Path, frames: Sequence[TrackedFrame]) -> tuple[TrackedFrame, ...]:
    for before, after in pairwise(frames):
        if after.index <= before.index:
            raise VisionError(f"{file}: frame {after.index} comes after frame {before.index}; frames must go forward")
    return tuple(frames)


def _by_frame(file: Path, rows: Iterable[TrackRow]) -> tuple[TrackedFrame, ...]:
    frames = []
    for _, group in groupby(rows, key=lambda row: row.frame):
        members = tuple(group)
        tracked = tuple(row for row in members if row.track is not None)
        frames.append(TrackedFrame(members[0].frame, members[0].time, tracked))
    return _in_order(file, frames)
