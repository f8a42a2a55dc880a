"""``pieper doctor``: what is there, what is not, what to do; and no probe can spoil it for the others."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import pytest

import pieper
from pieper._native import kernels
from pieper.cli import doctor, probes
from pieper.cli.main import FAULT
from pieper.cli.probes import BROKEN, EXTRAS, MISSING, OK, PROBES, Finding
from pieper.errors import MissingExtraError, MissingLibraryError, PieperError

EVERYTHING = [*PROBES, *EXTRAS]
FINE = {name: Finding(OK, "there") for name in EVERYTHING}


@pytest.fixture(scope="module")
def looked() -> dict[str, Finding]:
    """What the real probes find on this machine."""
    return doctor.look(EVERYTHING, 60.0)


def test_everything_is_looked_at(looked) -> None:
    assert list(looked) == EVERYTHING
    assert {finding.state for finding in looked.values()} <= {OK, MISSING, BROKEN}
    assert all(finding.found for finding in looked.values())


def test_the_core_is_told(looked) -> None:
    core = looked["core"]
    assert core.state == OK
    assert all(name in core.found for name in kernels.instruction_sets())
    assert f"numpy {metadata.version('numpy')}" in core.found


def test_a_gap_says_what_to_do(looked) -> None:
    assert all(finding.advice for finding in looked.values() if finding.state == MISSING)


@pytest.mark.parametrize("name", EXTRAS)
def test_an_extra_that_is_there_has_versions(looked, name) -> None:
    if looked[name].state != OK:
        pytest.skip(looked[name].found)
    for package in EXTRAS[name].packages:
        assert f"{package} {metadata.version(package)}" in looked[name].found


def test_on_screen_it_fits_80_columns(pieper_command, monkeypatch, looked) -> None:
    monkeypatch.setattr(doctor, "look", lambda names, timeout: looked)
    monkeypatch.setenv("COLUMNS", "80")
    result = pieper_command("doctor")
    assert result.code == 0
    assert not result.err
    lines = result.out.splitlines()
    assert lines[0].startswith(f"pieper {pieper.__version__}, ")
    assert lines[1].startswith(f"Python {platform.python_version()}, ")
    assert all(any(line.startswith(f"{name} ") for line in lines) for name in EVERYTHING)
    # paths may be longer than a line
    assert [line for line in lines[3:] if len(line) > 80 and "/" not in line] == []


def test_in_json(pieper_command, monkeypatch, looked) -> None:
    monkeypatch.setattr(doctor, "look", lambda names, timeout: looked)
    answer = pieper_command("doctor", "--json").json
    assert set(answer) == {"pieper", "python", "checks"}
    assert set(answer["pieper"]) == {"version", "folder"}
    assert set(answer["python"]) == {"version", "executable", "system"}
    assert [check["name"] for check in answer["checks"]] == EVERYTHING
    for check in answer["checks"]:
        assert check["extra"] == (check["name"] in EXTRAS)
        assert set(check) - {"gives"} == {"name", "extra", "state", "found", "advice"}


@pytest.mark.parametrize(("name", "code"), [("OpenGL", 0), ("plan", 0), ("core", FAULT)])
@pytest.mark.parametrize("state", [MISSING, BROKEN])
def test_only_a_broken_core_counts(pieper_command, monkeypatch, name, state, code) -> None:
    findings = {**FINE, name: Finding(state, "not there", "bring it")}
    monkeypatch.setattr(doctor, "look", lambda names, timeout: findings)
    result = pieper_command("doctor")
    assert result.code == code
    assert result.out.rstrip().endswith("bring it")


# --- one probe does not spoil it for the others

ODD = """
import os, signal, sys, time
name = sys.argv[2]
if name == "core":
    os.kill(os.getpid(), signal.SIGSEGV)
elif name == "OpenGL":
    time.sleep(600)
elif name == "camera":
    print("no JSON")
elif name == "browser":
    sys.exit("something went wrong")
