"""Build the compiled core in every variant, test each with every instruction set, and compare their answers.

Run from a clone with the groups ``build`` and ``test`` installed, or by ``nox -s variants``:

    python scripts/variants.py                                  g++ and clang++, vectors and portable, answers and tests
    python scripts/variants.py --variants clang++-portable      some of them
    python scripts/variants.py --answers                        answers alone, which takes seconds for each
    python scripts/variants.py --jobs 8                         tests on eight processes

A variant is a compiler, then ``vector`` or ``portable``, then ``libc++`` where it is not the compiler's usual library. The first is what the others are
compared with. What "the same answers" means stands in docs/guides/install.md; the limits are those below.

What was found is kept in build/variants.json as it comes, so that a run that was cut off goes on where it stopped; what was found of other sources, by
another compiler, or amiss, is looked for again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build" / "variants"
KEPT = ROOT / "build" / "variants.json"
VARIANTS = ("g++-vector", "g++-portable", "clang++-vector", "clang++-portable", "clang++-vector-libc++")
# Those that ask the kernels most; what stands on top of the kernels is tested once, by ./test.
TESTS = (
    "tests/native",
    "tests/kinematics/test_fk.py",
    "tests/kinematics/test_jacobian.py",
    "tests/ik/test_closed_form.py",
    "tests/ik/test_general_6r.py",
    "tests/ik/test_general_6r_safeguards.py",
    "tests/ik/test_general_6r_slide.py",
    "tests/ik/test_instruction_sets.py",
    "tests/ik/test_numeric.py",
    "tests/ik/test_random_arms.py",
    "tests/laws/test_completeness.py",
    "tests/laws/test_families_of_answers.py",
    "tests/laws/test_free_joints_and_limits.py",
    "tests/laws/test_inverse_kinematics.py",
    "tests/laws/test_just_out_of_reach.py",
    "tests/laws/test_numeric_inverse_kinematics.py",
    "tests/perception/test_segment.py",
    "tests/workspace/test_scores.py",
)
# What those tests are about, of the package; and the files there that count.
ROOMS = ("_native", "spatial", "model", "kinematics", "ik", "workspace", "perception/segment.py")
SOURCES = (".cpp", ".hpp", ".py", ".json", ".txt")

# Rounding of some hundred operations on numbers of size 1; measured: 7e-16.
SAME_POSE = 1e-14
# rad or m, where the pose decides the joints to that many digits; measured: 4e-13
SAME_JOINTS = 1e-8
# [m, rad] of every answer, measured at the pose that it gives; iteration stops there
ACCURACY = 1e-9
# least singular value at all answers of a pose: above it rounding moves no answer by SAME_JOINTS, and none comes or goes
REGULAR = 1e-4
# px; measured: 0
SAME_PLACE = 1e-9


class Variant:
    """One way to compile the core."""

    def __init__(self, name: str) -> None:
        self.name = name

    @property
    def compiler(self) -> str:
        return self.name.split("-")[0]

    @property
    def settings(self) -> dict[str, str]:
        """What CMake is told."""
        found = {"PIEPER_PORTABLE": "ON" if "portable" in self.name else "OFF"}
        if self.name.endswith("libc++"):
            found |= {"CMAKE_CXX_FLAGS": "-stdlib=libc++", "CMAKE_SHARED_LINKER_FLAGS": "-stdlib=libc++"}
        return found

    @property
    def environment(self) -> dict[str, str]:
        """The environment in which this variant is the pieper that is imported."""
        paths = [str(BUILD / self.name / "site"), str(ROOT)]
        return {**os.environ, "CXX": self.compiler, "PYTHONPATH": os.pathsep.join(paths)}

    @property
    def compiler_version(self) -> str:
        return run([self.compiler, "--version"], dict(os.environ)).splitlines()[0]

    @cached_property
    def instruction_sets(self) -> list[str]:
        """Those that it has and this processor can run; compiles it, and lays it into a folder of its own."""
        say(f"{self.name}: compiling")
        self.build()
        code = "import json; from pieper._native import kernels; print(json.dumps(kernels.instruction_sets()))"
        found = json.loads(run([sys.executable, "-c", code], self.environment))
        assert isinstance(found, list)
        return found

    def build(self) -> None:
        site = BUILD / self.name / "site"
        shutil.rmtree(site, ignore_errors=True)
        settings = [f"-Ccmake.define.{key}={value}" for key, value in self.settings.items()]
        pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
        folders = ["--target", str(site), f"-Cbuild-dir={BUILD / self.name / 'wheel'}"]
        run([*pip, *folders, *settings, str(ROOT)], self.environment)

    @cached_property
    def native_tests(self) -> int:
        """How many of those of the C++ library passed, which is all; each goes through every instruction set."""
        say(f"{self.name}: native tests")
        folder = str(BUILD / self.name / "native")
        settings = [f"-D{key}={value}" for key, value in self.settings.items()]
        cmake = ["cmake", "-S", str(ROOT), "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", *settings]
        run(cmake, self.environment)
        run(["cmake", "--build", folder], self.environment)
        said = run(["ctest", "--test-dir", f"{folder}/native", "--output-on-failure"], self.environment)
        (count,) = re.findall(r"^100% tests passed.* out of (\d+)$", said, re.MULTILINE)
        return int(count)


def say(what: str) -> None:
    """A line of progress."""
    print(f"{time.strftime('%H:%M:%S')} {what}", file=sys.stderr, flush=True)


def run(command: list[str], environment: dict[str, str]) -> str:
    """What a command prints; where it fails, that goes to standard error and this ends."""
    done = subprocess.run(
        command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode != 0:
        print(done.stdout, file=sys.stderr)
        sys.exit(f"failed: {' '.join(command)}")
    return done.stdout


# --- what is asked


def write_answers(path: str) -> None:
    """Answers of the pieper that is imported, to questions that no variant takes part in asking."""
    from pieper.ik.closed_form import solve_closed_form
    from pieper.ik.family import find_family
    from pieper.ik.general_6r import solve_general_6r
    from pieper.ik.numeric import solve_numeric
    from pieper.kinematics.fk import fk
    from pieper.kinematics.jacobian import jacobian
    from pieper.perception.segment import label_image, segment
    from tests.perception.discs import TWO_COLORS, disc_frame
    from tests.reference import product_of_exponentials as textbook
    from tests.robots import ROBOTS, chain

    found: dict[str, Any] = {}
    for robot in ROBOTS:
        arm, rng = chain(robot.name), np.random.default_rng(31)
        grid = [rng.integers(-6, 7, (8, robot.dof)) * step for step in (np.pi / 2, np.pi / 4, 0.5)]
        q = np.concatenate([rng.uniform(-np.pi, np.pi, (96, robot.dof)), *grid])
        T = np.stack([textbook.fk(arm, row) for row in q])
        found[f"{robot.name} pose"] = fk(arm, q)
        found[f"{robot.name} jacobian"] = jacobian(arm, q)
        closed = find_family(arm).has_closed_form
        if closed:
            store(found, "closed", arm, robot.name, solve_closed_form(arm, find_family(arm), T))
        if robot.dof == 6:
            store(found, "general", arm, robot.name, solve_general_6r(arm, T[::3]))
        lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
        inside = lower + (upper - lower) * rng.uniform(0.1, 0.9, (40, robot.dof))
        reached = np.stack([textbook.fk(arm, row) for row in inside])
        store(found, "numeric", arm, robot.name, solve_numeric(arm, reached, seed=inside + 0.02))
    for k in range(4):
        frame, _ = disc_frame(np.random.default_rng(k), 12, noise=2.0 * k)
        blobs = segment(frame, TWO_COLORS)
        for field in ("color", "area", "extent", "circularity", "centroid"):
            found[f"frame{k} {field}"] = getattr(blobs, field)
        found[f"frame{k} labels"] = label_image(frame, TWO_COLORS)
    np.savez(path, **found)


def store(found: dict[str, Any], kind: str, arm: Any, name: str, answers: Any) -> None:
    """The arrays of a set of answers, and the least singular value at each."""
    from pieper.kinematics.jacobian import jacobian

    for field in ("q", "valid", "position_error", "rotation_error"):
        found[f"{name} {kind} {field}"] = getattr(answers, field)
    least = np.full(answers.valid.shape, np.inf)
    least[answers.valid] = np.linalg.svd(jacobian(arm, answers.q[answers.valid]), compute_uv=False)[:, -1]
    found[f"{name} {kind} least"] = least


# --- and how the answers differ


class Difference:
    """The largest differences of one variant from the first, and what went beyond its limit."""

    def __init__(self) -> None:
        self.largest: dict[str, float] = {}
        self.wrong: list[str] = []

    def note(self, kind: str, where: str, value: float, limit: float) -> None:
        self.largest[kind] = max(self.largest.get(kind, 0.0), value)
        if not value <= limit:
            self.wrong.append(f"{where}: {value:.3g} is more than {limit:.3g}")


def compare(first: dict[str, Any], other: dict[str, Any]) -> Difference:
    """See `docs/guides/install.md`: what is the same to the last bit, and what within rounding."""
    found = Difference()
    if first.keys() != other.keys():
        found.wrong.append(f"asked differently: {sorted(first.keys() ^ other.keys())}")
    for name in first.keys() & other.keys():
        who, kind, *field = name.split()
        if kind in ("pose", "jacobian"):
            found.note(kind, name, apart(first[name], other[name]), SAME_POSE)
        elif kind == "centroid":
            found.note(kind, name, apart(first[name], other[name]), SAME_PLACE)
        elif who.startswith("frame"):
            found.note("blobs", name, float(not np.array_equal(first[name], other[name])), 0.0)
        elif field == ["q"]:
            compare_sets(found, f"{who} {kind}", kind, first, other)
    return found


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """The largest difference; infinite where shapes differ."""
    return float(np.abs(a - b).max(initial=0.0)) if a.shape == b.shape else np.inf


def compare_sets(found: Difference, name: str, kind: str, first: dict[str, Any], other: dict[str, Any]) -> None:
    """Equal sets where all answers are regular; near singular poses that there are answers to the same poses, and that they are right."""
    q, valid = first[f"{name} q"], first[f"{name} valid"]
    r, allowed = other[f"{name} q"], other[f"{name} valid"]
    for error in ("position_error", "rotation_error"):
        found.note("error", f"{name} {error}", float(other[f"{name} {error}"][allowed].max(initial=0.0)), ACCURACY)
    if (valid.any(axis=1) != allowed.any(axis=1)).any():
        found.wrong.append(f"{name}: poses with an answer and without")
    least = first[f"{name} least"].min(axis=1)
    for k in np.flatnonzero(least > REGULAR):
        mine, theirs = q[k][valid[k]], r[k][allowed[k]]
        if len(mine) != len(theirs):
            found.wrong.append(f"{name}, pose {k}: {len(mine)} answers and {len(theirs)}")
        elif len(mine):
            gap = np.abs(np.remainder(mine[:, None] - theirs + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
            limit = SAME_JOINTS + (4 * ACCURACY / least[k] if kind == "numeric" else 0.0)
            found.note(kind, f"{name}, pose {k}", float(max(gap.min(axis=0).max(), gap.min(axis=1).max())), limit)


# --- everything together


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, help="instead of all whose compiler is here")
    parser.add_argument("--answers", action="store_true", help="compare answers, and leave the tests out")
    parser.add_argument("--jobs", default="1", help="processes that a run of the tests takes (default: 1)")
    parser.add_argument(
        "--fresh", action="store_true", help="look for everything again, whatever build/variants.json holds"
    )
    parser.add_argument("--write-answers", metavar="FILE", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.write_answers:
        write_answers(asked.write_answers)
        return 0
    variants = [Variant(name) for name in asked.variants or VARIANTS]
    if missing := {v.compiler for v in variants if not shutil.which(v.compiler)}:
        if asked.variants:
            sys.exit(f"not installed: {', '.join(sorted(missing))}")
        print(f"left out, not installed: {', '.join(sorted(missing))}", file=sys.stderr)
    jobs = "" if asked.answers else asked.jobs
    found = examine(
        [v for v in variants if v.compiler not in missing], jobs=jobs, kept={} if asked.fresh else read_kept()
    )
    print(table(found))
    wrong = [f"{name}: {words}" for name, one in found.items() for words in one["wrong"]]
    for line in wrong:
        print(line, file=sys.stderr)
    return int(bool(wrong))


def examine(variants: list[Variant], *, jobs: str, kept: dict[str, Any]) -> dict[str, Any]:
    """Build, ask, test and compare: what was found of each variant and instruction set. Without jobs no tests are run."""
    sources, found = fingerprint(), dict[str, Any]()
    first: dict[str, Any] | None = None
    for variant in variants:
        of = {"sources": sources, "compiler": variant.compiler_version, "processor": processor()}
        for instructions in variant.instruction_sets:
            name = f"{variant.name} {instructions}"
            path = BUILD / variant.name / f"{instructions}.npz"
            before = kept.get(name, {})
            known = is_whole(before, of, tests=bool(jobs)) and path.exists()
            if not known:
                say(f"{name}: answers")
                environment = {**variant.environment, "PIEPER_INSTRUCTION_SET": instructions}
                run([sys.executable, str(Path(__file__)), "--write-answers", str(path)], environment)
            first = first or dict(np.load(path))
            different = compare(first, dict(np.load(path)))
            one = {**of, "native": None, "python": None, "largest": different.largest, "wrong": different.wrong}
            if known:
                one = {**before, **one, "native": before["native"], "python": before["python"]}
            elif jobs:
                one["native"] = variant.native_tests
                say(f"{name}: {one['native']} native tests passed; Python tests")
                one["python"] = counts = python_tests(environment, jobs)
                if set(counts) - {"passed", "skipped", "seconds"} or not counts.get("passed"):
                    one["wrong"] = [*different.wrong, f"tests: {counts}"]
            found[name] = kept[name] = one
            KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
            say(f"{name}: {row(name, one)}{' (kept)' if known else ''}")
    return found


def read_kept() -> dict[str, Any]:
    """What earlier runs found, by variant and instruction set."""
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    assert isinstance(kept, dict)
    return kept


def is_whole(one: dict[str, Any], of: dict[str, str], *, tests: bool) -> bool:
    """Whether what was found is of these sources, this compiler and processor, with tests if wanted, and nothing was amiss."""
    return (
        all(one.get(key) == value for key, value in of.items())
        and not one["wrong"]
        and bool(one["python"] or not tests)
    )


def fingerprint() -> str:
    """Of every file that decides what is compiled, asked and tested."""
    files: set[Path] = set()
    for place in (
        *(ROOT / "src" / "pieper" / room for room in ROOMS),
        *(ROOT / other for other in ("CMakeLists.txt", "native", *TESTS)),
    ):
        files |= {p for p in place.rglob("*") if p.suffix in SOURCES} if place.is_dir() else {place}
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(files):
        digest.update(f"{path.relative_to(ROOT)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def processor() -> str:
    """Its name, as far as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    found = (
        re.findall(r"^model name\s*: (.*)$", cpuinfo.read_text(encoding="utf-8"), re.MULTILINE)
        if cpuinfo.exists()
        else []
    )
    return found[0] if found else platform.processor()


