"""Write docs/recall.md from results/recall.json.

python benchmarks/recall_table.py
"""

from collections.abc import Iterable

import results
from markdown import Row, origin, table
from recall import unpacked

PAGE = results.HERE.parent / "docs" / "recall.md"
NEAR = 0.9e-8  # rad
COUNTED = ("poses", "regular", "generating", "generating_regular", "branch", "answered", "answers", "false", "doubtful")

HEAD = """# Recall

Which share of poses comes back with the joint values that made it, on every built-in arm with five or six joints and on those
of public packages? {method}. Of seven joints the last is held. Numbers of public arms are read where their
packages put them; the names are those of the packages. This page is written by `benchmarks/recall_table.py` from the data in
`benchmarks/results/recall.json`, which `benchmarks/recall.py` measures; counts that are *proved* rather than sampled are on
[another page](proof/oracle.md).

- **Generating joints**: within 1e-6 rad, or as near as rounding of the pose lets them be told. At singular and boundary poses
  within 1e-5 rad, or what changes the pose by less than 1e-10, but never more than 1e-2 rad.
- **Branch**: an answer is connected with the generating joints by ones that reach the pose to 1e-9; beside a stretched wrist those
  form a long curve, of which no point is better than another.
- **Answered**: some answer. **False**: an answer that misses the pose by more than 1e-9 m or rad, as judged by a forward
  kinematics that shares no code with the package. **Doubtful**: the solver says itself that answers may be missing.
- Grid poses have joints at random multiples of the step; most are singular. Only at *regular* ones, where the least singular value
  of the Jacobian (m and rad mixed) is above 1e-4, are the generating joints asked for.
- Near-singular poses are that far (1e-2 to 1e-12 rad) from where the least singular value is zero, in the direction of the joint
  that leads away fastest. If joint 5 alone leads away it is the wrist of common arms, joint 3 alone the elbow, several joints
  together the shoulder; in arms of other structure the same words stand for what is similar.
- The edge is the farthest point in a random direction; a fold is a place where two answers meet.

*Method* is what an arm is solved by: its closed form, and the general solver where that is doubtful; or the general solver alone. The general
solver is measured on the others too, as a cross-check.
"""


def chosen(by_solver: dict) -> dict:
    """What the arm is solved by."""
    return by_solver.get("both") or by_solver.get("closed form") or by_solver["general"]


def total(tallies: Iterable[dict]) -> dict:
    tallies = list(tallies)
    return {key: sum(tally[key] for tally in tallies) for key in COUNTED} | {
        "position": max((tally["worst"]["position"] for tally in tallies), default=0.0),
        "rotation": max((tally["worst"]["rotation"] for tally in tallies), default=0.0),
    }


def parts(kinds: dict) -> dict[str, list[dict]]:
    """The tallies of an arm by kind of pose, each a dictionary by solver."""
    near = [
        (float(distance.split()[0]), tally)
        for each in kinds["near-singular"].values()
        for distance, tally in each.items()
    ]
    return {
        "random": [kinds["random"]],
        **{f"grid, {step}": [tally] for step, tally in kinds["grid"].items()},
        "near-singular, 1e-2 to 1e-8": [tally for distance, tally in near if distance > NEAR],
        "near-singular, below 1e-8 and exactly": [tally for distance, tally in near if distance < NEAR],
        **{f"boundary, {words}": [tally] for words, tally in kinds["boundary"].items()},
    }


def shares(kind: str, figures: dict) -> Row:
    """Generating joints, branch, answered."""
    if kind.startswith("grid"):
        return [
            share(figures["generating_regular"], figures["regular"]),
            "",
            share(figures["answered"], figures["poses"]),
        ]
    generating, branch = share(figures["generating"], figures["poses"]), share(figures["branch"], figures["poses"])
    if "below" in kind:
        generating = branch = ""
    return [generating, branch, share(figures["answered"], figures["poses"])]


