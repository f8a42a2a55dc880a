"""Proved solution sets of inverse kinematics: fresh ones, and what the general solver makes of them.

    python -m proof.oracle fresh [--count 20] [--seed N]     new cases, compared with solve_general_6r in every mode
    python -m proof.oracle fixture [--every 16]              cases of the fixture, proved again and compared with it
    python -m proof.oracle write FILE --count 100 --seed N   new cases, written in the format of the fixture

The seed of `fresh` is the date unless it is given, so that every night brings other cases; it is printed.
"""

from __future__ import annotations

import argparse
import datetime as dt
import gzip
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from proof.oracle import cases, rational
from proof.oracle.roots import prove

FIXTURE = Path(__file__).parents[2] / "tests" / "golden" / "ik_oracle.json.gz"
ACCURACY = 1e-9  # [m, rad] of every answer
TRIES = 20


def fresh(count: int, seed: int) -> int:
    """New cases against the general solver; the exit status tells whether a well-conditioned one lost or gained a solution."""
    print(f"{count} fresh cases, seed {seed}")
    failed, total, found, modes = 0, 0, Counter(), ("fast", "checked", "complete")
    start = time.perf_counter()
    for arm, case in proved(count, seed):
        total += case["count"]
        said = []
        for mode in modes:
            missing, surplus, worst = compare(arm, case, mode)
            found[mode] += case["count"] - missing
            if (missing or surplus) and not case["ill_conditioned"]:
                failed += 1
            if worst > ACCURACY:
                failed += 1
            if missing or surplus or worst > ACCURACY:
                said.append(f"{mode}: {missing} missing, {surplus} surplus, worst error {worst:.1e}")
        remark = " (ill-conditioned)" if case["ill_conditioned"] else ""
        verdict = "; ".join(said) or "all found, nothing else"
        print(
            f"  {case['id']} {case['class']:16} {arm.name:34} {case['pose_kind']:16} {case['count']:2}{remark}: {verdict}"
        )
        if said:
            print(f"    pose {json.dumps(case['pose_exact'])}\n    links {json.dumps(arm.data()['links_exact'])}")
    shares = ", ".join(f"{mode} {found[mode]} of {total}" for mode in modes)
    print(f"found: {shares}; {failed} failures in {time.perf_counter() - start:.0f} s")
    return int(failed > 0)


