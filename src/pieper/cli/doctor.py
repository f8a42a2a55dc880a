"""``pieper doctor``: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from textwrap import wrap
from typing import IO, Annotated, Any, NamedTuple

import typer

from pieper.cli.arguments import Json
from pieper.cli.probes import BROKEN, EXTRAS, OK, PROBES, Finding
from pieper.cli.show import console, print_json, print_table

FAULT = 4  # as in pieper.cli.main
_TOGETHER = 4  # children at a time
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from pieper.cli.probes import main; main(sys.argv[2])"
)


def doctor(
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="How long at most; for each probe.", min=0.1)
    ] = 30.0,
    as_json: Json = False,
) -> int:
    """Say what works on this machine, and what to do about what does not.

    Each thing is tried in a process of its own, so that one that crashes or hangs harms no other. A node of ROS 2 is started for a
    moment, and one frame is taken from a camera. Exit code 0, whatever is missing; 4 when the core of pieper itself does not work.

    For example:
      pieper doctor
    """
    findings = look([*PROBES, *EXTRAS], timeout)
    code = 0 if findings["core"].state == OK else FAULT
    if as_json:
        print_json({"pieper": _pieper(), "python": _python(), "checks": [_check(*item) for item in findings.items()]})
        return code
    out = console()
    about, python = _pieper(), _python()
    lines = (
        f"pieper {about['version']}, {about['folder']}",
        f"Python {python['version']}, {python['executable']}",
        python["system"],
    )
    for line in lines:
        out.print(line, markup=False, soft_wrap=True)
    for title, names in (("Here", PROBES), ("Extras", EXTRAS)):
        out.print()
        rows = [(name, findings[name].state, _described(name, findings[name])) for name in names]
        print_table(out, ("", "state", "what is there"), rows, title=title)
    if gaps := [(name, finding.advice) for name, finding in findings.items() if finding.advice]:
        out.print("\nWhat to do", style="bold", markup=False)
        for name, advice in gaps:
            for k, text in enumerate(wrap(advice, max(20, out.width - 12), break_on_hyphens=False)):
                out.print(
                    ("" if k else name).ljust(12) + text, markup=False, no_wrap=True, overflow="ignore", crop=False
                )
    return code


def _described(name: str, finding: Finding) -> str:
    return f"{EXTRAS[name].gives}: {finding.found}" if name in EXTRAS else finding.found


def _pieper() -> dict[str, str]:
    import pieper

    return {"version": pieper.__version__, "folder": str(Path(pieper.__file__).parent)}


def _python() -> dict[str, str]:
    return {
        "version": platform.python_version(),
        "executable": sys.executable,
        "system": platform.platform(),
    }


def _check(name: str, finding: Finding) -> dict[str, Any]:
    kind = {"extra": True, "gives": EXTRAS[name].gives} if name in EXTRAS else {"extra": False, "gives": None}
    return {"name": name, **kind, **finding._asdict()}


# --- children


class _Child(NamedTuple):
    """A probe at work, and where what it says goes."""

    process: subprocess.Popen[bytes]
    out: IO[bytes]
    err: IO[bytes]
    until: float


def look(names: list[str], timeout: float) -> dict[str, Finding]:
    """What each probe finds, in the order of the names; a few run at a time, each in a process of its own."""
    waiting, running, found = list(names), dict[str, _Child](), dict[str, Finding]()
    try:
        while waiting or running:
            while waiting and len(running) < _TOGETHER:
                name = waiting.pop(0)
                running[name] = _start(name, timeout)
            for name, child in list(running.items()):
                if child.process.poll() is not None or time.monotonic() > child.until:
                    found[name] = _end(running.pop(name), timeout)
            time.sleep(0.02)
    finally:
        for child in running.values():
            _end(child, timeout)
    return {name: found[name] for name in names}


def _start(name: str, timeout: float) -> _Child:
    out, err = tempfile.TemporaryFile(), tempfile.TemporaryFile()  # noqa: SIM115  closed where the child ends
    process = subprocess.Popen(
        [sys.executable, "-c", _CHILD, json.dumps(sys.path), name],
        stdin=subprocess.DEVNULL,
        stdout=out,
        stderr=err,
        start_new_session=os.name == "posix",  # with what it starts itself
    )
    return _Child(process, out, err, time.monotonic() + timeout)


def _end(child: _Child, timeout: float) -> Finding:
    """What a child said; one that is still at work is ended."""
    with child.out, child.err:
        if child.process.poll() is None:
            if os.name == "posix":
                os.killpg(child.process.pid, signal.SIGKILL)  # with what it started
            else:
                child.process.kill()
            child.process.wait()
            return Finding(BROKEN, f"no answer within {timeout:g} s", "try again with a larger --timeout")
        child.out.seek(0)
        child.err.seek(0)
        try:
            return Finding(**json.loads(child.out.read().splitlines()[-1]))
        except (IndexError, ValueError, TypeError):
            complaint = child.err.read().decode(errors="replace").strip().splitlines()
            return Finding(
                BROKEN, _crashed(child.process.returncode) + (f": {complaint[-1].strip()[:300]}" if complaint else "")
            )


def _crashed(code: int) -> str:
    if code >= 0:
        return f"the probe ended with exit code {code}"
    try:
        return f"the probe was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"the probe was ended by signal {-code}"
