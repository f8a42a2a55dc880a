"""Write the comparison table of the README from the measurements in results/.

A row holds what was measured in one run; what is best in it, and what is within a tenth of that, is bold. `table.py` calls it.

    python benchmarks/comparison.py
"""

import re
from collections.abc import Iterable

import results
from markdown import Row, commits, in_place, table, time_text

README = results.HERE.parent / "README.md"
COLUMNS = ["pieper", "Pinocchio", "EAIK", "ssik", "Robotics Toolbox", "ikpy", "kinpy", "py-opw", "TRAC-IK", "ur-analytic-ik"]  # fmt: skip
QUESTIONS = ("single_call", "forward_kinematics", "every_solution", "numeric_ik", "features")
TIE = 1.1
SHOWN = (  # of features.py, in this order; the page of benchmarks has all
    "every solution, closed forms of 6 joints",
    "every solution, 6 joints without a closed form",
    "7 joints, many answers",
    "iteration to one answer",
    "xacro",
    "MuJoCo's MJCF",
    "dynamics",
    "derivatives of dynamics, floating bases",
    "collisions",
    "ways around obstacles, for arms",
    "contact physics, pick and place",
    "a camera: markers, hand-eye",
    "ROS 2 nodes",
    "mobile robots, filters, maps",
    "C++ headers",
    "writes source code for an arm",
    "a JAX backend",
)
Cells = dict[str, str]


def cells(values: dict[str, float], show: str, *, most: bool = False) -> Cells:
    """Text by column, the best in bold."""
    best = (max if most else min)(values.values())
    text = {name: time_text(value) if show == "time" else show.format(value) for name, value in values.items()}
    text = {name: part.replace(" ", "\u00a0") for name, part in text.items()}
    near = {name: value == best if most else value <= TIE * best for name, value in values.items()}
    return {name: f"**{text[name]}**" if near[name] else text[name] for name in values}


def named(rows: Iterable[dict], names: dict[str, str], key: str = "name") -> dict[str, dict]:
    """Rows by column, from what they are called in the results."""
    found = {row[key]: row for row in rows}
    return {column: found[name] for column, name in names.items()}


def calls(data: dict) -> list[tuple[str, Cells]]:
    """One call from Python, and a million configurations."""
    same = {"TRAC-IK": "TRAC-IK (KDL)", "Robotics Toolbox": "Robotics Toolbox", "ikpy": "ikpy"}
    forward = {"pieper": "pieper", "Pinocchio": "Pinocchio, to an array", "kinpy": "kinpy, to its Transform", **same}
    jacobian = {name: name for name in ("pieper", "Pinocchio", "Robotics Toolbox", "kinpy")}
    batch = {
        "pieper": "pieper, literal, new output",
        "Pinocchio": "Pinocchio, loop in Python",
        "Robotics Toolbox": "Robotics Toolbox ets.eval",
        "py-opw": "py-opw batch_forward (KR210)",
    }
    single = data["single_call"]
    asked = (
        ("forward kinematics, one call", single["forward_kinematics"]["rows"], forward),
        ("Jacobian, one call", single["jacobian"]["rows"], jacobian),
        ("forward kinematics, each of 1 000 000", data["forward_kinematics"]["rows"], batch),
    )
    return [
        (words, cells({name: row["nanoseconds"]["median"] for name, row in named(rows, names).items()}, "time"))
        for words, rows, names in asked
    ]


def solutions(data: dict) -> list[tuple[str, Cells]]:
    """Every solution of a pose."""
    parts = {name: part["rows"] for name, part in data["every_solution"]["parts"].items()}

    def of(part: str, arm: str, key: str, *, mine: str = "pieper", kind: str | None = None) -> dict[str, float]:
        row = next(row for row in parts[part] if row["arm"] == arm and row.get("kind") == kind)
        solvers = {"pieper" if name == mine else name: figures for name, figures in row["solvers"].items()}
        if mine != "pieper":
            solvers["pieper"] = row["solvers"][mine]
        return {name: 1e3 * f[key] for name, f in solvers.items() if name in COLUMNS and key in f}

    def values(arm: str) -> str:
        row = next(row for row in parts["redundant"] if row["arm"] == arm)
        return next(name for name in row["solvers"] if name.endswith("values"))  # the one by arm.ik

    def worst(kind: str, key: str) -> dict[str, float]:
        solvers = {name for row in parts["singular"] for name in row["solvers"] if name in COLUMNS}
        return {
            name: 100.0
            * min(row["solvers"][name][kind][key] for row in parts["singular"] if name in row["solvers"])
            for name in solvers
        }  # fmt: skip

    load = next(row for row in parts["load"] if row["arm"] == "kuka_kr210_robond")["milliseconds"]
    first = {name: 1e6 * figures.get("median", figures.get("once")) for name, figures in load.items()}
    turned = "within reach, but not so turned"
    return [
        ("every answer: UR5e", cells(of("closed", "ur5e", "median_us"), "time")),
        ("every answer: KR210", cells(of("closed", "kuka_kr210_robond", "median_us"), "time")),
        ("every answer: KR210, each of a batch", cells(of("closed", "kuka_kr210_robond", "batch_us"), "time")),
        ("every answer: JACO 2, no closed form", cells(of("general", "kinova/jaco2", "median_us"), "time")),
        *(
            (f"as many answers as ssik: {label}", cells(of("redundant", arm, key, mine=values(arm)), "time"))
            for label, arm, key in (
                ("Panda, 7 joints", "franka/panda", "median_us"),
                ("iiwa14, 7 joints, p99", "kuka/iiwa14", "p99_us"),
            )
        ),
        ("no answer: KR210", cells(of("unreachable", "kuka_kr210_robond", "median_us", kind=turned), "time")),
        ("URDF to first answer: KR210", cells(first, "time")),
        ("singular poses answered, worst of nine kinds", cells(worst("exact", "answered"), "{:.4g} %", most=True)),
        ("own branch found 1e-8 rad beside them, worst", cells(worst("beside", "recall"), "{:.4g} %", most=True)),
    ]


