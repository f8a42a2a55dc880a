"""Write docs/benchmarks.md and the comparison of the README from the measurements in results/.

python benchmarks/table.py
"""

import statistics

import comparison
import results
from forward_kinematics import CAREFUL, KEPT
from markdown import Row, origin, table, time_text, times
from plots import ARMS, SOLVERS
from task_sections import TASK_SECTIONS

PAGE = results.HERE.parent / "docs" / "benchmarks.md"


def nanoseconds(row: dict) -> str:
    return time_text(row["nanoseconds"]["median"])


def forward_kinematics(data: dict) -> list[str]:
    rows = [[row["name"], nanoseconds(row)] for row in data["rows"] if "beside the peers" not in row["name"]]
    return [
        "## Forward kinematics of a batch",
        "",
        (
            "![Time per configuration for pieper, the hand-written kernel and the peers]"
            "(images/benchmark_forward_kinematics.svg)"
        ),
        "",
        (
            "The arm is a UR5e. The yardstick is `benchmarks/straight_line/ur5e.cpp`, C++ written by hand for this one arm, in "
            "two versions: *nominal* with exact quarter turns, *literal* with the angles its description prints. Its sine is cut to "
            "what this arm needs; *with our sine* it takes the one of the package, accurate for every angle, and what is left of "
            "the ratio is the price of working for any arm. py-opw cannot "
            "describe a UR5e and gets a KUKA KR210."
        ),
        "",
        *table(["", "time per configuration"], rows),
        "",
        *table(
            ["ratio, taken round by round", "median (quartiles)"], [[k, times(v)] for k, v in data["ratios"].items()]
        ),
        "",
        origin(data) + f" *{data['compiler']}.*",
    ]


def single_call(data: dict) -> list[str]:
    lines = [
        "## One call from Python",
        "",
        "![Time of one call](images/benchmark_single_call.svg)",
        "",
        "*Output reused* hands the array for the answer over, as in `arm.fk(q, out=T)`; Pinocchio always reuses its own.",
    ]
    titles = {"forward_kinematics": "forward kinematics", "jacobian": "Jacobian"}
    for key, title in titles.items():
        rows = [[row["name"], f"`{row['statement']}`", nanoseconds(row)] for row in data[key]["rows"]]
        lines += ["", *table([title, "statement", "time"], rows, left=2)]
    ratios = [
        [titles[key], name, times(value)]
        for key in titles
        for name, value in data[key]["ratios"].items()
        if name.startswith("Pinocchio")
    ]
    return [*lines, "", *table(["", "ratio", "median (quartiles)"], ratios, left=2), "", origin(data)]