def share(part: int, whole: int) -> str:
    """A percentage that is 100 only where nothing is missing, and how many are."""
    if not whole:
        return ""
    if part == whole:
        return "100 %"
    digits = 1
    while f"{100 * part / whole:.{digits}f}" == f"{100:.{digits}f}":
        digits += 1
    return f"{100 * part / whole:.{digits}f} % ({whole - part} missing)"


def by_kind(arms: list[dict], solver: str) -> dict[str, dict]:
    """The figures of all arms together, by kind of pose."""
    found = {}
    for kind in dict.fromkeys(kind for arm in arms for kind in parts(arm["kinds"])):
        tallies = []
        for arm in arms:
            for by_solver in parts(arm["kinds"]).get(kind, ()):
                tally = chosen(by_solver) if solver == "method" else by_solver.get(solver)
                if tally:
                    tallies.append(tally)
        if tallies:
            found[kind] = total(tallies)
    return found


def summary(arms: list[dict], solver: str) -> list[str]:
    """All arms together, by kind of pose."""
    rows = [
        [
            kind,
            f"{figures['poses']:,}",
            *shares(kind, figures),
            f"{figures['false']} of {figures['answers']:,}",
            f"{figures['position']:.0e} m, {figures['rotation']:.0e} rad",
            f"{100 * figures['doubtful'] / figures['poses']:.2g} %",
        ]
        for kind, figures in by_kind(arms, solver).items()
    ]
    head = ["poses", "number", "generating joints", "branch", "answered", "false", "worst errors", "doubtful"]
    return table(head, rows)


def missing(kind: str, figures: dict) -> tuple[int, int]:
    """How many poses lost their branch, and of how many; of those nearest to a singularity how many have no answer."""
    if kind.startswith("grid"):
        return figures["regular"] - figures["generating_regular"], figures["regular"]
    return figures["poses"] - figures["answered" if "below" in kind else "branch"], figures["poses"]


def groups(data: dict) -> dict[str, dict[str, dict]]:
    """The figures by kind of pose: of the built-in arms, of the public ones, and of the general solver where there is a closed form."""
    arms = [arm | {"kinds": unpacked(arm["kinds"])} for arm in data["arms"]]
    built_in = [arm for arm in arms if arm["source"] == "built in"]
    public = [arm for arm in arms if arm["source"] != "built in"]
    with_form = [arm for arm in arms if "closed form" in arm["kinds"]["random"]]
    return {
        f"{len(built_in)} built-in arms": by_kind(built_in, "method"),
        f"{len(public)} public arms": by_kind(public, "method"),
        f"the general solver alone, {len(with_form)} arms": by_kind(with_form, "general"),
    }


def each(arms: list[dict]) -> list[str]:
    """Arm by arm."""
    rows = []
    for arm in arms:
        of = {kind: total(chosen(by_solver) for by_solver in found) for kind, found in parts(arm["kinds"]).items()}
        grid = total(chosen(tally) for tally in arm["kinds"]["grid"].values())
        near, nearest = of["near-singular, 1e-2 to 1e-8"], of["near-singular, below 1e-8 and exactly"]
        edge = total(chosen(tally) for tally in arm["kinds"]["boundary"].values())
        everything = total([chosen(t) for found in parts(arm["kinds"]).values() for t in found])
        random = arm["kinds"]["random"]
        general = random.get("general")
        beyond = arm["kinds"]["beyond"]
        rows.append(
            [
                arm["arm"] + (f" ({arm['note']})" if arm["note"] else ""),
                "closed form" if "closed form" in random else "general",
                f"{of['random']['poses']:,}",
                share(of["random"]["generating"], of["random"]["poses"]),
                "" if general is None else share(general["generating"], general["poses"]),
                share(grid["generating_regular"], grid["regular"]),
                share(near["branch"], near["poses"]),
                share(edge["branch"], edge["poses"]),
                share(
                    grid["answered"] + near["answered"] + nearest["answered"] + edge["answered"],
                    grid["poses"] + near["poses"] + nearest["poses"] + edge["poses"],
                ),
                str(sum(item["answered"] for item in beyond.values())),
                str(everything["false"]),
                f"{max(everything['position'], everything['rotation']):.0e}",
                f"{100 * of['random']['doubtful'] / of['random']['poses']:.2g} %",
            ]
        )
    head = ["arm", "method", "random", "of them found", "by the general solver", "regular grid", "branch near-singular"]
    head += [
        "branch at boundary",
        "structured poses answered",
        "answers beyond the edge",
        "false",
        "worst error",
        "doubtful",
    ]
    return table(head, rows, left=2)