def iteration(data: dict) -> list[tuple[str, Cells]]:
    """One answer by iteration, on all arms."""
    names = {
        "pieper": "pieper",
        "Pinocchio": "Pinocchio, a loop in Python",
        "Robotics Toolbox": "Robotics Toolbox ik_LM, tol 1e-20",
        "TRAC-IK": "TRAC-IK, eps 1e-10, 5 ms",
    }
    rows = data["numeric_ik"]["rows"]
    own = {column: [row for row in rows if row["solver"] == name] for column, name in names.items()}
    found = {column: 100.0 * min(row["success"]["1e-09"] for row in each) for column, each in own.items()}
    middle = {column: 1e3 * sorted(row["median_us"] for row in each)[len(each) // 2] for column, each in own.items()}
    arms = len(own["pieper"])
    return [
        (f"iteration: found to 1e-9, worst of {arms} arms", cells(found, "{:.4g} %", most=True)),
        ("iteration: time, arm in the middle", cells(middle, "time")),
    ]


def has(data: dict) -> list[Row]:
    """What each has, and how many robots it brings along."""
    by = {row["feature"]: row["by"] for row in data["features"]["rows"]}
    rows = [
        [
            words,
            "yes" if "pieper" in by[words] else "**no**",
            ", ".join(name for name in COLUMNS[1:] if name in by[words]),
        ]
        for words in SHOWN
    ]
    robots = data["features"]["robots"]
    others = sorted((name for name in robots if name != "pieper"), key=lambda name: -robots[name])
    return [*rows, ["robots that come along", str(robots["pieper"]), ", ".join(f"{n} {robots[n]}" for n in others)]]


def measured(rows: list[tuple[str, Cells]]) -> list[str]:
    """A table with a column for each solver that has a cell."""
    columns = [column for column in COLUMNS if any(column in by for _, by in rows)]
    heads = ["Pieper" if column == "pieper" else column for column in columns]
    return table(["", *heads], [[words, *(by.get(column, "") for column in columns)] for words, by in rows])


def lines(data: dict) -> list[str]:
    """The part of the README."""
    machine = data["single_call"]["machine"]
    versions = {}
    for question in QUESTIONS:
        versions |= data[question]["versions"]
    dates = sorted({data[question]["date"] for question in QUESTIONS})
    where = "; ".join(
        f"{question.replace('_', ' ').replace(' ik', ' IK')} {', '.join(f'`{commit}`' for commit in commits(data[question]))}"
        for question in QUESTIONS
    )
    return [
        (
            "Each row was measured in one run, on one thread; bold is the best and what is within a tenth of it. A gap: it does not do that, or was "
            "not measured there. Calls and batches are of a UR5e; py-opw cannot describe one and gets a KR210. [The page of benchmarks](docs/benchmarks.md) has the rules, the robots and all the rest."
        ),
        "",
        *measured([*calls(data), *iteration(data)]),
        "",
        "Every joint vector that reaches a pose:",
        "",
        *measured(solutions(data)),
        "",
        (
            "What each has, by the names in the installed packages (`benchmarks/features.py`). The Robotics Toolbox's solver of every solution was not timed here; "
            "it also fetches the robots of robot_descriptions."
        ),
        "",
        *table(["", "Pieper", "others that have it"], has(data), left=3),
        "",
        (
            "Take a peer where it is the better tool: Pinocchio for dynamics, its derivatives and floating bases; the Robotics Toolbox for teaching and "
            "mobile robots; EAIK, py-opw or ur-analytic-ik for a small dependency that solves one kind of arm; ssik for many ready-made arms and C++ code; "
            "MoveIt for a whole ROS stack of planners; pyroki or pytorch-kinematics, which were not measured, for batches on a GPU. Pieper is young: version "
            f"{versions['pieper']}, not on PyPI yet, and few have used it. Where Pinocchio has no call for a row, a loop in Python stands around it."
        ),
        "",
        (
            f"*{' to '.join(dict.fromkeys((dates[0], dates[-1])))}, {machine['processor']}, Python {machine['python']}; commits: {where}; "
            + ", ".join(f"{name} {version}" for name, version in versions.items())
            + ". Written by `benchmarks/table.py` from `benchmarks/results/`.*"
        ),
    ]


def page(data: dict | None = None) -> str:
    """The README with the table as the data have it."""
    data = data or {question: results.load(question) for question in QUESTIONS}
    return in_place(README.read_text(encoding="utf-8"), "comparison", lines(data))


def main() -> None:
    text = page()
    README.write_text(text, encoding="utf-8")
    print(README, len(re.findall("^\\|", text, re.MULTILINE)), "rows")


if __name__ == "__main__":
    main()
