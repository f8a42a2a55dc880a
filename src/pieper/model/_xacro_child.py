"""The process in which a xacro file is expanded; started by `pieper.model.xacro`, never imported by the package.

It reads one JSON object from standard input, sets its limits, forbids itself everything that expanding a file does not
need (an audit hook, Python PEP 578), expands, and writes one JSON object to standard output. xacro evaluates Python
expressions and has functions that read any file; the hook does not depend on which of them an expression reaches.
"""

# The audit hook runs inside every open(): plain strings are quicker than Path and open nothing themselves.
# ruff: noqa: PTH113, PTH118, PTH119, PTH120

from __future__ import annotations

import importlib.util
import json
import os
import sys
from typing import Any

_FORBIDDEN = (
    "subprocess.",
    "socket.",
    "ctypes.",
    "shutil.",
    "winreg.",
    "os.system",
    "os.exec",
    "os.spawn",
    "os.posix_spawn",
    "os.fork",
    "os.startfile",
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
    "os.chown",
    "os.kill",
    "os.putenv",
    "os.unsetenv",
    "pty.",
)
_LISTING = ("os.listdir", "os.scandir", "glob.glob", "glob.glob/2")
_CODE = (".py", ".pyc", ".so", ".pyd")


class Refused(Exception):
    """Something the expansion is not allowed to do."""


class PackageMissing(Exception):
    """``$(find ...)`` of a package that is in none of the known places."""


class Guard:
    """Refuses to open files outside the given folders, to write, to start processes and to reach the network."""

    def __init__(self, roots: list[str]) -> None:
        self.roots: list[str] = []
        self.code = [os.path.realpath(folder) for folder in sys.path if folder]
        self.trusted = False
        self.refused: list[str] = []
        for root in roots:
            self.allow(root)

    def allow(self, root: str) -> None:
        """Let files in a folder be read; also where its ``package.xml`` really lies, for workspaces of links."""
        manifest = os.path.realpath(os.path.join(root, "package.xml"))
        folders = [root, os.path.realpath(root)]
        if os.path.basename(manifest) == "package.xml" and os.path.isfile(manifest):
            folders.append(os.path.dirname(manifest))
        self.roots.extend(folder for folder in folders if folder not in self.roots)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.trusted:
            return
        if event == "open":
            self._open(*arguments)
        elif event in _LISTING:
            path = arguments[0] if arguments else "."
            if not isinstance(path, int) and not self._inside(self._text(path or ".")):
                self._refuse(f"lists the folder {self._text(path)!r}")
        elif event.startswith(_FORBIDDEN):
            self._refuse(f"calls {event}")

    def _open(self, path: Any, mode: str | None, flags: Any) -> None:
        if isinstance(path, int):
            return
        text = self._text(path)
        writing = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC
        if (mode and set(mode) & set("wax+")) or (isinstance(flags, int) and flags & writing):
            self._refuse(f"writes the file {text!r}")
        if self._inside(text):
            return
        real = os.path.realpath(text)
        if real.endswith(_CODE) and any(_is_in(real, folder) for folder in self.code):
            return
        self._refuse(f"reads the file {text!r}")

    def _inside(self, path: str) -> bool:
        head, tail = os.path.split(path)
        while any(mark in path for mark in "*?[") and head and tail:  # the fixed part of a pattern
            path = head
            head, tail = os.path.split(path)
        real = os.path.realpath(path)
        return any(_is_in(real, root) for root in self.roots)

    @staticmethod
    def _text(path: Any) -> str:
        return os.fsdecode(os.fspath(path))

    def _refuse(self, deed: str) -> None:
        self.refused.append(deed)
        raise Refused(deed)


def _is_in(path: str, folder: str) -> bool:
    return path == folder or path.startswith(os.path.join(folder, ""))


def set_limits(memory: int, seconds: int, file_size: int) -> None:
    """Bound address space, processor time and written files where the system can."""
    try:
        import resource
    except ImportError:  # Windows: the parent's clock is the only limit
        return
    for kind, limit in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_FSIZE, file_size),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        try:
            resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
        except (ValueError, OSError):  # macOS refuses some
            continue