else:
    sys.stdout.write("a library talks\\n" * 5000 + '["ok", "there", ""]\\n{"state": "ok", "found": "there", "advice": ""}\\n')
"""


@pytest.mark.skipif(os.name == "nt", reason="signals are those of POSIX")
def test_what_crashes_hangs_or_babbles_harms_no_other(monkeypatch) -> None:
    monkeypatch.setattr(doctor, "_CHILD", ODD)
    found = doctor.look(["core", "OpenGL", "camera", "browser", "screen", "FFmpeg"], 5.0)
    assert found == {
        "core": Finding(BROKEN, "the probe was ended by SIGSEGV"),
        "OpenGL": Finding(BROKEN, "no answer within 5 s", "try again with a larger --timeout"),
        "camera": Finding(BROKEN, "the probe ended with exit code 0"),
        "browser": Finding(BROKEN, "the probe ended with exit code 1: something went wrong"),
        "screen": Finding(OK, "there"),
        "FFmpeg": Finding(OK, "there"),
    }


@pytest.mark.skipif(os.name == "nt", reason="processes end differently on Windows")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_leaves_no_child(number, tmp_path) -> None:
    """The probes say which processes they are, then hang."""
    child = f"import os, pathlib, time; pathlib.Path({str(tmp_path)!r}, str(os.getpid())).touch(); time.sleep(600)"
    code = (
        f"import sys; from pieper.cli import doctor, main; doctor._CHILD = {child!r}; sys.exit(main.main(['doctor']))"
    )
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE) as process:
        while len(list(tmp_path.iterdir())) < 4:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(number)
        assert process.wait() == 130
        assert process.stderr is not None
        assert process.stderr.read() == b"pieper: interrupted\n"
    for path in tmp_path.iterdir():
        with pytest.raises(ProcessLookupError):
            os.kill(int(path.name), 0)


@pytest.mark.parametrize(
    ("variables", "state", "words"),
    [
        ({"PIEPER_INSTRUCTION_SET": "mmx"}, BROKEN, "PIEPER_INSTRUCTION_SET must name an instruction set"),
        ({"PIEPER_INSTRUCTION_SET": kernels.instruction_sets()[0]}, OK, ""),
    ],
)
def test_the_environment_is_that_of_the_command(monkeypatch, variables, state, words) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    finding = doctor.look(["core"], 60.0)["core"]
    assert finding.state == state
    assert words in finding.advice


def test_a_broken_numpy_is_told_and_is_code_4(tmp_path) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('numpy is broken here')\n", encoding="utf-8")
    folders = [str(tmp_path), str(Path(pieper.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, folders))}
    command = [sys.executable, "-m", "pieper", "doctor", "--json"]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    core = json.loads(said.stdout)["checks"][0]
    assert (said.returncode, core["name"], core["state"]) == (FAULT, "core", BROKEN)
    assert "numpy is broken here" in core["found"]


# --- the probes themselves


@pytest.mark.parametrize("name", EXTRAS)
def test_an_extra_that_is_not_there_names_itself(monkeypatch, name) -> None:
    monkeypatch.setattr(probes.metadata, "version", _no_version)
    monkeypatch.setattr(probes, "is_wanted", lambda package: True)
    for module in EXTRAS[name].packages.values():
        for loaded in [m for m in sys.modules if f"{m}.".startswith(f"{module.partition('.')[0]}.")]:
            monkeypatch.setitem(sys.modules, loaded, None)
        monkeypatch.setitem(sys.modules, module.partition(".")[0], None)
    finding = probes.examine(name)
    assert finding.state == MISSING
    assert finding.advice == f"pip install 'pieper[{name}]'"
    assert all(f"no {package}" in finding.found for package in EXTRAS[name].packages)


def test_a_package_that_does_not_load(monkeypatch, tmp_path) -> None:
    (tmp_path / "does_not_load.py").write_text("import a_part_of_it\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(EXTRAS, "plot", probes.Extra("figures", {"odd": "does_not_load"}))
    finding = probes.examine("plot")
    assert (finding.state, finding.found) == (BROKEN, "odd  does not load: No module named 'a_part_of_it'")
    assert finding.advice.startswith("pip install 'pieper[plot]'")


def test_another_version_than_the_wanted_one(monkeypatch) -> None:
    monkeypatch.setattr(probes.metadata, "requires", lambda name: ['matplotlib>=99.1; extra == "plot"', "numpy>=1.26"])
    monkeypatch.setattr(probes.metadata, "version", lambda name: "3.8.0")
    finding = probes.examine("plot")
    assert (finding.state, finding.found) == (BROKEN, "matplotlib is 3.8.0, wanted >=99.1")


@pytest.mark.parametrize(
    ("error", "finding"),
    [
        (MissingExtraError("mujoco", "sim", "drawing"), Finding(MISSING, "mujoco is not installed", "pip install 'pieper[sim]'")),
        (MissingLibraryError("install libegl1"), Finding(BROKEN, "does not work", "install libegl1")),
        (PieperError("no backend 'x'"), Finding(BROKEN, "does not work", "no backend 'x'")),
        (ValueError("odd\nthing"), Finding(BROKEN, "ValueError: odd thing")),
    ],
)  # fmt: skip
def test_what_is_raised_is_a_finding(monkeypatch, error, finding) -> None:
    def probe() -> Finding:
        raise error

    monkeypatch.setitem(PROBES, "OpenGL", probe)
    assert probes.examine("OpenGL") == finding


@pytest.mark.skipif(sys.platform != "linux", reason="cameras of Linux")
@pytest.mark.parametrize(
    ("device", "state", "found"),
    [("", MISSING, "no camera"), ("/proc/version", BROKEN, "may not be read"), ("/dev/null", BROKEN, "gives no frame")],
)
def test_cameras(monkeypatch, device, state, found) -> None:
    pytest.importorskip("cv2", reason="the extra perception is not installed")
    monkeypatch.setattr(probes, "_first_camera", lambda: device)
    monkeypatch.setattr(probes.os, "access", lambda path, mode: path != "/proc/version")
    finding = probes.examine("camera")
    assert finding.state == state
    assert found in finding.found
    assert finding.advice


def test_a_film_is_a_camera_that_works(monkeypatch, tmp_path) -> None:
    cv2 = pytest.importorskip("cv2", reason="the extra perception is not installed")
    import numpy as np

    path = str(tmp_path / "film.avi")
    film = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (64, 48))
    film.write(np.zeros((48, 64, 3), np.uint8))
    film.release()
    monkeypatch.setattr(probes, "_first_camera", lambda: path)
    monkeypatch.setattr(probes.sys, "platform", "linux")
    assert probes.examine("camera") == Finding(OK, f"{path}, 64 x 48")


@pytest.mark.skipif(sys.platform != "linux", reason="screens of Linux")
@pytest.mark.parametrize(
    ("variables", "state"), [({}, MISSING), ({"DISPLAY": ":7"}, OK), ({"WAYLAND_DISPLAY": "w"}, OK)]
)
def test_screens(monkeypatch, variables, state) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert probes.examine("screen").state == state


def test_what_cannot_be_had_here_says_what_to_take_instead(monkeypatch) -> None:
    monkeypatch.setattr(probes, "is_wanted", lambda package: package != "ompl")
    monkeypatch.setitem(EXTRAS, "plan", probes.Extra("", {"ompl": "no_module_of_this_name"}))
    monkeypatch.setattr(probes.metadata, "version", _no_version)
    finding = probes.examine("plan")
    assert (finding.state, finding.found) == (MISSING, "no ompl")
    assert "no package of ompl for this Python on this machine; take Python 3.10 to 3.13" in finding.advice


def _no_version(package: str) -> str:
    raise metadata.PackageNotFoundError(package)
