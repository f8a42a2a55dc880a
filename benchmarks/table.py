"""Write docs/benchmarks.md from the measurements in results/.

python benchmarks/table.py
"""

import statistics

import results
from forward_kinematics import CAREFUL, KEPT
from plots import SOLVERS, time_text

PAGE = results.HERE.parent / "docs" / "benchmarks.md"
Row = list[str]


def table(head: Row, rows: list[Row], *, left: int = 1) -> list[str]:
    """Lines of a Markdown table; all columns but the first few are right-aligned."""
    rule = ["---" if i < left else "---:" for i in range(len(head))]
    return ["| " + " | ".join(line) + " |" for line in (head, rule, *rows)]


def nanoseconds(row: dict) -> str:
    return time_text(row["nanoseconds"]["median"])


def times(ratio: dict) -> str:
    """A ratio with its quartiles."""
    digits = 2 if ratio["median"] < 10 else 1 if ratio["median"] < 100 else 0
    return " ".join(
        f"{text}{ratio[key]:.{digits}f}{end}"
        for text, key, end in (("", "median", ""), ("(", "lower_quartile", " to"), ("", "upper_quartile", ")"))
    )


def origin(data: dict) -> str:
    """One line: when, on what, with what."""
    versions = ", ".join(f"{name} {version}" for name, version in data["versions"].items())
    machine = data["machine"]
    return (
        f"*{data['date']}, commit `{data['commit']}`, {machine['processor']}, "
        f"Python {machine['python']}; {versions}. {sentence(data['method'])}*"
    )


def sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "."


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


SECTIONS = (forward_kinematics, single_call, numeric_ik, report_loop, import_and_size, public_urdfs)
HEAD = """# Benchmarks

One thread everywhere. Candidates take turns and a ratio is taken within the round, because the speed of a machine drifts
from minute to minute. Times are processor times. How to repeat them is told in `benchmarks/README.md`; the
figures behind this page lie as data in `benchmarks/results/`. This page is written by `benchmarks/table.py`.
"""


def main() -> None:
    data = {section.__name__: results.load(section.__name__) for section in SECTIONS}
    lines = [HEAD.rstrip(), "", *summary(data)]
    for section in SECTIONS:
        lines += ["", *section(data[section.__name__])]
    PAGE.write_text("\n".join(lines) + "\n")
    print(PAGE)


if __name__ == "__main__":
    main()