def every_solution(data: dict) -> list[str]:
    parts = {name: part["rows"] for name, part in data["parts"].items()}
    lines = [
        "## Every inverse solution",
        "",
        "![Time of one call for every solution of a pose, arm by arm](images/benchmark_every_solution.svg)",
        "",
        (
            "Every solver gets poses of the same joint values, drawn from a whole turn, and lists all answers, within joint limits or "
            "not; a call ends when they can be read as numbers. An answer holds when a forward kinematics that shares no code with "
            "any solver finds it within 1e-6 (m and rad); a false one does not, though its solver calls it a solution. *Found* is the "
            "share of poses whose own joint values are among the answers. pieper is called as `arm.ik(T)`, with a batch of poses as "
            "`T` in the column for batches; ssik and ur-analytic-ik take none. Numbers in brackets: the time of the best peer over this "
            "one. *avx2*, *baseline*: narrower instruction sets, forced."
        ),
        "",
        *table(["work", "asked for", "measured", "", "aimed at", "measured", ""], asked_of_solutions(parts), left=7),
    ]
    titles = {
        "closed": "### Closed forms",
        "general": "### Six joints without a closed form",
        "redundant": "### Seven joints, 16 values of the redundancy",
        "unreachable": "### Poses that have no answer",
    }
    remarks = {
        "general": (
            "The numbers of the arms are those that ssik ships, read when the benchmark runs. *fast*, *complete*: other modes than the "
            "default. *solve_general_6r* is the function below `arm.ik`. The Puma 560 has a closed form; here it is solved "
            "without it, ssik solves it with."
        ),
        "redundant": (
            "pieper holds an end joint at 16 values evenly spread over a turn; ssik samples as it chooses, 16 values too. A last row "
            "takes as many values as it needs to list at least as many answers as ssik. *solve_redundant* is the function below `arm.ik`."
        ),
        "unreachable": "A pose half as far again as the arm can reach, and poses within its reach, but turned so that none answers.",
    }
    for part in (part for part in titles if parts.get(part)):
        lines += ["", titles[part], ""] + ([remarks[part], ""] if part in remarks else [])
        if part == "unreachable":
            lines += no_answer(parts[part])
            continue
        head = ["arm", "solver", "median", "p99", "a pose of a batch", "answers per pose", "false", "found"]
        lines += table(head, [cells for row in parts[part] for cells in solution_rows(row)], left=2)
    if parts.get("singular"):
        lines += ["", "### Singular poses", "", *singular(parts["singular"])]
    if parts.get("load"):
        lines += ["", "### From the text of a URDF to the first complete answer", "", *loading(parts["load"])]
    if parts.get("numeric"):
        lines += ["", "### One answer within limits by iteration, to 1e-9", ""]
        head = ["arm", "solver", "found", "median", "mean", "p99"]
        rows = [
            [ARMS[row["arm"]], name, f"{100 * f['success']:.3f} %"]
            + [time_text(1e3 * f[key]) for key in ("median_us", "mean_us", "p99_us")]
            for row in parts["numeric"]
            for name, f in row["solvers"].items()
        ]
        lines += table(head, rows, left=2)
    return [*lines, "", origin(data)]


def solution_rows(row: dict) -> list[Row]:
    rows = []
    for name, figures in sorted(row["solvers"].items(), key=lambda item: not item[0].startswith("pieper")):
        quality, gain = figures["quality"], figures["best peer / this"]
        gain = {"median": gain["median"]["median"], "p99": gain["p99"], "batch": gain.get("batch")}
        cells = [ARMS[row["arm"]], f"**{name}**" if name == "pieper" else name]
        for key in ("median", "p99", "batch"):
            cells.append(f"{time_text(1e3 * figures[f'{key}_us'])} ({gain[key]:.3g})" if f"{key}_us" in figures else "")
        cells += [f"{quality['answers_per_pose']:.2f}", str(quality["false_answers"])]
        cells.append("" if quality["recall"] is None else f"{100 * quality['recall']:.4g} %")
        rows.append(cells)
    return rows


def no_answer(rows: list[dict]) -> list[str]:
    names = list(dict.fromkeys(name for row in rows for name in row["solvers"]))
    cells = [
        [ARMS[row["arm"]], row["kind"]]
        + [time_text(1e3 * row["solvers"][name]["median_us"]) if name in row["solvers"] else "" for name in names]
        for row in rows
    ]
    return table(["arm", "pose", *names], cells, left=2)


def singular(rows: list[dict]) -> list[str]:
    names = list(dict.fromkeys(name for row in rows for name in row["solvers"]))
    cells = []
    for row in rows:
        cells.append([ARMS[row["arm"]], row["kind"]])
        for name in names:
            figures = row["solvers"].get(name)
            if figures is None:
                cells[-1].append("")
                continue
            answered, sure = (100 * figures["exact"][key] for key in ("answered", "answered_unflagged"))
            flagged = f" ({sure:.4g} unflagged)" if sure < answered else ""
            cells[-1].append(f"{answered:.4g}{flagged} / {100 * figures['beside']['recall']:.4g}")
    return [
        (
            f"{rows[0]['poses']} poses each, at joint values that make the Jacobian singular to the last digit. In per cent: poses with an "
            "answer that holds / poses 1e-8 rad beside the singularity whose own joint values are among the answers, to 0.01 rad. EAIK flags "
            "answers that it calls only near; those of them that hold count."
        ),
        "",
        *table(["arm", "singularity", *names], cells, left=2),
    ]