def python_tests(environment: dict[str, str], jobs: str) -> dict[str, float]:
    """Run the tests that ask the core: how many passed, failed and so on, and the seconds it took; prints all where some fail."""
    start = time.monotonic()
    parallel = [] if jobs == "1" else ["-n", jobs]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *parallel, *TESTS],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        print(done.stdout, file=sys.stderr)
    last = done.stdout.strip().splitlines()[-1]
    counts = {
        what.rstrip("s"): int(count)
        for count, what in re.findall(r"(\d+) (passed|failed|skipped|errors?|warnings?)", last)
    }
    return {**counts, "seconds": round(time.monotonic() - start)}


# --- and the table


COLUMNS = ("pose", "jacobian", "closed", "general", "numeric", "centroid", "blobs", "error")


def row(name: str, one: dict[str, Any]) -> str:
    """Largest differences from the first, and how many tests passed."""
    cells = [*name.split(), *(f"{one['largest'].get(column, 0.0):.1g}" for column in COLUMNS)]
    counts = one["python"]
    tests = (
        "-"
        if counts is None
        else ", ".join(f"{v} {k}" for k, v in counts.items() if k != "seconds") + f", {counts['seconds']} s"
    )
    return "| " + " | ".join([*cells, str(one["native"] or "-"), tests]) + " |"


def table(found: dict[str, Any]) -> str:
    """A row for each variant and instruction set, under the compilers and the processor that they are of."""
    of = sorted({one["compiler"] for one in found.values()} | {one["processor"] for one in found.values()})
    head = "| variant | instruction set | " + " | ".join(COLUMNS) + " | native tests passed | Python tests |"
    lines = [
        ", ".join(of),
        "",
        head,
        "|---" * (len(COLUMNS) + 4) + "|",
        *(row(name, one) for name, one in found.items()),
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
