"""Files that a verb writes: never over what it reads, never over each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pieper.errors import PieperError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


def keep_apart(inputs: Iterable[str | Path | None], outputs: Mapping[str, Path | None]) -> None:
    """Check the files of a command before anything is read or written.

    Parameters
    ----------
    inputs : iterable of path or None
        What is read; what is no file (a camera, an address) is passed over.
    outputs : mapping of str to Path
        Options and the files that they name; None for an option that was not given.

    Raises
    ------
    PieperError
        An output is one of the inputs, by whatever name or link, or two outputs are the same file; the message names the option.
    """
    read = [Path(name) for name in inputs if name is not None]
    taken: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        if any(_same(path, source) for source in read):
            raise PieperError(f"{option} {path} is what is read; it would be lost, so name another file")
        other = taken.setdefault(path.resolve(), option)
        if other != option:
            raise PieperError(f"{other} and {option} both name {path}; one would be lost")


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except (OSError, ValueError):  # one of them is not there, or is no path
        return False