def loading(rows: list[dict]) -> list[str]:
    def cell(figures: dict) -> str:
        if "once" in figures:
            return time_text(1e6 * figures["once"])
        return f"{time_text(1e6 * figures['median'])} (at most {time_text(1e6 * figures['most'])})"

    return [
        (
            f"Processor time of {rows[0]['runs']} runs, each with other lengths, in a process that has run before: `pieper.load(text)`, then "
            "every answer of a pose. EAIK reads a file and takes no tool; ssik is measured once, without what it keeps on "
            "disk from earlier runs. Arms of seven joints: 16 values of the redundancy."
        ),
        "",
        *table(
            ["arm", "solved by", "pieper", "EAIK", "ssik"],
            [
                [ARMS[row["arm"]], row["method"]]
                + [cell(row["milliseconds"][k]) if k in row["milliseconds"] else "" for k in ("pieper", "EAIK", "ssik")]
                for row in rows
            ],
            left=2,
        ),
    ]


def asked_of_solutions(parts: dict[str, list[dict]]) -> list[Row]:
    """What was asked for and aimed at, beside what was measured."""

    def of(part: str, arm: str, solver: str, key: str) -> float:
        return next(row for row in parts[part] if row["arm"] == arm)["solvers"][solver][key]

    def gained(part: str, arm: str, peer: str, *, batch: bool = False) -> float:
        """How many times as long the peer takes; where it takes no batch, its single call against ours in one."""
        if batch:
            figures = next(row for row in parts[part] if row["arm"] == arm)["solvers"][peer]
            return figures.get("batch_us", figures["median_us"]) / of(part, arm, "pieper", "batch_us")
        ours, theirs = (of(part, arm, name, "best peer / this")["median"]["median"] for name in ("pieper", peer))
        return ours / theirs

    def every(numbers: list[float], form: str) -> str:
        return ", ".join(form.format(number) for number in numbers)

    def line(
        work: str, asked: str, found: str, met: bool, aim: str = "", reached: str = "", hit: bool | None = None
    ) -> Row:
        return [
            work,
            asked,
            found,
            "yes" if met else "**no**",
            aim,
            reached,
            "" if hit is None else "yes" if hit else "no",
        ]

    rows: list[Row] = []
    us, ratio = "{:.3g} µs", "{:.3g}"
    if parts.get("closed"):
        names = [row["arm"] for row in parts["closed"] if row["arm"] != "kuka_youbot"]
        for label, arms in ((", ".join(ARMS[name] for name in names), names), ("youBot, five joints", ["kuka_youbot"])):
            mine = [of("closed", arm, "pieper", "median_us") for arm in arms]
            gain = [gained("closed", arm, "EAIK") for arm in arms]
            text = every(gain, ratio) + " times as quick as EAIK"
            rows.append(
                line(
                    f"{label}: one call",
                    "quicker than EAIK",
                    text,
                    min(gain) > 1,
                    "3 µs",
                    every(mine, us),
                    max(mine) <= 3,
                )
            )
        mine = [of("closed", arm, "pieper", "batch_us") for arm in names]
        gain = [gained("closed", arm, "EAIK", batch=True) for arm in names]
        text = every(gain, ratio) + " times as quick"
        rows.append(
            line(
                "the first three: batch",
                "5 times EAIK",
                text,
                min(gain) >= 5,
                "0.6 µs",
                every(mine, us),
                max(mine) <= 0.6,
            )
        )
    if parts.get("singular"):
        shares = [
            f["exact"]["answered"]
            for row in parts["singular"]
            for name, f in row["solvers"].items()
            if name == "pieper"
        ]
        near = [
            f["beside"]["recall"] for row in parts["singular"] for name, f in row["solvers"].items() if name == "pieper"
        ]
        text, beside = f"{100 * min(shares):.4g} % answered", f"{100 * min(near):.4g} %"
        aim = "its own branch 1e-8 rad beside"
        rows.append(
            line("the first three: singular poses", "an answer", text, min(shares) == 1, aim, beside, min(near) == 1)
        )
    if parts.get("general"):
        names = [row["arm"] for row in parts["general"] if "pieper" in row["solvers"]]
        label = ", ".join(ARMS[name] for name in names)
        gain = [gained("general", arm, "ssik") for arm in names]
        batch = [gained("general", arm, "ssik", batch=True) for arm in names]
        text = f"{every(gain, ratio)} times; in a batch {every(batch, ratio)}"
        rows.append(line(f"{label}: one call", "80 times ssik", text, min(gain) >= 80))
        for solver, most, goal in (("pieper", 10, 4), ("pieper, avx2", 15, 8)):
            mine = [of("general", arm, solver, "median_us") for arm in names]
            many = [of("general", arm, solver, "batch_us") for arm in names]
            words = "AVX2" if "avx2" in solver else "the widest instruction set"
            aim = f"batch {goal} µs"
            rows.append(
                line(
                    f"the same, {words}",
                    f"{most} µs",
                    every(mine, us),
                    max(mine) <= most,
                    aim,
                    every(many, us),
                    max(many) <= goal,
                )
            )
        tail = [of("general", arm, "pieper", "p99_us") for arm in names]
        puma = next(row for row in parts["general"] if row["arm"] not in names)["arm"]
        mine = [
            of("general", puma, "pieper, general", "median_us"),
            of("general", puma, "pieper, solve_general_6r", "median_us"),
        ]
        text = f"{mine[0]:.3g} µs; {mine[1]:.3g} µs by solve_general_6r"
        tail.append(of("general", puma, "pieper, general", "p99_us"))
        rows.append(
            line(
                "Puma 560 without its closed form",
                "20 µs",
                text,
                mine[0] <= 20,
                "p99 of all 60 µs",
                every(tail, us),
                max(tail) <= 60,
            )
        )
    for row in parts.get("redundant", []):
        gain = {name: f["best peer / this"]["median"]["median"] for name, f in row["solvers"].items()}
        if row["arm"] == "kassow/kr810":
            mine = row["solvers"]["pieper"]["median_us"]
            text, met = f"{gain['pieper']:.3g} times", gain["pieper"] >= 500
            rows.append(line("KR810, 16 values", "500 times ssik", text, met, "100 µs", us.format(mine), mine <= 100))
        else:
            name = next(name for name in row["solvers"] if name.endswith("values"))  # the one by arm.ik
            mine = row["solvers"][name]["median_us"]
            label = f"{ARMS[row['arm']]}, as many answers as ssik"
            text, met = f"{gain[name]:.3g} times", gain[name] >= 3
            rows.append(line(label, "3 times ssik", text, met, "60 µs", us.format(mine), mine <= 60))
    if parts.get("unreachable"):
        mine = [row["solvers"]["pieper"]["median_us"] for row in parts["unreachable"]]
        text = f"{min(mine):.3g} to {max(mine):.3g} µs"
        rows.append(line("no answer", "5 µs", text, max(mine) <= 5))
    if parts.get("load"):
        mine = [row["milliseconds"]["pieper"]["median"] for row in parts["load"]]
        text = f"{min(mine):.3g} to {max(mine):.3g} ms"
        rows.append(
            line("URDF to first complete answer", "150 ms", text, max(mine) <= 150, "20 ms", text, max(mine) <= 20)
        )
    if parts.get("numeric"):
        own = [row["solvers"]["pieper, numeric"] for row in parts["numeric"]]
        gain = [row["times as long"]["median"] for row in parts["numeric"]]
        least = min(figures["success"] for figures in own)
        text = f"{100 * least:.3f} %; {every(gain, ratio)} times as quick"
        median, tail = max(f["median_us"] for f in own), max(f["p99_us"] for f in own)
        found = f"{median:.3g} µs, p99 {tail:.3g} µs"
        met, hit = least >= 0.9999 and min(gain) > 1, median <= 30 and tail <= 300
        rows.append(
            line("iteration", "99.99 %, quicker than Robotics Toolbox", text, met, "30 µs, p99 300 µs", found, hit)
        )
    return rows


