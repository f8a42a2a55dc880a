"""Where a map is kept: in memory, or in a zarr folder that is never half written and says what it belongs to.

A zarr store is a group with one array for each quantity, whose chunks are those of the map, and with the question as an attribute.
Every chunk is a file of its own with a checksum, which is written beside its place and then renamed; ``reached`` comes last, so a chunk
whose ``reached`` is there is finished, whatever happened. Needs the extra ``maps`` (zarr 3, Python 3.11 or later).
"""

from __future__ import annotations

import json
import math
import secrets
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pieper._native import kernels
from pieper.errors import MapError, MissingExtraError
from pieper.workspace.map import WorkspaceMap, grid_of
from pieper.workspace.measure import QUANTITIES

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from pieper.workspace.grid import Grid
    from pieper.workspace.survey import Survey

FORMAT = "pieper workspace map"
FORMAT_VERSION = 1

MOST_IN_MEMORY = 4_000_000
"""Voxels of a map that is not stored, to bound the memory."""

_LAST = "reached"


class Store(Protocol):
    """What keeps the chunks of a map."""

    grid: Grid

    def finished(self) -> set[int]:
        """Chunks that are there."""
        ...

    def write(self, chunk: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep a chunk."""
        ...

    def map(self) -> WorkspaceMap:
        """What is there."""
        ...


class Memory:
    """A map in memory.

    Parameters
    ----------
    survey : Survey

    Raises
    ------
    MapError
        More than `MOST_IN_MEMORY` voxels.
    """

    def __init__(self, survey: Survey) -> None:
        self.grid = survey.grid
        if self.grid.voxels > MOST_IN_MEMORY:
            raise MapError(
                f"{self.grid.voxels} voxels are too many for memory (at most {MOST_IN_MEMORY}): give a store with --out MAP.zarr, "
                "or take larger voxels"
            )
        self._record = survey.record()
        self._arrays = {name: np.full(self.grid.shape, empty, dtype=kind) for name, (kind, empty) in QUANTITIES.items()}
        self._finished: set[int] = set()

    def finished(self) -> set[int]:
        """Chunks that are there."""
        return set(self._finished)

    def write(self, chunk: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep a chunk."""
        where = self.grid.slices(chunk)
        for name, array in arrays.items():
            self._arrays[name][where] = array
        self._finished.add(chunk)

    def map(self) -> WorkspaceMap:
        """What is there."""
        missing = frozenset(range(self.grid.chunks)) - self._finished
        return WorkspaceMap(self.grid, self._record, self._arrays, missing)


class ZarrStore:
    """A map in a folder. Made by `create`, `open_store` or `resume`."""

    def __init__(self, path: Path, record: dict[str, Any], arrays: dict[str, Any]) -> None:
        self.path = path
        self.record = record
        self.grid = grid_of(record)
        self._arrays = arrays

    def finished(self) -> set[int]:
        """Chunks that are there."""
        shape = self.grid.chunk_shape
        found = set()
        for place in _files(self.path / _LAST / "c"):
            if all(0 <= i < n for i, n in zip(place, shape, strict=True)):
                found.add(int(np.ravel_multi_index(place, shape)))
        return found

    def write(self, chunk: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep a chunk; where the disk is full, or the folder gone, nothing of it counts."""
        where = self.grid.slices(chunk)
        for name in QUANTITIES:
            self._arrays[name][where] = arrays[name]

    def map(self) -> WorkspaceMap:
        """What is there; damaged chunks are found when they are read."""
        missing = frozenset(range(self.grid.chunks)) - self.finished()
        readers = {name: _Reader(self.path, name, array) for name, array in self._arrays.items()}
        return WorkspaceMap(self.grid, self.record, readers, missing)

    def check(self) -> None:
        """Read every finished chunk once; raises MapError naming the one that is damaged."""
        found = self.map()
        for chunk in sorted(self.finished()):
            where = self.grid.slices(chunk)
            for name in QUANTITIES:
                found.arrays[name][where]


class _Reader:
    """An array on disk; errors name the store."""

    def __init__(self, path: Path, name: str, array: Any) -> None:
        self._path, self._name, self._array = path, name, array

    def __getitem__(self, where: Any) -> Any:
        try:
            return self._array[where]
        except Exception as error:  # each codec has errors of its own
            span = ", ".join(f"{part.start}:{part.stop}" for part in where)
            raise MapError(
                f"{self._path}: damaged: a chunk of {self._name!r} within voxels [{span}] cannot be read ({_first_line(error)}); "
                f"remove its file below {self._path / _LAST / 'c'} and go on with --resume, or make the map anew"
            ) from error


def create(path: str | os.PathLike[str], survey: Survey) -> ZarrStore:
    """A new store for a question.

    Raises
    ------
    MapError
        Something is at that place already, or its folder is not there.
    MissingExtraError
        zarr is not installed.
    OSError
        The folder cannot be written to, or the disk is full; nothing is left behind.
    """
    zarr = _zarr()
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise MapError(f"{target} is there already; go on with it with --resume, remove it, or name another")
    if not target.parent.is_dir():
        raise MapError(f"{target}: no such folder: {target.parent}")
    unfinished = target.with_name(f".{target.name}.{secrets.token_hex(4)}.unfinished")
    record = _plain(survey.record())
    grid = survey.grid
    try:
        attributes = {"format": FORMAT, "format_version": FORMAT_VERSION, "record": record}
        unfinished.mkdir()
        group = zarr.create_group(str(unfinished), attributes=attributes)
        for name, (kind, empty) in QUANTITIES.items():
            group.create_array(
                name,
                shape=grid.shape,
                chunks=tuple(min(grid.chunk, n) for n in grid.shape),
                dtype=kind,
                fill_value=empty,
                compressors=zarr.codecs.ZstdCodec(level=1, checksum=True),
                config={"write_empty_chunks": True},
                dimension_names=("x", "y", "z"),
            )
        unfinished.replace(target)
    except OSError as error:
        raise _about(error, target) from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return open_store(target)


def open_store(path: str | os.PathLike[str]) -> ZarrStore:
    """A store that is there.

    Raises
    ------
    MapError
        It is no store, a store of something else, of another version, or damaged; the message says which.
    MissingExtraError
        zarr is not installed.
    """
    zarr = _zarr()
    target = Path(path)
    if not target.exists():
        raise MapError(f"{target} is not there")
    if not (target / "zarr.json").is_file():
        raise MapError(f"{target} is no zarr store of version 3: it holds no zarr.json")
    try:
        group = zarr.open_group(str(target), mode="r+")
        attributes = dict(group.attrs)
    except Exception as error:  # whatever is in the file
        raise MapError(f"{target}: zarr.json cannot be read ({_first_line(error)})") from error
    if attributes.get("format") != FORMAT:
        raise MapError(
            f"{target} is a zarr store, but no map made by pieper workspace: its format is {attributes.get('format')!r}"
        )
    if attributes.get("format_version") != FORMAT_VERSION:
        raise MapError(
            f"{target} has version {attributes.get('format_version')!r} of the format; this pieper reads version {FORMAT_VERSION}"
        )
    record = attributes.get("record")
    try:
        if not isinstance(record, dict):
            raise TypeError("no record")
        grid = grid_of(record)
        if math.prod(grid.shape) < 1 or grid.chunk < 1 or not 0.0 < grid.voxel < math.inf or int(record["samples"]) < 1:
            raise ValueError("no voxels")
    except (KeyError, TypeError, ValueError) as error:
        raise MapError(f"{target}: the record of the question is damaged ({error!r})") from error
    arrays = {}
    for name, (kind, _) in QUANTITIES.items():
        try:
            array = group[name]
        except Exception as error:
            raise MapError(
                f"{target}: the array {name!r} is missing or cannot be read ({_first_line(error)})"
            ) from error
        chunks = tuple(min(grid.chunk, n) for n in grid.shape)
        got = (getattr(array, "shape", None), getattr(array, "chunks", None), str(getattr(array, "dtype", "")))
        if got != (grid.shape, chunks, str(np.dtype(kind))):
            raise MapError(
                f"{target}: the array {name!r} does not fit the record: expected shape {grid.shape}, chunks {chunks} and "
                f"{np.dtype(kind)}, got shape {got[0]}, chunks {got[1]} and {got[2] or 'no array'}"
            )
        arrays[name] = array.with_config({"write_empty_chunks": True})
    return ZarrStore(target, record, arrays)


def like(path: str | os.PathLike[str], survey: Survey) -> Survey:
    """The question with the vector instructions that a store was begun with, if this processor has them; else as it is."""
    told = open_store(path).record.get("instructions")
    return replace(survey, instructions=told) if told in kernels.instruction_sets() else survey


def resume(path: str | os.PathLike[str], survey: Survey) -> ZarrStore:
    """The store of a question that was begun; what is finished in it is read once, to see that it is whole.

    Raises
    ------
    MapError
        As `open_store`, or the store answers another question; the message says in what they differ.
    """
    store = open_store(path)
    asked, there = _plain(survey.record()), store.record
    other = [key for key in asked if asked[key] != there.get(key)]
    if other:
        differences = "; ".join(
            f"{key} is {_short(there.get(key))} there and {_short(asked[key])} here" for key in other
        )
        raise MapError(f"{store.path} belongs to another question: {differences}. Ask the same, or name another store")
    store.check()
    return store


def _files(folder: Path) -> Iterator[tuple[int, int, int]]:
    """Places of the chunks below ``c``, which are files ``c/i/j/k``."""
    if not folder.is_dir():
        return
    for first in folder.iterdir():
        if not first.name.isdecimal():
            continue
        for second in first.iterdir():
            if not second.name.isdecimal():
                continue
            for third in second.iterdir():
                if third.name.isdecimal():
                    yield int(first.name), int(second.name), int(third.name)


def _zarr() -> Any:
    try:
        import zarr
        import zarr.codecs
    except ImportError as cause:
        raise MissingExtraError("zarr", "maps", "keeping a map in a file") from cause
    if int(zarr.__version__.split(".")[0]) < 3:
        raise MissingExtraError(f"zarr 3 (this is {zarr.__version__})", "maps", "keeping a map in a file")
    return zarr


def _plain(record: dict[str, Any]) -> dict[str, Any]:
    """As it comes back from a file."""
    plain: dict[str, Any] = json.loads(json.dumps(record))
    return plain


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def _about(error: OSError, path: Path) -> OSError:
    """The same, with the name that was asked for."""
    return type(error)(error.errno, error.strerror, str(path)) if error.errno is not None else error