def expand(request: dict[str, Any]) -> dict[str, str]:
    """Expand the file or the text of the request; a mapping with `urdf`, or with `element` and `reason`."""
    import functools
    import xml.dom.minidom

    import defusedxml.minidom
    import xacro
    import xacrodoc  # replaces the package lookup of xacro, which needs a ROS installation
    import yaml  # noqa: F401  xacro imports it in the middle of an expansion

    lookup_spec = importlib.util.spec_from_file_location("lookup", request["lookup"])
    assert lookup_spec is not None and lookup_spec.loader is not None  # noqa: PT018  a file beside this one
    lookup = importlib.util.module_from_spec(lookup_spec)
    lookup_spec.loader.exec_module(lookup)

    path, text, packages = request["path"], request["text"], request["packages"]
    guard = Guard(request["roots"])

    def find(name: str) -> str:
        guard.trusted = True
        try:
            folder: str | None = lookup.find_package(name, packages=packages, beside=path)
        finally:
            guard.trusted = False
        if folder is None:
            raise PackageMissing(name)
        guard.allow(folder)
        return folder

    xacrodoc.packages.get_path = find
    xacro.substitution_args._eval_find = find
    xacro.substitution_args._eval_dict["find"] = find
    xml.dom.minidom.parse = functools.partial(defusedxml.minidom.parse, forbid_dtd=True)
    xml.dom.minidom.parseString = functools.partial(defusedxml.minidom.parseString, forbid_dtd=True)

    set_limits(request["memory"], request["seconds"], request["file_size"])
    sys.addaudithook(guard)
    try:
        if path is not None:
            document = xacro.process_file(path, mappings=request["args"])
        else:
            xacro.init_stacks(None)
            document = xacro.parse(text)
            xacro.process_doc(document, mappings=request["args"])
        urdf: str = document.documentElement.toxml()
        if guard.refused:
            return _refusal(guard, request)
        if len(urdf) > request["output"]:
            return {"element": "expansion", "reason": f"gives more than {request['output'] // 2**20} MiB of URDF"}
        return {"urdf": urdf}
    except MemoryError:
        return {"element": "expansion", "reason": f"needs more than {request['memory'] // 2**20} MiB of memory"}
    except RecursionError:
        return {"element": _where(xacro), "reason": "does not end: a macro calls itself, or a file includes itself"}
    except Exception as fault:  # noqa: BLE001  xacro raises whatever an expression raises
        if guard.refused:
            return _refusal(guard, request)
        if _root_cause(fault, RecursionError):
            return {"element": _where(xacro), "reason": "does not end: a macro calls itself, or a file includes itself"}
        if _root_cause(fault, MemoryError):
            return {"element": "expansion", "reason": f"needs more than {request['memory'] // 2**20} MiB of memory"}
        missing = _root_cause(fault, PackageMissing)
        if missing is not None:
            reason = "not found; give its folder, packages={name: folder}, or set ROS_PACKAGE_PATH"
            return {"element": f"package {str(missing)!r}", "reason": reason}
        if type(fault).__module__.startswith("defusedxml"):
            return {"element": "document type", "reason": "<!DOCTYPE> and entities are refused; remove them"}
        return {"element": _where(xacro), "reason": f"{type(fault).__name__}: {str(fault).strip()[:2000]}"}


def _refusal(guard: Guard, request: dict[str, Any]) -> dict[str, str]:
    folders = ", ".join(repr(root) for root in request["roots"]) or "none"
    reason = f"{guard.refused[0]}, which is refused; readable folders are: {folders}; give more with packages=[...]"
    return {"element": "expansion", "reason": reason}


def _root_cause(fault: BaseException | None, kind: type[BaseException]) -> BaseException | None:
    """The fault itself, or what it was made from: xacro keeps that in `exc`."""
    for _ in range(20):
        if fault is None or isinstance(fault, kind):
            return fault
        fault = getattr(fault, "exc", None) or fault.__cause__ or fault.__context__
    return None


def _where(xacro: Any) -> str:
    """The macro or the file that xacro was working on."""
    macros = getattr(xacro, "macrostack", None)
    if macros:
        return f"macro {macros[-1].body.getAttribute('name')!r}"
    files = getattr(xacro, "filestack", None)
    return f"file {os.path.basename(str(files[-1]))!r}" if files and files[-1] else "expansion"


def main() -> None:
    """Answer the one request on standard input."""
    request = json.loads(sys.stdin.buffer.read())
    answer_to = sys.stdout.buffer
    sys.stdout = sys.stderr  # xacro prints messages of the file
    answer = expand(request)
    answer_to.write(json.dumps(answer).encode())
    answer_to.flush()
    os._exit(0)  # nothing is left to do, and a large document takes long to tear down


if __name__ == "__main__":
    main()