def numeric_ik(data: dict) -> list[str]:
    lines = [
        "## Numeric inverse kinematics",
        "",
        "![Share of poses missed and time of a solve, arm by arm](images/benchmark_numeric_ik.svg)",
        "",
        (
            "Found means: within the tolerance in position [m] *and* rotation [rad], and within the joint limits, as judged by a "
            "forward kinematics that shares no code with any solver. Every solver gets the same poses, some fewer of them. "
            "TRAC-IK decides by its own measure when it is done and stops before a nanometre; its default tolerance is 1e-5, so "
            "for the default the share at 2e-5 is the fair figure. Pinocchio has no such solver: its row is a damped least-squares loop in Python around it."
        ),
        "",
    ]
    rows = []
    for solver in dict.fromkeys(row["solver"] for row in data["rows"]):
        own = [row for row in data["rows"] if row["solver"] == solver]
        found = [[row["success"][tolerance] for row in own] for tolerance in ("1e-09", "1e-06", "2e-05")]
        rows.append(
            [
                solver,
                str(len(own)),
                f"{max(row['poses'] for row in own):,}",
                *(f"{100 * statistics.mean(share):.3f} % ({100 * min(share):.3f} %)" for share in found),
                time_text(1e3 * statistics.median(row["median_us"] for row in own)),
                time_text(1e3 * statistics.median(row["p99_us"] for row in own)),
            ]
        )
    head = ["all arms together", "arms", "poses each", "found to 1e-9, mean (worst arm)", "to 1e-6", "to 2e-5"]
    head += ["median", "p99"]
    lines += [*table(head, rows), "", "Median and p99 are those of the arm in the middle. Arm by arm:", ""]
    shown = {begin: label for begin, (label, _, _) in SOLVERS.items()}
    head = ["arm", "joints"] + [f"{label}: found to 1e-9, median, p99" for label in shown.values()]
    rows = []
    for arm, dof in dict.fromkeys((row["arm"], row["dof"]) for row in sorted(data["rows"], key=lambda r: r["dof"])):
        cells = [arm, str(dof)]
        for begin in shown:
            own = [row for row in data["rows"] if row["arm"] == arm and row["solver"].startswith(begin)]
            cells += [
                f"{100 * row['success']['1e-09']:.2f} %, {time_text(1e3 * row['median_us'])}, "
                f"{time_text(1e3 * row['p99_us'])}"
                for row in own[:1]
            ] or ["not measured"]
        rows.append(cells)
    return [*lines, *table(head, rows, left=1), "", origin(data)]


