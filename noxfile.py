"""`nox` alone does what continuous integration does; `nox -l` lists every session."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import nox
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

nox.needs_version = ">=2024.10"
nox.options.default_venv_backend = "venv"
nox.options.reuse_venv = "yes"
nox.options.sessions = ["format", "lint", "types", "imports", "tests", "docs", "examples", "native"]

PROJECT = nox.project.load_toml("pyproject.toml")
OLDEST_PYTHON = "3.10"
NEWEST_PYTHON = "3.14"
EXTRAS = tuple(PROJECT["project"]["optional-dependencies"])
# Ends with 1 unless `pieper doctor` finds the core and these extras whole.
ARE_WHOLE = """
import json, subprocess, sys
said = subprocess.run([sys.executable, "-m", "pieper", "doctor", "--json"], stdout=subprocess.PIPE, check=True).stdout
checks = {check["name"]: check for check in json.loads(said)["checks"]}
wanted = [name for name, check in checks.items() if check["extra"]] if sys.argv[1] == "all" else [sys.argv[1]]
for name in ["core", *wanted]:
    print(name, checks[name]["state"], checks[name]["found"])
sys.exit(any(checks[name]["state"] != "ok" for name in ["core", *wanted]))
"""
# The tests compare with its figures; what it asks for besides would overwrite opencv-python-headless.
TRACKEVAL = "trackeval==1.3.0"


def groups(*names: str) -> list[str]:
    """The requirements of the named dependency groups."""
    return list(nox.project.dependency_groups(PROJECT, *names))


def install_pieper(session: nox.Session, *names: str, extra: str = "") -> None:
    """Install pieper as a user gets it, compiled once and kept in build/, with the named groups."""
    session.install(*groups("build", *names))
    session.install("--no-build-isolation", f".{extra}")
    if "test" in names:
        session.install("--no-deps", TRACKEVAL)


def native_sources() -> list[str]:
    """Every C++ file that is written by hand."""
    folders = (Path("native"), Path("benchmarks"))
    return [str(p) for folder in folders for p in sorted(folder.rglob("*")) if p.suffix in {".cpp", ".hpp", ".h"}]


@nox.session
def format(session: nox.Session) -> None:  # noqa: A001
    """Check the layout of Python and C++ files; `nox -s format -- fix` mends it."""
    session.install(*groups("lint"))
    fix = "fix" in session.posargs
    session.run("ruff", "format", *([] if fix else ["--check"]), ".")
    session.run("clang-format", *(["-i"] if fix else ["--dry-run", "--Werror"]), *native_sources())


@nox.session
def lint(session: nox.Session) -> None:
    """Find mistakes that a linter can find."""
    session.install(*groups("lint"))
    session.run("ruff", "check", *session.posargs, ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check types: strict in src and examples."""
    install_pieper(session, "lint", "test")
    session.run("mypy", *session.posargs)


@nox.session
def imports(session: nox.Session) -> None:
    """Check that imports point down."""
    session.install(*groups("lint"))
    # The cache goes by modification time and can answer for yesterday's file.
    session.run("lint-imports", "--no-cache", "--no-logo", env={"PYTHONPATH": "src"})


@nox.session
def tests(session: nox.Session) -> None:
    """Run the Python tests: laws, rows of the source documents, doctests, docs, examples."""
    install_pieper(session, "test")
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session
def rclpy(session: nox.Session) -> None:
    """Run the tests of the ROS nodes beside a real rclpy (Linux on x86-64, Python 3.10 to 3.13)."""
    install_pieper(session, "test", "rclpy")
    session.run("python", "-m", "pytest", "tests/ros", *session.posargs)


