"""Files that are written whole or not at all: beside their name first, then in its place.

Whoever reads the file sees the old one or the new one, never a part, also when the disk is full, the program is stopped, or the machine
is switched off: the bytes are on the disk before the name is given to them.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_LONGEST = 60  # characters of the name that the unfinished file shows; names of files end at 255 bytes


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A name beside `path` to write to: it becomes `path` when all went well, and is removed otherwise, Ctrl-C included.

    A link stays a link, and the file that it leads to is replaced. A file that is replaced keeps its permissions, a new one gets
    those of any new file. What is no file, such as ``/dev/stdout`` or a pipe, is written to once all is there.

    Parameters
    ----------
    path : path

    Yields
    ------
    Path
        In the same folder, hidden, with the same suffix, since writers of pictures and films go by it.

    Raises
    ------
    OSError
        The folder is missing, or nothing can be written there; the name in it is the one that was asked for.

    Examples
    --------
    >>> name = Path(tempfile.mkdtemp()) / "picture.png"
    >>> with replacing(name) as unfinished:
    ...     _ = unfinished.write_bytes(b"done")
    >>> name.read_bytes(), len(list(name.parent.iterdir()))
    (b'done', 1)
    """
    asked = Path(path)
    target = _target(asked)
    mode = _mode(target)
    if mode is not None and not stat.S_ISREG(mode):
        with _into(target) as unfinished:
            yield unfinished
        return
    unfinished = target.with_name(
        f".{target.stem[:_LONGEST]}.{secrets.token_hex(4)}.unfinished{target.suffix[:_LONGEST]}"
    )
    try:
        yield unfinished
        _onto_the_disk(unfinished)
        if mode is not None:
            unfinished.chmod(stat.S_IMODE(mode))
        unfinished.replace(target)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(unfinished)):
            raise type(error)(error.errno, error.strerror, str(asked)) from error  # the name that was asked for
        raise
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)


def check_place(path: str | os.PathLike[str]) -> None:
    """See that a file can be written there, before work begins that would be lost; nothing is left behind.

    Raises
    ------
    OSError
        As from `replacing`.
    """
    asked = Path(path)
    target = _target(asked)
    mode = _mode(target)
    if mode is not None and not stat.S_ISREG(mode):
        return
    try:
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(asked)) from error


def write_bytes(path: str | os.PathLike[str], raw: bytes) -> None:
    """Write a file, whole or not at all; see `replacing`."""
    with replacing(path) as unfinished:
        unfinished.write_bytes(raw)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file in UTF-8, whole or not at all; see `replacing`."""
    write_bytes(path, text.encode())


def _target(asked: Path) -> Path:
    """What is to be replaced: the file itself, or that which a link leads to."""
    if asked.is_dir():
        raise IsADirectoryError(21, "is a folder, not a file", str(asked))
    target = asked.resolve() if asked.is_symlink() else asked
    if not target.parent.is_dir():
        raise FileNotFoundError(2, "no such folder", str(target.parent))
    return target


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except OSError:
        return None


@contextlib.contextmanager
def _into(device: Path) -> Iterator[Path]:
    """A file elsewhere, whose bytes go into what is no file."""
    folder = Path(tempfile.mkdtemp())
    try:
        unfinished = folder / f"unfinished{device.suffix}"
        yield unfinished
        with unfinished.open("rb") as source, device.open("wb") as sink:
            shutil.copyfileobj(source, sink)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(device)
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _onto_the_disk(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())