def report_loop(data: dict) -> list[str]:
    rows = [[row["name"], time_text(row["nanoseconds"]["median"]), row["remark"]] for row in data["rows"]]
    ratios = [[name, f"{value:,.0f}"] for name, value in data["ratios"].items()]
    return [
        "## The report's loop",
        "",
        (
            "Position of a Yaskawa MH12 from zero angles to (0.3, 0.3, 0.3) m: the loop of the source document, which puts numbers "
            "into SymPy expressions in each of its 255 steps, against the same rule and against the solver here."
        ),
        "",
        *table(["", "time", ""], rows),
        "",
        *table(["ratio", "times"], ratios),
        "",
        (
            f"The same rule gives the same angles: after {data['steps_compared']} steps they differ by at most "
            f"{data['largest_difference_rad']:.1e} rad."
        ),
        "",
        origin(data),
    ]


def ros_latency(data: dict) -> list[str]:
    states, target, poses = (list(data[key].values()) for key in ("joint_states", "target", "calculate_ik"))
    rows = [
        [
            f"joint states in, pose out; {states[1]['messages']:,} messages, {states[1]['lost']} lost",
            "added: median 0.3 ms, p99 1 ms; none lost",
            f"{states[0]['median_ms']:.2f}, {states[0]['p99_ms']:.2f} ms",
            f"{states[1]['median_ms']:.2f}, {states[1]['p99_ms']:.2f} ms",
            f"{states[1]['added_median_ms']:.2f} ms",
            f"{states[1]['ratio_to_echo']:.2f}",
        ],
        [
            "target in, first joint state out",
            "1 ms",
            f"{target[0]['median_ms']:.2f}, {target[0]['p99_ms']:.2f} ms",
            f"{target[1]['median_ms']:.2f}, {target[1]['p99_ms']:.2f} ms",
            f"{target[1]['added_median_ms']:.2f} ms",
            f"{target[1]['ratio_to_echo']:.2f}",
        ],
        [
            f"`calculate_ik` of {poses[1]['poses']} poses, one call",
            "30 ms",
            f"{poses[0]['median_ms']:.1f} ms",
            f"{poses[1]['median_ms']:.1f} ms",
            f"{poses[1]['added_median_ms']:.1f} ms",
            f"{poses[1]['ratio_to_echo']:.2f}",
        ],
    ]
    return [
        "## ROS nodes on bare DDS",
        "",
        "From before the question is built to after the answer is read, in another process: twice the way over DDS. The echo takes the same kind of message and",
        "answers at once with one of the same kind, so what it takes is the way, and the difference is the node's own work. Milliseconds: median, and 99th percentile.",
        "",
        *table(["question", "asked for", "echo", "node", "added, median", "ratio"], rows, left=2),
        "",
        origin(data),
    ]