@nox.session
def peers(session: nox.Session) -> None:
    """Run every line of docs/guides/coming_from.md with the packages that it translates from (Linux on x86-64, Python 3.11 to 3.13)."""
    install_pieper(session, "test")
    session.install("--no-deps", *groups("peers"))
    session.run("python", "-m", "pytest", "tests/migration", *session.posargs)


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation; a warning, a broken link and anything that is fetched from outside is an error."""
    install_pieper(session, "docs", extra="[all]")  # the reference imports every room
    session.run("python", "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", "build/docs")
    session.run("python", "scripts/check_site.py", "build/docs")


@nox.session
def examples(session: nox.Session) -> None:
    """Run every example and every code block of the documentation."""
    install_pieper(session, "test")
    session.run("python", "-m", "pytest", "tests/test_examples.py", "tests/test_docs.py", *session.posargs)


@nox.session
def native(session: nox.Session) -> None:
    """Build and run the tests of the C++ library, without Python, with vectors and on the portable path."""
    session.install(*groups("build"))
    session.run("bash", "-c", "source scripts/setup.sh && native_tests && portable_tests", external=True)


@nox.session
def foreign(session: nox.Session) -> None:
    """Compile the tests of the C++ library for Linux on aarch64 and for Windows, and run them emulated (QEMU, Wine)."""
    session.install(*groups("build"))
    aarch64 = "foreign_tests Linux aarch64 aarch64-linux-gnu-g++ qemu-aarch64"
    windows = "foreign_tests Windows AMD64 x86_64-w64-mingw32-g++-posix wine"
    session.run("bash", "-c", f"source scripts/setup.sh && {aarch64} && {windows}", external=True)


@nox.session
def variants(session: nox.Session) -> None:
    """Build with GCC and Clang, vectors and portable, test with every instruction set, compare answers; `-- --answers` is short."""
    session.install(*groups("build", "test"), "numpy", "scipy", "defusedxml", "typer", "rich")
    session.run("python", "scripts/variants.py", *session.posargs)


@nox.session
def extras(session: nox.Session) -> None:
    """Install each extra, and all of them, into an environment of its own, and ask `pieper doctor`; `-- viewer sim` for some."""
    session.install(*groups("build"))
    folder = Path("build/extras").resolve()
    shutil.rmtree(folder, ignore_errors=True)
    session.run("python", "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-w", str(folder), ".")
    (wheel,) = folder.glob("*.whl")
    for extra in session.posargs or EXTRAS:
        session.run("python", "-m", "venv", str(folder / extra))
        python = str(folder / extra / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python"))
        session.run(python, "-m", "pip", "install", "-q", f"pieper[{extra}] @ {wheel.as_uri()}", external=True)
        session.run(python, "-m", "pip", "check", external=True)
        session.run(python, "-c", ARE_WHOLE, extra, external=True)


@nox.session
def dist(session: nox.Session) -> None:
    """Build the source archive, and from it a wheel; look at both, and get a first answer from the wheel."""
    session.install("build", "twine", "check-wheel-contents", "abi3audit")
    folder = Path("build/dist").resolve()
    shutil.rmtree(folder, ignore_errors=True)
    session.run("python", "-m", "build", "--outdir", str(folder))
    (wheel,) = folder.glob("*.whl")
    session.run("twine", "check", "--strict", *map(str, folder.iterdir()))
    session.run("check-wheel-contents", str(wheel))
    if "abi3" in wheel.name:
        session.run("abi3audit", "--strict", str(wheel))
    session.install("--force-reinstall", str(wheel))
    with session.chdir(folder):  # the wheel, not the clone
        session.run("pieper", "ik", "ur5e", "0.4", "0.2", "0.3", "--rpy", "180", "0", "0", "--deg")


@nox.session
def sanitize(session: nox.Session) -> None:
    """Run the tests of the C++ library while addresses and undefined behaviour are watched (GCC or Clang)."""
    session.install(*groups("build"))
    session.run("bash", "-c", "source scripts/setup.sh && sanitized_tests", external=True)


@nox.session(python=OLDEST_PYTHON)
def oldest(session: nox.Session) -> None:
    """Run the tests with the oldest Python and the oldest packages that pyproject.toml admits."""
    extras = PROJECT["project"]["optional-dependencies"]
    wanted = [
        *PROJECT["project"]["dependencies"],
        *(line for extra in EXTRAS if extra != "all" for line in extras[extra]),
    ]
    both = [Requirement(line) for line in (*groups("test"), *wanted)]
    # Coal and Pinocchio ask for a newer NumPy than pieper does; the tests that need them say so and skip.
    floors = {str(oldest_of(r)) for r in map(Requirement, wanted) if r.name != "coal"}
    session.install(*groups("build"), *(str(r) for r in both if r.name not in ("coal", "pin")), *sorted(floors))
    session.install("--no-deps", "--no-build-isolation", ".")
    session.install("--no-deps", TRACKEVAL)
    session.run("python", "-m", "pytest", *session.posargs)


def oldest_of(requirement: Requirement) -> Requirement:
    """A requirement that admits the oldest version alone."""
    (floor,) = (s.version for s in requirement.specifier if s.operator in (">=", "=="))
    requirement.specifier = SpecifierSet(f"=={floor}.*")
    return requirement


@nox.session(python=NEWEST_PYTHON)
def newest(session: nox.Session) -> None:
    """Run the tests with the newest Python and the newest versions, pre-releases included."""
    session.install("--pre", "--upgrade", *groups("build", "test"))
    session.install("--pre", "--no-build-isolation", ".[all]")
    session.install("--no-deps", TRACKEVAL)
    # there is no cyclonedds for it, which the nodes without ROS are made of
    session.run("python", "-m", "pytest", "--doctest-ignore-import-errors", *session.posargs)


@nox.session
def bench(session: nox.Session) -> None:
    """Run the benchmarks named after `--`, or all of them, beside the peers; see benchmarks/README.md."""
    session.install("-r", "benchmarks/requirements.txt", *groups("build", "bench"))
    session.install("--no-deps", "-r", "benchmarks/requirements-urdfs.txt")
    session.install("--no-build-isolation", ".")
    questions = (
        "forward_kinematics",
        "single_call",
        "numeric_ik",
        "every_solution",
        "features",
        "report_loop",
        "segmentation",
        "import_and_size",
        "public_urdfs",
    )
    for question in session.posargs or questions:
        session.run("python", f"benchmarks/{question}.py")
    session.run("python", "benchmarks/plots.py")
    session.run("python", "benchmarks/table.py")
    session.run("python", "benchmarks/recall_table.py")


@nox.session
def oracle(session: nox.Session) -> None:
    """Prove fresh solution sets and compare the general solver with them; `nox -s oracle -- --seed 7 --count 100`."""
    install_pieper(session, "oracle", "test")
    session.run("python", "-m", "proof.oracle", "fresh", *session.posargs)
    session.run("python", "-m", "proof.oracle", "fixture")
    session.run("python", "-m", "pytest", "tests/proof")


@nox.session
def fuzz(session: nox.Session) -> None:
    """Run each fuzz target for ten minutes, or for the seconds given after `--`."""
    install_pieper(session, "test")
    session.install("atheris")
    seconds = session.posargs[0] if session.posargs else "600"
    for target in sorted(Path("fuzz").glob("fuzz_*.py")):
        session.run("python", str(target), f"-max_total_time={seconds}")


if __name__ == "__main__":
    sys.exit("run it with: nox")
