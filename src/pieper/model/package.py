"""Where ROS packages and the files of a description lie: ``package://name/path`` without a ROS installation.

Packages are looked for in this order: folders given by the caller, folders above and beside the description file,
``ROS_PACKAGE_PATH``, then ``AMENT_PREFIX_PATH`` (``<prefix>/share/<name>``).

Only the standard library is used here, because the xacro child process loads this file alone.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

PackageFolders = Mapping[str, "str | os.PathLike[str]"] | Iterable["str | os.PathLike[str]"]
"""Folders of packages: a mapping from package name to folder, or folders that are packages or hold packages."""

_NAME = re.compile(r"\w[\w.-]*")  # no hidden folder is a package
_LEVELS_WITHOUT_MANIFEST = 3  # folders above the file in which a sibling without package.xml still counts as a package


def find_package(
    name: str,
    *,
    packages: PackageFolders | None = None,
    beside: str | os.PathLike[str] | None = None,
) -> str | None:
    """The folder of a ROS package, or None.

    Parameters
    ----------
    name : str
        Package name.
    packages : mapping or iterable, optional
        Mapping from names to folders, or folders that are packages or hold packages.
    beside : path, optional
        A file, usually the description; its parent folders and their neighbours are searched.

    Returns
    -------
    str or None
        The folder.

    Examples
    --------
    >>> find_package("no_such_package_anywhere") is None
    True
    """
    if not _NAME.fullmatch(name):
        return None
    for folder in _candidates(name, packages, beside):
        if _is_folder(folder):
            return os.path.normpath(os.path.abspath(folder))  # noqa: PTH100  keeps symbolic links, Path.resolve does not
    return None


def resolve(
    uri: str,
    *,
    packages: PackageFolders | None = None,
    beside: str | os.PathLike[str] | None = None,
) -> str | None:
    """The file that a mesh name in a description means, or None when there is none.

    ``package://name/path`` is looked up in its package and may not lead out of it; ``file://`` and absolute paths are
    taken as they are; other names are relative to the folder of `beside`.

    Parameters
    ----------
    uri : str
        As written in the description.
    packages, beside
        As for `find_package`.

    Returns
    -------
    str or None
        The file.
    """
    if "\0" in uri or len(uri) > 4096:
        return None
    if uri.startswith(("package://", "model://")):
        name, _, inside = uri.split("://", 1)[1].partition("/")
        folder = find_package(name, packages=packages, beside=beside)
        if folder is None:
            return None
        path = os.path.normpath(os.path.join(folder, inside))  # noqa: PTH118
        return path if path.startswith(os.path.join(folder, "")) and _is_file(path) else None  # noqa: PTH118
    if uri.startswith("file://"):
        try:
            path = unquote(urlsplit(uri).path)
        except ValueError:
            return None
        return path if "\0" not in path and _is_file(path) else None
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", uri):
        return None
    if beside is not None and not Path(uri).is_absolute():
        uri = os.path.join(Path(beside).parent, uri)  # noqa: PTH118
    elif not Path(uri).is_absolute():
        return None
    return os.path.normpath(uri) if _is_file(uri) else None


def package_of(path: str | os.PathLike[str]) -> str | None:
    """The nearest folder at or above `path` that holds a ``package.xml``, or None."""
    absolute = Path(os.path.abspath(path))  # noqa: PTH100
    for folder in (absolute, *absolute.parents):
        if _is_file(folder / "package.xml"):
            return str(folder)
    return None


def _candidates(name: str, packages: PackageFolders | None, beside: str | os.PathLike[str] | None) -> Iterator[Path]:
    if isinstance(packages, Mapping):
        if name in packages:
            yield _home(packages[name])
    elif packages is not None:
        for folder in [packages] if isinstance(packages, (str, os.PathLike)) else packages:
            yield from _in_workspace(name, _home(folder))
    if beside is not None:
        yield from _above(name, Path(os.path.abspath(beside)))  # noqa: PTH100
    for entry in _paths_in("ROS_PACKAGE_PATH"):
        yield from _in_workspace(name, entry)
    for prefix in _paths_in("AMENT_PREFIX_PATH"):
        yield prefix / "share" / name


def _home(folder: str | os.PathLike[str]) -> Path:
    return Path(os.path.expanduser(folder))  # noqa: PTH111  which raises where there is no home


def _paths_in(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _in_workspace(name: str, folder: Path) -> Iterator[Path]:
    """The folder itself, a folder in it, or one level further down, as in ``src/<repository>/<package>``."""
    if _is_named(folder, name):
        yield folder
    yield folder / name
    yield folder / "share" / name
    yield folder / "src" / name
    try:
        inside = sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    except OSError:
        return
    for entry in inside:
        if _is_file(entry / "package.xml") and _is_named(entry, name):
            yield entry
    for entry in inside:
        yield entry / name


def _above(name: str, file: Path) -> Iterator[Path]:
    """Folders above the file that are the package, or hold it beside the file's own package."""
    for level, folder in enumerate(file.parents):
        if _is_named(folder, name):
            yield folder
        sibling = folder / name
        near = level < _LEVELS_WITHOUT_MANIFEST and folder != folder.parent
        if near or _is_file(sibling / "package.xml"):
            yield sibling


def _is_named(folder: Path, name: str) -> bool:
    if Path(os.path.abspath(folder)).name == name:  # noqa: PTH100
        return True
    try:
        with (folder / "package.xml").open("rb") as manifest:
            head = manifest.read(65536).decode("utf-8", "replace")
    except OSError:
        return False
    found = re.search(r"<name>\s*([\w.-]+)\s*</name>", head)
    return found is not None and found.group(1) == name


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _is_file(path: str | Path) -> bool:
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