def segmentation(data: dict) -> list[str]:
    sizes = data["sizes"]
    names = [row["name"] for row in next(iter(sizes.values()))["rows"]]
    figures = {size: {row["name"]: row for row in one["rows"]} for size, one in sizes.items()}

    def cell(size: str, name: str) -> str:
        row = figures[size][name]
        return f"{row['milliseconds']['median']:.2f} ms, {row['rms_px']:.3f} px"

    names.sort(key=lambda name: figures[list(sizes)[-1]][name]["milliseconds"]["median"])
    ratios = [name for name in next(iter(sizes.values())) if "/" in name]
    return [
        "## A frame to blobs",
        "",
        "Three colours, 10 robots with 5 markers each on a carpet with lines, a light gradient, clutter and noise. Every candidate finds the same 50 markers; beside",
        "the time stands how far from the truth, root mean square. OpenCV alone was tried in nine ways, and the ratio is to the best of them at that size.",
        f"Instruction set `{data['instruction_set']}`; the others are chosen by `PIEPER_INSTRUCTION_SET`.",
        "",
        *table(["", *sizes], [[name, *(cell(size, name) for size in sizes)] for name in names]),
        "",
        *table(
            ["ratio, taken round by round", *sizes],
            [[name, *(times(sizes[size][name]) for size in sizes)] for name in ratios],
        ),
        "",
        origin(data),
    ]


def import_and_size(data: dict) -> list[str]:
    rows = [
        [row["name"], f"{row['milliseconds']['median']:.0f} ms", ", ".join(row["imports"]) or "none"]
        for row in data["rows"]
    ]
    wheel = data["wheel"]
    return [
        "## Import and size",
        "",
        *table(["fresh process", "processor time", "heavy packages imported"], rows),
        "",
        *table(["ratio", "median (quartiles)"], [[k, times(v)] for k, v in data["ratios"].items()]),
        "",
        f"The wheel `{wheel['file']}` has {wheel['bytes'] / 1e6:.2f} MB, {wheel['installed_bytes'] / 1e6:.2f} MB installed.",
        "",
        origin(data),
    ]


