"""Does inverse kinematics find every answer, on every arm, also where it is hard?

For the built-in arms of five and six joints and for those of public_arms.py, poses of four kinds are made from joint
values, and the joint values that made a pose have to be among its answers:

- random: joints uniform within half a turn either way;
- grid: joints at multiples of 90 degrees, 45 degrees and 0.5 rad;
- near-singular: 1e-2 to 1e-12 rad from where the least singular value of the Jacobian vanishes, found by minimising it
  along one joint; kinds are told apart by the joints that lead away from the singularity. Joint 5 alone is the wrist of
  common arms, joint 3 alone the elbow, several joints together the shoulder;
- boundary: 1e-6 m within the edge of the workspace (the farthest point in some direction), and 1e-3 to 1e-9 within folds,
  where two answers meet. Beyond the edge by 1e-3 m there must be no answer.

Where the generating joint values are not among the answers (but for grid poses and those nearer than 1e-8) the curve of
joint values that give the same pose to 1e-9 is followed from them: an answer on it is on the generating branch.

Every answer is judged by a forward kinematics that shares no code with the package: one off by more than 1e-9 [m or rad]
is false. Arms with a closed form are solved by it, and by the general solver too; what the closed form calls doubtful goes
to the general solver in the row "both".

    python benchmarks/recall.py [--poses 20000] [--poses-built-in 1000000] [--structured 1000] [--arms ur5e ...]

Each arm is kept in build/recall/ when it is done; a run that was cut off goes on there.
"""

import argparse
import hashlib
import json
import pathlib
import re
import sys
from collections.abc import Callable, Iterator

import paired  # noqa: F401  (one thread for linear algebra)

# isort: split
import arms
import numpy as np
import public_arms
import results

sys.path.append(str(results.HERE.parent))
from tests.reference import hard_poses, self_motion

