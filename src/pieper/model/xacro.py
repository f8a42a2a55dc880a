"""xacro files: URDF with macros, expanded in a child process that has limits.

A xacro file is a program: it can loop for ever, grow without bound and read files. It is therefore expanded in a
separate process with a time limit, a memory limit (where the system knows one), a limit on the output, and only the
folders of the file, of its package and of the packages that were given or found open to it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.errors import MissingExtraError, XacroError
from pieper.model.package import package_of
from pieper.model.urdf import MAX_BYTES, from_urdf

if TYPE_CHECKING:
    from pieper.model.description import Description
    from pieper.model.package import PackageFolders

DEFAULT_TIMEOUT = 30.0  # [s] the largest public descriptions take 1 to 2
DEFAULT_MEMORY = 1024 * 1024 * 1024  # [bytes] of address space

_FILE_SIZE = 64 * 1024 * 1024  # [bytes] answer and messages of the child
_CHILD = Path(__file__).with_name("_xacro_child.py")
_LOOKUP = Path(__file__).with_name("package.py")
_START = "import sys; child = sys.argv[1]; sys.path[:] = sys.argv[2:]; import runpy; runpy.run_path(child, run_name='__main__')"


def is_xacro(what: object) -> bool:
    """Whether text or a file name is xacro rather than URDF.

    >>> is_xacro("arm.urdf.xacro"), is_xacro("<robot name='arm'/>")
    (True, False)
    """
    if isinstance(what, bytes):
        return b"http://www.ros.org/wiki/xacro" in what and b"<xacro:" in what
    if isinstance(what, str) and what.lstrip("\ufeff \t\r\n").startswith("<"):
        return "http://www.ros.org/wiki/xacro" in what and ("<xacro:" in what or "${" in what or "$(" in what)
    return isinstance(what, (str, os.PathLike)) and os.fspath(what).endswith(".xacro")


def from_xacro(
    what: str | os.PathLike[str],
    *,
    args: Mapping[str, object] | None = None,
    packages: PackageFolders | None = None,
    timeout: float = DEFAULT_TIMEOUT,
    memory: int = DEFAULT_MEMORY,
) -> Description:
    """Read a xacro file: `expand`, then `pieper.model.urdf.from_urdf`.

    Parameters
    ----------
    what, args, packages, timeout, memory
        As for `expand`.

    Returns
    -------
    Description
        With links, joints, limits and meshes.

    Raises
    ------
    MissingExtraError
        xacrodoc is not installed.
    XacroError
        The file cannot be expanded within its limits.
    UrdfError
        What comes out is not a well-formed robot.
    """
    urdf = expand(what, args=args, packages=packages, timeout=timeout, memory=memory)
    if _is_text(what):
        return from_urdf(urdf, packages=packages)
    return from_urdf(urdf, packages=packages, source=os.fspath(what), beside=what)


def expand(
    what: str | os.PathLike[str],
    *,
    args: Mapping[str, object] | None = None,
    packages: PackageFolders | None = None,
    timeout: float = DEFAULT_TIMEOUT,
    memory: int = DEFAULT_MEMORY,
) -> str:
    """Expand a xacro file or text to URDF text.

    Parameters
    ----------
    what : str or path
        File name, or xacro text that starts with ``<``.
    args : mapping, optional
        Values of ``<xacro:arg>``; ``True`` becomes ``true``.
    packages : mapping or iterable, optional
        Folders for ``$(find name)``, see `pieper.model.package.find_package`. Files in them may be read.
    timeout : float
        Seconds after which the expansion is stopped.
    memory : int
        Bytes of address space; counts where the system has such a limit (Linux).

    Returns
    -------
    str

    Raises
    ------
    MissingExtraError
        xacrodoc is not installed.
    XacroError
        The file is malformed, needs a package that is not found, reads a file outside its folders, or exceeds a limit.
    """
    if find_spec("xacrodoc") is None:
        raise MissingExtraError("xacrodoc", "xacro", "expanding a xacro file")
    text = what if isinstance(what, str) and _is_text(what) else None
    path = None if text is not None else _existing(what)
    source = "<string>" if path is None else os.fspath(what)
    request = {
        "path": path,
        "text": text,
        "args": {str(name): _argument(value) for name, value in (args or {}).items()},
        "packages": _plain(packages),
        "roots": _roots(path, packages),
        "lookup": str(_LOOKUP),
        "memory": int(memory),
        "seconds": max(1, int(timeout) + 1),
        "file_size": _FILE_SIZE,
        "output": MAX_BYTES,
    }
    answer = _ask(request, source, timeout)
    if "urdf" in answer:
        return answer["urdf"]
    raise XacroError(source, answer["element"], answer["reason"])


def _ask(request: dict[str, Any], source: str, timeout: float) -> dict[str, str]:
    """Run the child on one request."""
    command = [sys.executable, "-I", "-X", "utf8", "-c", _START, str(_CHILD), *(p for p in sys.path if p)]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as messages:
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=out, stderr=messages)
        try:
            child.communicate(json.dumps(request).encode(), timeout=timeout)
        except subprocess.TimeoutExpired:
            raise XacroError(
                source,
                "expansion",
                f"took longer than {timeout:g} s and was stopped; a macro may loop, or give timeout=",
            ) from None
        finally:
            if child.poll() is None:
                child.kill()
                child.wait()
        out.seek(0)
        answered = out.read(_FILE_SIZE + 1)
        messages.seek(0)
        last_words = messages.read(1_000_000).decode("utf-8", "replace").strip()[-500:]
    try:
        answer = json.loads(answered)
    except ValueError:
        raise XacroError(
            source,
            "expansion",
            f"the process ended with status {child.returncode}, probably at its memory or time limit; it said: {last_words!r}",
        ) from None
    return {str(key): str(value) for key, value in answer.items()}


def _is_text(what: str | os.PathLike[str]) -> bool:
    return isinstance(what, str) and what.lstrip("\ufeff \t\r\n").startswith("<")


def _existing(what: str | os.PathLike[str]) -> str:
    path = os.path.abspath(what)  # noqa: PTH100  keeps symbolic links
    try:
        regular = Path(path).is_file()
        size = Path(path).stat().st_size if regular else 0
    except (OSError, ValueError):
        regular, size = False, 0
    if not regular:
        raise XacroError(os.fspath(what), "file", "cannot be read: no such file; give a xacro file")
    if size > MAX_BYTES:
        raise XacroError(os.fspath(what), "file", f"is larger than {MAX_BYTES // 2**20} MiB")
    return path


def _argument(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _plain(packages: PackageFolders | None) -> dict[str, str] | list[str] | None:
    """The folders as absolute paths, in a form that JSON carries."""
    if packages is None:
        return None
    if isinstance(packages, Mapping):
        return {str(name): _absolute(folder) for name, folder in packages.items()}
    folders = [packages] if isinstance(packages, (str, os.PathLike)) else packages
    return [_absolute(folder) for folder in folders]


def _absolute(folder: str | os.PathLike[str]) -> str:
    return os.path.abspath(os.path.expanduser(folder))  # noqa: PTH100, PTH111


def _roots(path: str | None, packages: PackageFolders | None) -> list[str]:
    """Folders whose files the expansion may read; packages found on the way are added to them."""
    roots: list[str] = []
    if path is not None:
        for file in (path, os.path.realpath(path)):
            roots.append(os.path.dirname(file))  # noqa: PTH120
            package = package_of(os.path.dirname(file))  # noqa: PTH120
            if package is not None:
                roots.append(package)
    plain = _plain(packages)
    roots.extend(plain.values() if isinstance(plain, dict) else plain or [])
    return list(dict.fromkeys(roots))
