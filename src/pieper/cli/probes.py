"""What ``pieper doctor`` looks at. Each probe runs in a process of its own, which may crash or hang without harm."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pieper.errors import MissingExtraError, MissingLibraryError, PieperError

if TYPE_CHECKING:
    from collections.abc import Callable

OK, MISSING, BROKEN = "ok", "missing", "broken"


class Finding(NamedTuple):
    """What a probe says: `state` is ``ok``, ``missing`` or ``broken``; `found` says what is there, `advice` what to do about a gap."""

    state: str
    found: str
    advice: str = ""


class Extra(NamedTuple):
    """What an extra gives, and its packages: the name to install and the name to import."""

    gives: str
    packages: dict[str, str]


EXTRAS = {
    "xacro": Extra("xacro files", {"xacrodoc": "xacrodoc"}),
    "symbolic": Extra("formulas, in LaTeX and code", {"sympy": "sympy", "pyyaml": "yaml"}),
    "ros": Extra("ROS 2 networks without ROS", {"cyclonedds": "cyclonedds", "rosbags": "rosbags", "pyyaml": "yaml"}),
    "viewer": Extra("arms in the browser", {"viser": "viser", "trimesh": "trimesh", "pycollada": "collada"}),
    "sim": Extra("physics, pictures and films", {"mujoco": "mujoco", "pillow": "PIL", "imageio-ffmpeg": "imageio_ffmpeg", "pyyaml": "yaml"}),
    "plot": Extra("figures", {"matplotlib": "matplotlib"}),
    "perception": Extra("cameras and markers", {"opencv-python-headless": "cv2", "pyyaml": "yaml"}),
    "plan": Extra(
        "motions around obstacles", {"coal": "coal", "ompl": "ompl.base", "ruckig": "ruckig", "pyyaml": "yaml"}
    ),
    "maps": Extra("maps of the workspace", {"zarr": "zarr", "h5py": "h5py", "scikit-image": "skimage"}),
    "cluster": Extra("maps by a Dask cluster", {"distributed": "distributed"}),
    "parquet": Extra("tables in Parquet files", {"pyarrow": "pyarrow"}),
}  # fmt: skip

CORE = ("numpy", "scipy", "defusedxml", "typer", "rich")
_EXACT = 1e-9  # m and rad
_BROWSERS = (
    "chromium chromium-browser google-chrome google-chrome-stable firefox firefox-esr microsoft-edge brave-browser"
)


def core() -> Finding:
    """The packages without which nothing runs, the compiled kernels, and whether their answers are right."""
    versions = ", ".join(f"{name} {_version(name)}" for name in CORE)
    import pieper
    from pieper._native import kernels

    arm, q = pieper.load("ur5e"), [0.2, -1.4, 1.8, -1.1, -1.5, 0.4]
    answers = arm.ik(arm.fk(q))
    worst = float(max(answers.position_error.max(), answers.rotation_error.max()))
    if answers.q.shape != (8, 6) or not worst < _EXACT:
        return Finding(BROKEN, f"an arm with eight answers has {len(answers.q)}, off by up to {worst:.1g}", _REINSTALL)
    sets, used = kernels.instruction_sets(), kernels.instruction_set()
    found = f"instruction set {used} of {', '.join(sets)}; {versions}"
    if sets == ["portable"]:
        return Finding(OK, found, "slower than it could be: a wheel, or a build with GCC or Clang, has vector kernels")
    if used != sets[-1]:
        return Finding(OK, found, f"slower than it could be: unset PIEPER_INSTRUCTION_SET to take {sets[-1]}")
    return Finding(OK, found)


_REINSTALL = "pip install --force-reinstall pieper, and report it if that does not help"


def extra(name: str) -> Finding:
    """The packages of an extra: installed, as new as is asked for, and loaded."""
    wanted, found, missing, broken = _requirements(name), [], [], []
    for package, module in EXTRAS[name].packages.items():
        try:
            version = metadata.version(package)
        except metadata.PackageNotFoundError:
            version = ""
        try:
            loaded = import_module(module)
        except ModuleNotFoundError as error:
            if version or (error.name or "").partition(".")[0] != module.partition(".")[0]:
                broken.append(f"{package} {version} does not load: {_words(error)}")
            else:
                missing.append(package)
            continue
        except Exception as error:  # noqa: BLE001  a package may fail in any way when it is loaded
            broken.append(f"{package} {version} does not load: {_words(error)}")
            continue
        if version and not _meets(version, wanted.get(package, "")):
            broken.append(f"{package} is {version}, wanted {wanted[package]}")
        # of another distribution, as opencv-python for opencv-python-headless, or of no distribution at all
        found.append(f"{package} {version}" if version else f"{module} {getattr(loaded, '__version__', '')}".strip())
    advice = f"pip install 'pieper[{name}]'"
    if broken:
        return Finding(BROKEN, "; ".join(broken), f"{advice} --upgrade --force-reinstall")
    if not missing:
        return Finding(OK, ", ".join(found))
    if nowhere := [package for package in missing if not is_wanted(package)]:
        advice = (
            f"there is no package of {' and '.join(nowhere)} for this Python on this machine; {_INSTEAD[nowhere[0]]}"
        )
    return Finding(MISSING, ", ".join([*found, *(f"no {package}" for package in missing)]), advice)


_INSTEAD = {
    "cyclonedds": "source a ROS 2 installation, whose rclpy is taken then, or build cyclonedds",
    "mujoco": "take Python 3.11 or later, on macOS a processor of Apple",
    "coal": "take Linux or macOS",
    "ompl": "take Python 3.10 to 3.13 on Linux or macOS",
    "zarr": "take Python 3.11 or later",
}


def is_wanted(
    package: str,
    version: tuple[int, ...] = sys.version_info[:2],
    system: str = platform.system(),
    machine: str = platform.machine(),
) -> bool:
    """Whether the extras bring a package here, as the markers of their requirements say: elsewhere there is none to be had.

    >>> is_wanted("ompl", (3, 14), "Linux", "x86_64"), is_wanted("ruckig", (3, 14), "Linux", "x86_64")
    (False, True)
    """
    if package == "cyclonedds":
        return version < (3, 14) and (machine in ("x86_64", "AMD64") or (system, machine) == ("Darwin", "arm64"))
    if package == "ompl":
        return version < (3, 14) and system != "Windows"
    if package == "coal":
        return system != "Windows"
    if package == "mujoco":
        return version >= (3, 11) and (system, machine) != ("Darwin", "x86_64")
    return package != "zarr" or version >= (3, 11)


def ros() -> Finding:
    """The backend that a node would take, and whether it gets onto the network."""
    from pieper.ros.backends import choose_backend, open_bus

    backend = choose_backend()
    distribution = os.environ.get("ROS_DISTRO", "")
    with open_bus("pieper_doctor", backend=backend):
        pass
    return Finding(
        OK, f"backend {backend}" + (f" of ROS {distribution}" if distribution else "") + "; a node can start"
    )


def gl() -> Finding:
    """Whether a picture can be drawn without a screen."""
    import pieper
    from pieper.sim import offscreen
    from pieper.sim.picture import Picture

    offscreen.import_mujoco()
    picture = Picture(size=(64, 48))
    picture.add_arm(pieper.load("ur5e"), [0.0, -1.2, 1.4, -1.7, -1.57, 0.0])
    colors = picture.image()
    if len({tuple(color) for color in colors.reshape(-1, 3).tolist()}) < 3:
        return Finding(BROKEN, "a picture is drawn, and is empty", "try MUJOCO_GL=osmesa, or MUJOCO_GL=egl")
    return Finding(OK, f"draws without a screen, by {_gl_library()}")


def _gl_library() -> str:
    if sys.platform != "linux":
        return "the system's OpenGL"
    names = [name for name in ("egl", "osmesa") if f"mujoco.{name}" in sys.modules]
    return {"egl": "EGL", "osmesa": "OSMesa"}.get(names[-1] if names else "", "OpenGL")


def camera() -> Finding:
    """Whether OpenCV reads a frame from the first camera."""
    device, elsewhere = _first_camera(), "films, folders of pictures, streams and pipes are read without one"
    if not device:
        return Finding(MISSING, "no camera at /dev/video*", f"connect one; {elsewhere}")
    from pieper.perception.opencv import opencv, quiet

    quiet()
    if sys.platform == "linux" and not os.access(device, os.R_OK | os.W_OK):
        return Finding(BROKEN, f"{device} may not be read", "sudo usermod -aG video $USER, then log in again")
    source = opencv("a camera").VideoCapture(device if sys.platform == "linux" else 0)
    try:
        fine, frame = source.read()
    finally:
        source.release()
    if not fine:
        return Finding(BROKEN, f"{device} gives no frame", f"it may be in use, or be no camera; {elsewhere}")
    return Finding(OK, f"{device}, {frame.shape[1]} x {frame.shape[0]}")


def _first_camera() -> str:
    if sys.platform != "linux":
        return "camera 0"
    return min((str(path) for path in Path("/dev").glob("video*")), default="")


def browser() -> Finding:
    """Whether there is a browser for the viewer."""
    import webbrowser

    advice = "open the address that pieper view prints in any browser with WebGL 2 (through ssh -L, from elsewhere)"
    found = [shutil.which(name) for name in _BROWSERS.split()]
    if places := [place for place in found if place]:
        return Finding(OK, places[0])
    if sys.platform in ("darwin", "win32"):
        return Finding(OK, "the system's browser")
    try:
        return Finding(OK, str(webbrowser.get().name))
    except (webbrowser.Error, AttributeError):
        return Finding(MISSING, "none", advice)


def ffmpeg() -> Finding:
    """Whether films can be written."""
    try:
        program = str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except ModuleNotFoundError:
        return Finding(MISSING, "imageio-ffmpeg, which brings it, is not installed", "pip install 'pieper[sim]'")
    except RuntimeError as error:
        return Finding(BROKEN, _words(error), "install FFmpeg and set IMAGEIO_FFMPEG_EXE to it")
    said = subprocess.run([program, "-version"], capture_output=True, text=True, check=True, timeout=15)
    return Finding(OK, " ".join(said.stdout.split()[:3]) + f", {program}")


def screen() -> Finding:
    """Whether windows can be opened."""
    if sys.platform in ("darwin", "win32"):
        return Finding(OK, "the system's")
    for variable in ("WAYLAND_DISPLAY", "DISPLAY"):
        if place := os.environ.get(variable):
            return Finding(OK, f"{variable}={place}")
    return Finding(
        MISSING,
        "none: neither DISPLAY nor WAYLAND_DISPLAY is set",
        "pictures, films and figures go into files, the viewer's page to a browser anywhere; windows need ssh -X or a desktop",
    )


PROBES: dict[str, Callable[[], Finding]] = {
    "core": core,
    "ROS node": ros,
    "OpenGL": gl,
    "camera": camera,
    "browser": browser,
    "FFmpeg": ffmpeg,
    "screen": screen,
}


def examine(name: str) -> Finding:
    """What one probe finds; what it raises is a finding too.

    >>> examine("screen").state in ("ok", "missing")
    True
    """
    try:
        return extra(name) if name in EXTRAS else PROBES[name]()
    except MissingExtraError as error:
        return Finding(MISSING, f"{error.package} is not installed", f"pip install 'pieper[{error.extra}]'")
    except MissingLibraryError as error:
        return Finding(BROKEN, "does not work", _words(error))
    except PieperError as error:
        return Finding(BROKEN, "does not work", _words(error))
    except Exception as error:  # noqa: BLE001  whatever is wrong with this machine is what is asked
        return Finding(BROKEN, f"{type(error).__name__}: {_words(error)}", _REINSTALL if name == "core" else "")


def main(name: str) -> None:
    """Print what one probe finds, in JSON on the last line of standard output."""
    finding = examine(name)
    sys.stdout.flush()
    sys.stdout.write("\n" + json.dumps(finding._asdict()) + "\n")
    sys.stdout.flush()
    os._exit(0)  # what a library does when Python ends is not asked


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:400] or type(error).__name__


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "(not installed)"


def _requirements(name: str) -> dict[str, str]:
    """Package and wanted version, ``==1.2`` or ``>=1.2``, of an extra; none where pieper was not installed but found on a path."""
    try:
        lines = metadata.requires("pieper") or []
    except metadata.PackageNotFoundError:
        return {}
    wanted = {}
    for line in lines:
        requirement, _, marker = line.partition(";")
        if f"extra == '{name}'" in marker.replace('"', "'"):
            at = min((k for k in map(requirement.find, "=<>!~ ") if k > 0), default=len(requirement))
            wanted[requirement[:at].strip().lower()] = requirement[at:].strip()
    return wanted


def _meets(version: str, wanted: str) -> bool:
    """Whether a version is the one or at least the one that is wanted; True for what cannot be told.

    >>> _meets("1.10.0", ">=1.9"), _meets("1.1.2", "==1.1.1"), _meets("4.0", "==4.0.0"), _meets("2.0rc1", ">=2.0")
    (True, False, True, True)
    """
    kind, number = wanted[:2], wanted[2:]
    try:
        have, want = ([int(part) for part in text.split(".")] for text in (version, number))
    except ValueError:
        return True
    length = max(len(have), len(want))
    have, want = have + [0] * (length - len(have)), want + [0] * (length - len(want))
    return {"==": have == want, ">=": have >= want}.get(kind, True)