KEPT = results.HERE.parent / "build" / "recall"
GOOD = 1e-9  # [m and rad]
ROUNDING = 1e-12  # what the judge adds of its own on arms of a few metres
SAME = 1e-6  # rad
SAME_SINGULAR = (1e-5, 1e-2)  # rad: where two answers meet, a difference of 1e-5 is one of 1e-10 in the pose
TOLD_APART = 1e-10  # over the least singular value: joint values closer than that give the same pose to a tenth of GOOD
POSE_ROUNDING = 1e-14  # over the least singular value: how far rounding of the pose moves joints
REGULAR = 1e-4  # least singular value
CHUNK = 20_000
STEPS = {"90 degrees": np.pi / 2, "45 degrees": np.pi / 4, "0.5 rad": 0.5}
DISTANCES = tuple(10.0**-k for k in range(2, 13))
TRACED = 0.9e-8  # rad: nearer to a singularity whole curves give the pose
FOLDS = (1e-3, 1e-6, 1e-9)
LISTED, LISTED_IN_DATA = 5, 1
Answers = tuple[np.ndarray, np.ndarray, np.ndarray]  # q, valid, doubtful


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest difference of joint angles, full turns aside; infinite for rows of NaN."""
    gap = np.abs(np.remainder(a - b + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
    return np.where(np.isnan(gap), np.inf, gap)


class Tally:
    """What came of one kind of poses with one solver."""

    def __init__(self) -> None:
        self.figures = {"poses": 0, "regular": 0, "generating": 0, "generating_regular": 0, "branch": 0, "answered": 0}
        self.figures |= {"answers": 0, "false": 0, "doubtful": 0, "lost_without_doubt": 0}
        self.worst = {"position": 0.0, "rotation": 0.0}
        self.lost: list[list[float]] = []
        self.off_branch: list[list[float]] = []
        self.unanswered: list[list[float]] = []

    def add(
        self,
        q: np.ndarray,
        regular: np.ndarray,
        found: np.ndarray,
        branch: np.ndarray,
        answers: Answers,
        errors: tuple[np.ndarray, ...],
    ) -> None:
        _, valid, doubtful = answers
        position, rotation = errors
        sums = {
            "poses": len(q),
            "regular": regular.sum(),
            "generating": found.sum(),
            "generating_regular": (found & regular).sum(),
            "branch": branch.sum(),
            "answered": valid.any(axis=1).sum(),
            "answers": valid.sum(),
            "false": ((position > GOOD + ROUNDING) | (rotation > GOOD + ROUNDING)).sum(),
            "doubtful": doubtful.sum(),
            "lost_without_doubt": (regular & ~found & ~doubtful).sum(),
        }
        for key, value in sums.items():
            self.figures[key] += int(value)
        self.worst["position"] = max(self.worst["position"], float(position.max(initial=0.0)))
        self.worst["rotation"] = max(self.worst["rotation"], float(rotation.max(initial=0.0)))
        listed = ((self.lost, regular & ~found), (self.off_branch, ~branch), (self.unanswered, ~valid.any(axis=1)))
        for rows, which in listed:
            rows += q[which][: LISTED - len(rows)].tolist()

    def data(self) -> dict:
        lists = {"lost": self.lost, "off_branch": self.off_branch, "unanswered_at": self.unanswered}
        return {
            **self.figures,
            "worst": results.rounded(self.worst, 2),
            **{key: rows for key, rows in lists.items() if rows},
        }


class Case:
    """An arm with its judge, its solvers, and a least singular value."""

    def __init__(self, judge: public_arms.Arm, chain: object) -> None:
        from pieper.ik.family import find_family
        from pieper.kinematics.jacobian import jacobian

        self.judge, self.chain, self.dof = judge, chain, judge.dof
        self.family = find_family(chain)
        self.jacobian: Callable[[np.ndarray], np.ndarray] = lambda q: jacobian(chain, q)
        self.solvers: dict[str, Callable[[np.ndarray], Answers]] = {}
        if self.family.has_closed_form and self.family.complete:
            self.solvers["closed form"] = self.closed_form
        if self.dof == 6:
            self.solvers["general"] = self.general

    def closed_form(self, T: np.ndarray) -> Answers:
        from pieper.ik.closed_form import solve_closed_form

        answers = solve_closed_form(self.chain, self.family, T)
        return answers.q, answers.valid, answers.doubtful

    def general(self, T: np.ndarray) -> Answers:
        from pieper.ik.general_6r import Flag, solve_general_6r

        answers = solve_general_6r(self.chain, T)
        return answers.q, answers.valid, (answers.flags & Flag.doubtful) != 0

    def least(self, q: np.ndarray) -> np.ndarray:
        return hard_poses.least(self.jacobian, q)

    def judged(self, answers: Answers, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, valid, _ = answers
        return arms.pose_errors(self.judge.forward(q[valid]), np.repeat(T, valid.sum(axis=1), axis=0))

    def tally(self, q: np.ndarray, *, special: bool, trace: bool = True) -> dict[str, dict]:
        """All solvers on the poses of q. Of `special` ones some may be singular; `trace` says whether to follow curves."""
        tallies = {name: Tally() for name in self.solvers}
        if len(self.solvers) == 2:
            tallies["both"] = Tally()
        for start in range(0, len(q), CHUNK):
            part = q[start : start + CHUNK]
            T = self.judge.forward(part)
            regular, near = np.full(len(part), True), np.full(len(part), SAME)
            if special:
                least = self.least(part)
                regular = least > REGULAR
                near = np.clip(TOLD_APART / np.maximum(least, 1e-300), *SAME_SINGULAR)
            each = {}
            for name, solve in self.solvers.items():
                answers = solve(T)
                found = (answers[1] & (apart(answers[0], part[:, None]) < near[:, None])).any(axis=1)
                if not special and not found.all():  # a random pose may be singular too
                    miss = np.flatnonzero(~found)
                    reach = np.clip(POSE_ROUNDING / self.least(part[miss]), SAME, SAME_SINGULAR[1])[:, None]
                    found[miss] = (answers[1][miss] & (apart(answers[0][miss], part[miss][:, None]) < reach)).any(
                        axis=1
                    )
                branch = found if trace else np.full(len(part), True)
                miss = np.flatnonzero(~found & answers[1].any(axis=1))
                if len(miss) and trace:
                    branch = found.copy()
                    q_of = np.where(answers[1][miss][..., None], answers[0][miss], np.nan)
                    branch[miss] = self_motion.connected(part[miss], q_of, self.judge.forward, self.jacobian, GOOD)
                errors = self.judged(answers, T)
                tallies[name].add(part, regular, found, branch, answers, errors)
                each[name] = (answers, found, branch, errors)
            if "both" in tallies:
                tallies["both"].add(part, regular, *self.merged(each, np.repeat))
        return {name: tally.data() for name, tally in tallies.items()}

    @staticmethod
    def merged(each: dict, repeat: Callable) -> tuple:
        """The closed form's answers, and the general solver's where those are doubtful."""
        (closed, found, branch, errors), (general, also, other, more) = each["closed form"], each["general"]
        second = closed[2]
        valid = np.zeros((len(second), max(closed[1].shape[1], general[1].shape[1])), dtype=bool)
        valid[:, : closed[1].shape[1]] = closed[1] & ~second[:, None]
        valid[second, : general[1].shape[1]] = general[1][second]
        kept = [
            np.concatenate(
                [ours[repeat(~second, closed[1].sum(axis=1))], theirs[repeat(second, general[1].sum(axis=1))]]
            )
            for ours, theirs in zip(errors, more, strict=True)
        ]
        answers = (None, valid, second & general[2])
        return np.where(second, also, found), np.where(second, other, branch), answers, tuple(kept)


# The report


def structured(case: Case, poses: int, *, seed: int) -> dict:
    """All kinds of poses but random ones."""
    rng = np.random.default_rng(seed)
    few, forward = max(poses // 8, 12), case.judge.forward
    grid = {
        words: case.tally(rng.integers(-8, 9, (poses, case.dof)) * step, special=True, trace=False)
        for words, step in STEPS.items()
    }
    near: dict[str, dict] = {}
    folds: dict[str, list[np.ndarray]] = {f"{depth:g} within a fold": [] for depth in FOLDS}
    for words, at, joint in hard_poses.singular(case.jacobian, case.dof, few, rng):
        near[words] = {"0": case.tally(at, special=True, trace=False)}
        for distance in DISTANCES:
            q = at.copy()
            q[np.arange(len(q)), joint] += distance
            near[words][f"{distance:g}"] = case.tally(q, special=True, trace=distance >= TRACED)
        for depth in FOLDS:
            folds[f"{depth:g} within a fold"].append(hard_poses.inside_fold(case.jacobian, at, depth))
    edge, directions = hard_poses.farthest(forward, case.dof, few, rng)
    inside = hard_poses.inside_edge(forward, edge, directions, 1e-6, rng)
    boundary = {"1e-06 within the edge": case.tally(inside, special=True)}
    boundary |= {words: case.tally(np.concatenate(q), special=True) for words, q in folds.items() if q}
    T = forward(edge)
    T[:, :3, 3] += 1e-3 * directions
    beyond = {
        name: {"poses": len(T), "answered": int(solve(T)[1].any(axis=1).sum())} for name, solve in case.solvers.items()
    }
    return {"grid": grid, "near-singular": near, "boundary": boundary, "beyond": beyond}


def random(case: Case, poses: int, *, seed: int) -> dict:
    return case.tally(np.random.default_rng(seed).uniform(-np.pi, np.pi, (poses, case.dof)), special=False)


def gather(near: dict) -> None:
    """One tally for all distances that are too small for the generating joints to be told."""
    for distances in near.values():
        small = [distances.pop(key) for key in list(distances) if 0.0 < float(key) < TRACED]
        distances[f"{DISTANCES[-4]:g} to {DISTANCES[-1]:g}"] = {
            solver: _sum([tallies[solver] for tallies in small]) for solver in small[0]
        }


def _sum(tallies: list[dict]) -> dict:
    added = {key: sum(tally[key] for tally in tallies) for key, value in tallies[0].items() if isinstance(value, int)}
    worst = {key: max(tally["worst"][key] for tally in tallies) for key in ("position", "rotation")}
    lists = {key: [row for tally in tallies for row in tally.get(key, [])][:LISTED] for key in EXAMPLES}
    return {**added, "worst": worst, **{key: rows for key, rows in lists.items() if rows}}


def ask_again(kinds: dict, judge: public_arms.Arm, make: Callable[[], object]) -> None:
    """What the package's one call, `pieper.ik.solve`, says to the poses that are listed as unanswered."""
    from pieper.ik.solve import solve

    chain = None
    for tally in _tallies(kinds):
        if "unanswered_at" in tally:
            chain = chain or make()
            answers = solve(chain, judge.forward(np.array(tally["unanswered_at"])))
            tally["answers_of_solve"] = np.sum(answers.valid, axis=-1).tolist()