def fixture(every: int) -> int:
    """Cases of the fixture proved again: the same counts and solutions, to the last of their 25 digits."""
    with gzip.open(FIXTURE) as file:
        data = json.load(file)
    arms = {key: rational.RationalArm.read(arm) for key, arm in data["arms"].items()}
    same = undecided = 0
    wrong = []
    for case in data["cases"][::every]:
        pose = rational.from_rows(case["pose_exact"])
        first, _ = prove(arms[case["arm"]], pose, np.random.default_rng(len(case["id"])), confirm=False)
        if first is None or first.status != "proved":
            undecided += 1
            continue
        mine = sorted([cases.decimal(x) for x in q] for q in first.solutions)
        listed = sorted(solution["q25"] for solution in case["solutions"])
        if len(mine) == len(listed) and same_decimals(mine, listed):
            same += 1
        else:
            wrong.append(case["id"])
    print(f"{same} cases proved again with the same solutions, {undecided} not decided, {len(wrong)} different {wrong}")
    return int(bool(wrong) or undecided > same // 20)


def write(path: Path, count: int, seed: int) -> int:
    """New cases as a file."""
    arms, made = {}, []
    for number, (arm, case) in enumerate(proved(count, seed)):
        key = f"a{number:03}"
        arms[key] = arm.data()
        made.append({**case, "arm": key})
    data = {
        "format": 1,
        "units": {"length": "m", "angle": "rad"},
        "chain": "base Rz(q1) L1 Rz(q2) L2 Rz(q3) L3 Rz(q4) L4 Rz(q5) L5 Rz(q6) L6 = pose",
        "counts": dict(Counter(case["class"] for case in made)),
        "total": len(made),
        "total_solutions": sum(case["count"] for case in made),
        "seed": seed,
        "arms": arms,
        "cases": made,
        "multiple": [],
    }
    with gzip.open(path, "wt") as file:
        json.dump(data, file)
    print(f"{len(made)} cases with {data['total_solutions']} solutions in {path}")
    return 0


def compare(arm: rational.RationalArm, case: dict, mode: str) -> tuple[int, int, float]:
    """Solutions that the general solver does not find, answers that are none of them, and the worst error."""
    from pieper.ik.general_6r import solve_general_6r

    answers = solve_general_6r(chain(arm), np.array(case["pose"]), mode=mode)
    left = [np.array(q) for q in answers.q[answers.valid]]
    missing = 0
    for solution in case["solutions"]:
        gaps = [_apart(q, np.array(solution["q"])) for q in left]
        if gaps and min(gaps) <= 1e-9 + 100.0 * solution["bound"]:
            del left[int(np.argmin(gaps))]
        else:
            missing += 1
    errors = [np.nanmax(error, initial=0.0) for error in (answers.position_error, answers.rotation_error)]
    return missing, len(left), float(max(errors))


def chain(arm: rational.RationalArm) -> object:
    """The arm in double precision, for the package under test."""
    from pieper.model.chain import Chain

    T, screws = rational.as_float(arm.base), []
    for link in arm.links:
        z = T[:3, 2] / np.linalg.norm(T[:3, 2])
        screws.append(np.concatenate([np.cross(T[:3, 3], z), z]))
        T = T @ rational.as_float(link)
    u, _, v = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ v
    return Chain(arm.name, np.array(screws), T, np.tile([-np.pi, np.pi], (6, 1)), tuple(f"q{i + 1}" for i in range(6)))


def proved(count: int, seed: int) -> Iterator[tuple[rational.RationalArm, dict]]:
    """Pairs of an arm and a case about which a count could be proved."""
    made = 0
    for number, one in enumerate(cases.questions(TRIES * count, seed)):
        case = cases.answer(one, seed + number, arm=one.arm.name, key=f"{seed}-{number}")
        if case is not None:
            made += 1
            yield one.arm, case
        if made == count:
            return
    raise ArithmeticError(f"only {made} of {TRIES * count} poses could be decided")


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(np.remainder(a - b + np.pi, 2.0 * np.pi) - np.pi).max())


def same_decimals(mine: list[list[str]], listed: list[list[str]]) -> bool:
    """Whether two lists of joints in decimals are the same set; the last decimal may be rounded either way, -pi is pi."""
    turn, left = 62831853071795864769252868, [[int(x.replace(".", "")) for x in q] for q in listed]
    for q in mine:
        digits = [int(x.replace(".", "")) for x in q]
        near = [p for p in left if all(min(abs(x - y), turn - abs(x - y)) <= 3 for x, y in zip(digits, p, strict=True))]
        if not near:
            return False
        left.remove(near[0])
    return not left


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    today = int(dt.datetime.now(dt.timezone.utc).strftime("%Y%m%d"))
    command = verbs.add_parser("fresh")
    command.add_argument("--count", type=int, default=20)
    command.add_argument("--seed", type=int, default=today)
    command = verbs.add_parser("fixture")
    command.add_argument("--every", type=int, default=16)
    command = verbs.add_parser("write")
    command.add_argument("file", type=Path)
    command.add_argument("--count", type=int, default=100)
    command.add_argument("--seed", type=int, default=today)
    options = vars(parser.parse_args())
    if "file" in options:
        options["path"] = options.pop("file")
    do: dict[str, Callable[..., int]] = {"fresh": fresh, "fixture": fixture, "write": write}
    return do[options.pop("verb")](**options)


if __name__ == "__main__":
    sys.exit(main())
