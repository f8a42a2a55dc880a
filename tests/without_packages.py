"""A Python in which some packages are not installed, run as a program by tests/test_extras.py.

It takes ``[packages, cases]`` as JSON on standard input, and for each case, which is a piece of Python, prints as a line of JSON what it raised.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import traceback
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

SOURCE = Path(__file__).parents[1] / "src" / "pieper"


class Without:
    """The ways to find a module, less some packages."""

    def __init__(self, packages: set[str], finders: list[Any]) -> None:
        self.packages, self.finders = packages, finders

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name.partition(".")[0] in self.packages:
            return None
        for finder in self.finders:
            if spec := finder.find_spec(name, path, target):
                return spec
        return None


def raised(code: str) -> dict[str, Any]:
    """What a piece of Python raises, and in which function of pieper."""
    try:
        exec(code, {})
    except Exception as error:  # noqa: BLE001  what it is, is the answer
        frames = [
            frame for frame in traceback.extract_tb(error.__traceback__) if "pieper" in Path(frame.filename).parts
        ]
        site = "/".join(Path(frames[-1].filename).parts[-2:]) + f":{frames[-1].name}" if frames else ""
        about = {name: getattr(error, name, "") for name in ("package", "extra")}
        return {"type": type(error).__name__, "message": str(error), "site": site, **about}
    return {"type": "", "message": "nothing was raised", "site": "", "package": "", "extra": ""}


def command(*arguments: str) -> None:
    """The command line; an exit code other than 0 is raised with what it complained."""
    from pieper.cli.main import main

    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(list(arguments))
    if code:
        raise SystemError(f"exit code {code}: {said.getvalue().strip()}")


if __name__ == "__main__":
    packages, cases = json.load(sys.stdin)
    sys.meta_path[:] = [Without(set(packages), list(sys.meta_path))]  # type: ignore[list-item]
    sys.modules["without_packages"] = sys.modules["__main__"]
    for case in cases:
        print(json.dumps(raised(case)), flush=True)