def public_urdfs(data: dict) -> list[str]:
    rows = []
    for item in data["compared"]:
        name = item["path"].removeprefix("cmeel.prefix/share/").removeprefix("share/")
        rows.append(
            [f"{item['package']} {item['version']}", f"`{name}`", str(len(item["chains"])), f"{item['difference']:.1e}"]
        )
    refused = [
        [f"{item['package']}", f"`{item['path'].rpartition('/')[2]}`", cell(item["pieper"]), cell(item["pinocchio"])]
        for item in data["refused"]
    ]
    return [
        "## Public URDFs",
        "",
        (
            f"Forward kinematics of {data['files_equal']} of {data['files_compared']} URDF files from public packages "
            f"({data['chains_compared']} chains) equals Pinocchio's to {data['tolerance']:g}, and so does that of the "
            f"{len(data['built_in'])} built-in arms that have a joint table. The files are read where their "
            "packages put them; none is kept here."
        ),
        "",
        "<details><summary>The files</summary>",
        "",
        *table(["package", "file", "chains", "largest difference"], rows, left=2),
        "",
        "</details>",
        "",
        "<details><summary>Refused by pieper or by Pinocchio, and why</summary>",
        "",
        *table(["package", "file", "pieper", "Pinocchio"], refused, left=4),
        "",
        "</details>",
        "",
        origin(data),
    ]


def features(data: dict) -> list[str]:
    others = [name for name in comparison.COLUMNS if name != "pieper"]
    rows = [
        [
            row["feature"],
            f"`{row['by']['pieper']}`" if "pieper" in row["by"] else "**no**",
            ", ".join(f"{name} (`{row['by'][name]}`)" for name in others if name in row["by"]),
        ]
        for row in data["rows"]
    ]
    robots = data["robots"]
    count = ", ".join(f"{name} {robots[name]}" for name in others if name in robots)
    return [
        "## What each package has",
        "",
        (
            "In brackets the name that was imported as proof, or the file that was found; who is not listed defines no name like it. `features.py` prints names that "
            "hint at more than is credited, and says what they are instead."
        ),
        "",
        *table(["", "pieper", "others"], [*rows, ["robots that come along", str(robots["pieper"]), count]], left=3),
        "",
        origin(data),
    ]


def cell(text: str) -> str:
    """Text that fits a cell: what a parser says about a whole path is cut to its reason."""
    text = text.partition(": ")[2] or text
    return (
        ("not a valid URDF" if "does not contain a valid URDF" in text else text)
        .replace("|", "\\|")
        .replace("<", "&lt;")
    )