def _tallies(kinds: dict) -> Iterator[dict]:
    for value in kinds.values():
        if "answered" in value and "worst" in value:
            yield value
        elif isinstance(value, dict) and "answered" not in value:
            yield from _tallies(value)


def fingerprint() -> str:
    """What is measured: the compiled module, and the Python of inverse kinematics."""
    import pieper.ik
    from pieper._native import kernels

    files = [pathlib.Path(kernels.__file__), *sorted(pathlib.Path(pieper.ik.__file__).parent.glob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def cases() -> Iterator[tuple[str, public_arms.Arm, bool]]:
    for name in public_arms.built_in_names():
        yield name, public_arms.built_in(name), True
    for arm in public_arms.public():
        yield f"{arm.source.partition(' ')[0]} {arm.name}", arm, False


def chain_of(key: str, arm: public_arms.Arm, built_in: bool) -> object:
    from pieper.model import catalog
    from pieper.model.chain import Chain

    if built_in:
        return catalog.describe(key).chain()
    limits = np.tile([-np.pi, np.pi], (arm.dof, 1))
    return Chain(arm.name, arm.screws, arm.home, limits, tuple(f"q{k + 1}" for k in range(arm.dof)))


def main() -> None:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=20_000, help="random poses of each public arm")
    parser.add_argument("--poses-built-in", type=int, default=1_000_000, help="random poses of each built-in arm")
    parser.add_argument("--structured", type=int, default=1000, help="grid poses of each step; other kinds follow it")
    parser.add_argument("--arms", nargs="*", help="only those with these words in their names")
    options = parser.parse_args()

    chosen = [item for item in cases() if not options.arms or any(word in item[0] for word in options.arms)]
    KEPT.mkdir(parents=True, exist_ok=True)
    sources, rows = fingerprint(), []
    columns = (TextColumn("{task.description:40}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns) as progress:
        task = progress.add_task("", total=len(chosen))
        for key, judge, built_in in chosen:
            progress.update(task, description=key)
            path = KEPT / (re.sub(r"[^\w.-]+", "_", key) + ".json")
            kept = json.loads(path.read_text()) if path.exists() else {}
            poses = options.poses_built_in if built_in else options.poses
            seed = int.from_bytes(hashlib.sha256(key.encode()).digest()[:4], "big")
            case: Case | None = None
            for part, count, work in (("random", poses, random), ("structured", options.structured, structured)):
                asked = {"poses": count, "sources": sources}
                if kept.get(part, {}).get("asked") == asked:
                    continue
                case = case or Case(judge, chain_of(key, judge, built_in))
                kept[part] = {"asked": asked, "kinds": work(case, count, seed=seed)}
                kept |= {"arm": key, "source": judge.source, "note": judge.note, "joints": judge.dof}
                kept["family"] = case.family.reason
                path.write_text(json.dumps(kept))
            kinds = {"random": kept.pop("random")["kinds"], **kept.pop("structured")["kinds"]}
            gather(kinds["near-singular"])
            ask_again(kinds, judge, lambda key=key, judge=judge, built_in=built_in: chain_of(key, judge, built_in))
            rows.append({**kept, "kinds": kinds})
            progress.advance(task)
    for row in rows:
        print(line(row))
    if not options.arms:
        save(rows, options)


def line(row: dict) -> str:
    text = f"{row['arm']:44}"
    for name, figures in row["kinds"]["random"].items():
        lost = figures["poses"] - figures["generating"]
        text += f" {name}: {lost} lost of {figures['poses']}, {figures['false']} false;"
    return text


FIGURES = ("poses", "regular", "generating", "generating_regular", "branch", "answered", "answers", "false", "doubtful")
FIGURES += ("lost_without_doubt", "worst_position", "worst_rotation")
NOTHING_LOST = ("poses", "regular", "answers", "worst_position", "worst_rotation")
EXAMPLES = ("lost", "off_branch", "unanswered_at", "answers_of_solve")


def packed(kinds: dict) -> dict | list:
    """Tallies as rows of figures, with an example where something was lost: a tenth of the size."""
    if "worst" in kinds:
        flat = {**kinds, **{f"worst_{key}": value for key, value in kinds["worst"].items()}}
        examples = {key: kinds[key][:LISTED_IN_DATA] for key in EXAMPLES if key in kinds}
        found = all(flat[key] == flat["poses"] for key in ("generating", "branch", "answered"))
        if found and not any(flat[key] for key in ("false", "doubtful", "lost_without_doubt")):
            return [flat[key] for key in NOTHING_LOST]
        return [*(flat[key] for key in FIGURES), *([examples] if examples else [])]
    if "both" in kinds:
        keep = set(EXAMPLES) if kinds["both"] == kinds["closed form"] else set()  # else the general solver had its turn
        kinds = {
            "closed form": {
                key: value for key, value in kinds["closed form"].items() if key in keep or key not in EXAMPLES
            },
            "general": {key: value for key, value in kinds["general"].items() if key not in EXAMPLES[:2]},
            **({} if keep else {"both": kinds["both"]}),
        }
    return {key: packed(value) if isinstance(value, dict) else value for key, value in kinds.items()}


def unpacked(kinds: dict | list) -> dict:
    """The tallies again."""
    if isinstance(kinds, dict):
        return {key: unpacked(value) if isinstance(value, (dict, list)) else value for key, value in kinds.items()}
    flat = dict(zip(FIGURES, kinds, strict=False))
    if len(kinds) == len(NOTHING_LOST):
        short = dict(zip(NOTHING_LOST, kinds, strict=True))
        flat = dict.fromkeys(("generating", "branch", "answered"), short["poses"])
        flat |= {"generating_regular": short["regular"], "false": 0, "doubtful": 0, "lost_without_doubt": 0, **short}
    worst = {key: flat.pop(f"worst_{key}") for key in ("position", "rotation")}
    return {**flat, "worst": worst, **(kinds[-1] if isinstance(kinds[-1], dict) else {})}


def save(rows: list[dict], options: argparse.Namespace) -> pathlib.Path:
    path = results.save(
        "recall",
        method=f"{options.poses_built_in:,} random poses of each built-in arm and {options.poses:,} of each other, "
        f"{options.structured:,} grid poses of each step, {max(options.structured // 8, 12):,} singular configurations of each "
        f"kind and edges of the workspace; general solver in its default mode",
        packages=public_arms.PACKAGES,
        figures=FIGURES,
        figures_where_all_was_found=NOTHING_LOST,
        arms=[{**row, "kinds": packed(row["kinds"])} for row in rows],
    )
    path.write_text(compact(path.read_text()))
    return path


def compact(text: str) -> str:
    """Indented JSON with what holds nothing but figures on one line, below the size that is allowed here."""
    leaf = r"(\[[^\[\]{}]*\]|\{[^\[\]{}]*\}|\[[^\[\]{}]*\{[^{}]*\}\s*\])"
    text = re.sub(leaf, lambda found: re.sub(r"\s*\n\s*", "", found[0]), text)
    text = re.sub(r"\{\s*((?:\"[^\"]*\": \[[^{}\n]*\],?\s*)+)\}", lambda found: re.sub(r"\n\s*", "", found[0]), text)
    return re.sub(r"\n {2,}", "\n  ", text)  # deep levels stand where the second does


if __name__ == "__main__":
    main()