def losses(arms: list[dict]) -> list[str]:
    """Where the method of an arm lost something, worst first; the first joints of each."""
    rows = []
    for arm in arms:
        for kind, found in named(arm["kinds"]):
            figures = chosen(found)
            branch = figures["poses"] - figures["branch"]
            regular = figures["regular"] - figures["generating_regular"] if "grid" in kind else 0
            unanswered = figures["poses"] - figures["answered"]
            if branch or regular or unanswered:
                first = (figures.get("unanswered_at") or figures.get("off_branch") or figures.get("lost") or [None])[0]
                text = "" if first is None else "`" + ", ".join(f"{x:.17g}" for x in first) + "`"
                again = figures.get("answers_of_solve", [])
                solved = "" if not again else "yes" if again[0] else "no"
                lost = [str(figures["poses"]), str(branch + regular), str(unanswered), solved]
                rows.append([arm["arm"], kind, *lost, str(figures["lost_without_doubt"]), text])
    rows.sort(key=lambda row: -int(row[4]) / int(row[2]))
    head = [
        "arm",
        "poses",
        "number",
        "lost",
        "unanswered",
        "answered by `solve`",
        "regular ones lost without a doubt",
        "joints of one [rad]",
    ]
    return table(head, rows, left=2)


def named(kinds: dict) -> Iterable[tuple[str, dict]]:
    yield "random", kinds["random"]
    for step, tally in kinds["grid"].items():
        yield f"grid, {step}", tally
    for words, distances in kinds["near-singular"].items():
        for distance, tally in distances.items():
            yield f"near-singular, {words}, {distance}", tally
    for words, tally in kinds["boundary"].items():
        yield f"boundary, {words}", tally


def page() -> str:
    """The page as the data have it."""
    data = results.load("recall")
    for arm in data["arms"]:
        arm["kinds"] = unpacked(arm["kinds"])
    built_in = [arm for arm in data["arms"] if arm["source"] == "built in"]
    public = [arm for arm in data["arms"] if arm["source"] != "built in"]
    with_form = [arm for arm in data["arms"] if "closed form" in arm["kinds"]["random"]]
    sources = dict.fromkeys(arm["source"] for arm in public)
    lines = [HEAD.format(method=data["method"]).rstrip(), ""]
    lines += ["![Share of poses that lose their branch, by kind of pose](images/benchmark_recall.svg)", ""]
    lines += [f"## The {len(built_in)} built-in arms", "", *summary(built_in, "method"), ""]
    lines += [f"## {len(public)} arms of public packages", "", f"From {', '.join(sources)}.", ""]
    lines += [*summary(public, "method"), ""]
    lines += [f"## The general solver on the {len(with_form)} arms that have a closed form", ""]
    lines += [*summary(with_form, "general"), "", "## Arm by arm", ""]
    lines += [
        "*Regular grid* to *branch at boundary* are shares as above, with the method of the arm; *structured* are all but random poses.",
        "",
        *each(data["arms"]),
        "",
        "## What was lost",
        "",
        (
            "Every kind of pose of every arm on which its method lost a branch (regular grid poses: the generating joints), or gave "
            "no answer. `solve`, the one call for every arm, goes on with iteration where a solver has no answer but doubts; it was asked at one of them."
        ),
        "",
        *losses(data["arms"]),
        "",
        origin(data),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