def summary(data: dict[str, dict]) -> list[str]:
    """What was asked for, and what was measured."""
    batch = {name: value["median"] for name, value in data["forward_kinematics"]["ratios"].items()}
    peer = min((name for name in batch if name.endswith("/ pieper")), key=lambda name: batch[name])
    calls = {
        key: {
            name: value["median"] for name, value in data["single_call"][key]["ratios"].items() if "Pinocchio" in name
        }
        for key in ("forward_kinematics", "jacobian")
    }
    loop = data["report_loop"]
    slowest = min(loop["ratios"].values())
    numeric = [row for row in data["numeric_ik"]["rows"] if row["solver"] == "pieper"]
    cost = data["import_and_size"]
    imports = {name: value["median"] for name, value in cost["ratios"].items()}
    loaded = max(value for name, value in imports.items() if "load" in name)
    shown = next(row["imports"] for row in cost["rows"] if row["name"] == "pieper --help")
    found = min(row["success"]["1e-09"] for row in numeric)
    frames = data["segmentation"]["sizes"]
    ours = [
        next(row["milliseconds"]["median"] for row in one["rows"] if row["name"] == "pieper") for one in frames.values()
    ]
    lines = f"straight line, {{}}, {KEPT}"
    return table(
        ["asked for", "measured"],
        [
            [
                "batch forward kinematics at least 10 times the quickest peer",
                f"{batch[peer]:.1f} times ({peer.split(' / ')[0]})",
            ],
            [
                "within 1.5 of C++ written for the one arm",
                (
                    f"{batch['pieper / ' + lines.format('nominal')]:.2f} nominal, "
                    f"{batch['pieper / ' + lines.format('literal')]:.2f} literal; with the same sine in both "
                    f"{batch['pieper / ' + lines.format('nominal, ' + CAREFUL)]:.2f} and "
                    f"{batch['pieper / ' + lines.format('literal, ' + CAREFUL)]:.2f}"
                ),
            ],
            *(
                [
                    f"one {title} from Python quicker than Pinocchio's",
                    ", ".join(
                        f"{value:.2f} times ({name.partition(',')[2].split(' / ')[0].strip() or 'to an array'})"
                        for name, value in calls[key].items()
                    ),
                ]
                for key, title in (("forward_kinematics", "forward kinematics"), ("jacobian", "Jacobian"))
            ),
            [
                "three colours to blobs on one core: at most 0.8 ms at 640x480, 5 ms at 1920x1080",
                " and ".join(f"{value:.2f} ms" for value in ours),
            ],
            *(
                [
                    f"that at least {least} times as quick as {words}",
                    " and ".join(f"{one[key]['median']:.3g} times" for one in frames.values()),
                ]
                for least, words, key in (
                    (100, "the report's pipeline", "report / pieper"),
                    (2, "the best of OpenCV alone", "best OpenCV / pieper"),
                )
            ),
            [
                "position of the MH12 to 1e-9 m at least 1000 times as quick as the report's loop",
                (
                    f"{min(v for n, v in loop['ratios'].items() if '1e-9' in n):,.0f} times; by the report's own rule "
                    f"{slowest:,.0f} times with the same angles to {loop['largest_difference_rad']:.0e} rad"
                ),
            ],
            [
                "numeric inverse kinematics finds 99.9 % of the poses to 1e-9 on every arm of 6 or 7 joints",
                f"{100 * found:.2f} % on the worst of {len(numeric)} arms, {min(row['poses'] for row in numeric):,} poses each",
            ],
            [
                "import below 3 times NumPy's",
                (
                    f"{imports['import pieper / import numpy, interpreter taken off']:.2f} times; {loaded:.2f} times with an arm "
                    "loaded and one forward kinematics"
                ),
            ],
            [
                "`pieper --help` imports nothing heavy",
                ", ".join(shown) or "nothing of NumPy, SciPy, SymPy, YAML or rich",
            ],
            ["wheel below 2 MB", f"{cost['wheel']['bytes'] / 1e6:.2f} MB"],
            [
                "forward kinematics equal to Pinocchio's to 1e-12 on 20 public URDFs",
                f"on all {data['public_urdfs']['files_equal']} of {data['public_urdfs']['files_compared']} that both read",
            ],
        ],
        left=2,
    )


SECTIONS = (
    forward_kinematics,
    single_call,
    every_solution,
    numeric_ik,
    *TASK_SECTIONS,
    report_loop,
    ros_latency,
    segmentation,
    features,
    import_and_size,
    public_urdfs,
)
HEAD = """# Benchmarks

One thread everywhere, but for maps and ROS nodes. Candidates take turns and a ratio is taken within the round, because the speed of a machine drifts
from minute to minute. Times are processor times, but for single calls that list every solution, servo cycles, maps and ROS nodes. How to repeat them is told in `benchmarks/README.md`; the
figures behind this page lie as data in `benchmarks/results/`. This page is written by `benchmarks/table.py`; each section names its date and commit.
Recall has [its own page](recall.md), perception [another](guides/perception_figures.md).
"""


def page() -> str:
    """The page as the data have it."""
    data = {section.__name__: results.load(section.__name__) for section in SECTIONS}
    lines = [HEAD.rstrip(), "", *summary(data)]
    for section in SECTIONS:
        lines += ["", *section(data[section.__name__])]
    return "\n".join(lines) + "\n"


def main() -> None:
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
    comparison.main()


if __name__ == "__main__":
    main()
