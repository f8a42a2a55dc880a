"""Build the compiled core in every variant, test each with every instruction set, and compare their answers.

Run from a clone with the groups ``build`` and ``test`` installed, or by ``nox -s variants``:

    python scripts/variants.py                                  g++ and clang++, vectors and portable, answers and tests
    python scripts/variants.py --variants clang++-portable      some of them
    python scripts/variants.py --answers                        answers alone, which takes seconds for each

A variant is a compiler, then ``vector`` or ``portable``, then ``libc++`` where it is not the compiler's usual library. The first is what the others are
compared with. What "the same answers" means stands in docs/guides/install.md; the limits are those below.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build" / "variants"
VARIANTS = ("g++-vector", "g++-portable", "clang++-vector", "clang++-portable", "clang++-vector-libc++")
TESTS = ("tests/native", "tests/kinematics", "tests/ik", "tests/laws", "tests/perception/test_segment.py")

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


class Variant(NamedTuple):
    """One way to compile the core."""

    name: str

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

    def build(self) -> None:
        """Compile it and lay it into a folder of its own."""
        site = BUILD / self.name / "site"
        shutil.rmtree(site, ignore_errors=True)
        settings = [f"-Ccmake.define.{key}={value}" for key, value in self.settings.items()]
        pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
        folders = ["--target", str(site), f"-Cbuild-dir={BUILD / self.name / 'wheel'}"]
        run([*pip, *folders, *settings, str(ROOT)], self.environment)

    def native_tests(self) -> None:
        """Those of the C++ library; each goes through every instruction set."""
        folder = str(BUILD / self.name / "native")
        settings = [f"-D{key}={value}" for key, value in self.settings.items()]
        run(
            ["cmake", "-S", str(ROOT), "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", *settings],
            self.environment,
        )
        run(["cmake", "--build", folder], self.environment)
        run(["ctest", "--test-dir", f"{folder}/native", "--output-on-failure"], self.environment)

    def instruction_sets(self) -> list[str]:
        """Those that it has and this processor can run."""
        code = "import json; from pieper._native import kernels; print(json.dumps(kernels.instruction_sets()))"
        found = json.loads(run([sys.executable, "-c", code], self.environment))
        assert isinstance(found, list)
        return found


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
    return report([v for v in variants if v.compiler not in missing], tests=not asked.answers)


def report(variants: list[Variant], *, tests: bool) -> int:
    """Build, ask, test and compare; prints a row for each variant and instruction set. 1 where something differs or fails."""
    columns = ("pose", "jacobian", "closed", "general", "numeric", "centroid", "blobs", "error")
    print("| variant | instruction set | " + " | ".join(columns) + " | native tests | Python tests |", flush=True)
    print("|---" * (len(columns) + 4) + "|", flush=True)
    first: dict[str, Any] | None = None
    failures = []
    for variant in variants:
        variant.build()
        if tests:
            variant.native_tests()
        for instructions in variant.instruction_sets():
            environment = {**variant.environment, "PIEPER_INSTRUCTION_SET": instructions}
            path = BUILD / variant.name / f"{instructions}.npz"
            run([sys.executable, str(Path(__file__)), "--write-answers", str(path)], environment)
            answers = dict(np.load(path))
            first = first or answers
            different = compare(first, answers)
            failures += [f"{variant.name} {instructions}: {wrong}" for wrong in different.wrong]
            said = python_tests(environment) if tests else "-"
            if tests and ("failed" in said or "passed" not in said):
                failures.append(f"{variant.name} {instructions}: {said}")
            cells = [f"{different.largest.get(column, 0.0):.1g}" for column in columns]
            row = [variant.name, instructions, *cells, "passed" if tests else "-", said]
            print("| " + " | ".join(row) + " |", flush=True)
    for failure in failures:
        print(failure, file=sys.stderr)
    return int(bool(failures))


def python_tests(environment: dict[str, str]) -> str:
    """Run the tests that ask the core; the last line of pytest, and all of it where some fail."""
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *TESTS],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        print(done.stdout, file=sys.stderr)
    last = done.stdout.strip().splitlines()[-1].strip("= ").split(" in ")[0]
    return f"{last}, {time.monotonic() - start:.0f} s"


if __name__ == "__main__":
    sys.exit(main())
