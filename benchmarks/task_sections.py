"""Sections of docs/benchmarks.md on motion, planning, picking, maps, the viewer and the general solver: what was asked for, and what was measured."""

from markdown import Row, origin, table, time_text

NAMES = {"ur5e": "UR5e", "kr210": "KR210", "panda": "Panda", "ur10e": "UR10e", "mh12": "MH12", "youbot": "youBot"}


def named(text: str) -> str:
    """The name of an arm as its maker writes it."""
    arm, comma, rest = text.partition(", ")
    return NAMES.get(arm, arm) + comma + rest


def met(reached: bool) -> str:
    return "yes" if reached else "**no**"


def motion(data: dict) -> list[str]:
    path, servo, limits = data["path_ik_ms_per_1000_poses"], data["servo_us"], data["limits"]
    rows = [
        [
            f"joint values along 1000 poses: {named(name)}",
            "10 ms",
            f"{row['median']:.2f} ms",
            met(row["median"] <= 10.0),
        ]
        for name, row in path.items()
    ]
    rows += [
        [
            f"a cycle of the servo: {named(name)}",
            "20 µs, p99 100 µs",
            f"{row['median']:.1f} µs, p99 {row['p99']:.1f} µs, at most {row['most']:.0f} µs",
            met(row["median"] <= 20.0 and row["p99"] <= 100.0),
        ]
        for name, row in servo.items()
    ]
    rows.append(
        [
            f"limits at each of {limits['samples']:,} samples of {limits['paths']} timed paths",
            "1e-6",
            f"{over:.0e} above" if (over := limits["most_over_a_limit"]) > 0.0 else "none above",
            met(limits["most_over_a_limit"] <= 1e-6),
        ]
    )
    share = ", ".join(f"{name} {100 * value:.0f} %" for name, value in limits["largest_share"].items())
    return [
        "## Paths, timing and a servo",
        "",
        "![Time of a pose of a path and of a cycle of the servo, arm by arm](images/benchmark_motion.svg)",
        "",
        *table(["work", "asked for", "measured", ""], rows, left=4),
        "",
        (
            f"The timed paths use at most this share of a limit: {share}. To time one takes {limits['planning_ms']['median']:.0f} ms (median) for "
            f"{limits['motion_s']['median']:.1f} s of motion."
        ),
        "",
        origin(data),
    ]


def planning(data: dict) -> list[str]:
    rows = [
        [
            words,
            f"{row['found']} of {row['with_a_path']}",
            f"{row['median_seconds']:.3f} s",
            f"{row['p99_seconds']:.2f} s",
            f"{row['worst_seconds']:.2f} s",
            f"{row['states_touching']} of {row['states_judged']:,}",
        ]
        for words, row in data["figures"].items()
    ]
    every = data["figures"]["together"]
    good = (
        every["found"] == every["with_a_path"]
        and every["median_seconds"] <= 0.15
        and every["p99_seconds"] <= 2.0
        and not every["states_touching"]
    )
    return [
        "## Ways around obstacles",
        "",
        "![Share of questions answered within a time](images/benchmark_planning.svg)",
        "",
        (
            "Asked for: every question that has a path, in 0.15 s (median) and 2 s (99th percentile), and no state that touches anything as MuJoCo judges it, "
            f"which shares no code with the planner's own check: {met(good)}."
        ),
        "",
        *table(["questions", "found", "median", "p99", "worst", "states that touch something"], rows),
        "",
        origin(data),
    ]


def planned_motion(data: dict) -> list[str]:
    rows = [
        [
            words,
            f"{row['corners_rounded']} of {row['corners']}",
            f"{100 * row['share_of_time']:.0f} %",
            f"{100 * row['median_share_of_time']:.0f} %",
            time_text(1e9 * row["median_timing_seconds"]),
            f"{row['states_touching']} of {row['states_judged']:,}",
        ]
        for words, row in data["figures"].items()
    ]
    head = ["paths", "corners rounded", "duration, of that with a rest at each point", "median path", "to time one"]
    return [
        "### Motions along them",
        "",
        *table([*head, "states that touch something"], rows),
        "",
        origin(data),
    ]


def pick(data: dict) -> list[str]:
    rows = []
    for arm, by_planner in data["arms"].items():
        for planner, row in by_planner.items():
            rows.append(
                [
                    named(arm),
                    planner,
                    ", ".join(f"{placed} of {row['cycles for each seed']}" for placed in row["placed for each seed"]),
                    str(row["cycles with a second grasp"]),
                    f"{row['mean cycle [s]']:.2f} s",
                    f"{row['processor time for a cycle [s]']:.2f} s",
                    f"{row['times real time']:.1f}",
                ]
            )
    head = [
        "arm",
        "planner",
        "placed, seed by seed",
        "grasped twice",
        "a cycle",
        "processor time for it",
        "times real time",
    ]
    return [
        "## Pick and place by contact physics",
        "",
        "Asked for: all of 200 with the KR210 at its nine slots, with three seeds. *direct* does without a search.",
        "",
        *table(head, rows, left=2),
        "",
        f"The drives follow within {data['tracking_error_rad']:.1e} rad.",
        "",
        origin(data),
    ]


def see_and_reach(data: dict) -> list[str]:
    def span(numbers: list[float]) -> str:
        return f"{min(numbers):.2g} to {max(numbers):.2g}"

    rows = [
        [
            named(arm),
            f"{row['placed']} of {row['cycles']} ({row['seeds']} seeds)",
            str(row["looks that saw nothing"]),
            f"{row['error of a place, mean [mm]']:.2f} mm",
            f"{row['error of a place, largest [mm]']:.2f} mm",
            f"{span(row['error of the camera [mm]'])} mm",
            f"{row['mean cycle [s]']:.2f} s",
        ]
        for arm, row in data["arms"].items()
    ]
    head = [
        "arm",
        "placed",
        "not seen",
        "error of a place, mean",
        "largest",
        "error of the calibrated camera",
        "a cycle",
    ]
    return ["### Picking what a camera sees", "", "Asked for: 100 of 100.", "", *table(head, rows), "", origin(data)]


def workspace(data: dict) -> list[str]:
    figures = data["figures"]
    best, large = figures["best"], figures["large"]
    rows: list[Row] = [
        [
            f"UR5e, voxels of 5 cm, 200 orientations: {figures['poses'] / 1e6:.1f} million poses, stored; two processes",
            "60 s",
            f"{best['2']['wall_s']:.1f} s",
            met(best["2"]["wall_s"] <= 60.0),
        ],
        ["one to two processes", "", f"{figures['scaling_wall']:.2f} times", ""],
        [
            f"the same with voxels of 3 cm, {figures['fine_poses'] / 1e6:.0f} million poses",
            "1.8 times",
            f"{figures['fine_scaling_wall']:.2f} times",
            met(figures["fine_scaling_wall"] >= 1.8),
        ],
        [
            f"more than the compiled solver alone, which takes {1e3 * figures['bare_us_per_pose']:.0f} ns a pose",
            "20 %",
            f"{100 * figures['overhead_counts_only']:.0f} % counting, {100 * figures['overhead_all_quantities']:.0f} % all quantities",
            met(figures["overhead_all_quantities"] <= 0.2),
        ],
        [
            f"memory at {large['voxels'] / 1e6:.0f} million voxels",
            "500 MB",
            f"{large['peak_MB']:.0f} MB",
            met(large["peak_MB"] <= 500.0),
        ],
    ]
    arms = ", ".join(f"{name} {time_text(1e3 * row['us_per_pose'])}" for name, row in figures["arms"].items())
    return [
        "## Maps of the workspace",
        "",
        *table(["work", "asked for", "measured", ""], rows, left=4),
        "",
        (
            f"One core for a pose: {arms}. Load average {figures['load_average']:.1f} on two processors. What runs on a cluster would take is projected "
            "in [the guide](guides/workspace.md)."
        ),
        "",
        origin(data),
    ]


def viewer(data: dict) -> list[str]:
    figures = data["figures"]
    update, first, memory = (
        figures[key] for key in ("update of 7 joints and 8 ghosts [ms]", "first picture [s]", "memory")
    )
    rows: list[Row] = [
        [
            "an update of seven joints with eight ghosts, processor time, 30 a second",
            "5 ms",
            f"{update['at 30 Hz, sending included']:.1f} ms",
            met(update["at 30 Hz, sending included"] <= 5.0),
        ],
        [
            "from the command to the arm in the picture",
            "3 s",
            f"{first['arm in the picture']:.2f} s",
            met(first["arm in the picture"] <= 3.0),
        ],
        [
            f"memory over {memory['pictures']:,} pictures",
            "flat",
            f"{memory['settled MB']:.0f} to {memory['end MB']:.0f} MB",
            met(memory["MB per hour"] <= 1.0),
        ],
    ]
    return ["## The viewer", "", *table(["", "asked for", "measured", ""], rows, left=4), "", origin(data)]


def general_recall(data: dict) -> list[str]:
    arms = data["arms"]
    poses, lost = (sum(row[key] for row in arms.values()) for key in ("poses", "lost"))
    silent, empty = (sum(row[key] for row in arms.values()) for key in ("lost_without_doubt", "empty"))
    where = [f"{name} ({row['lost']})" for name, row in arms.items() if row["lost"]]
    return [
        "## The general solver, a million poses of each arm",
        "",
        (
            f"{len(arms)} arms, {poses / 1e6:.0f} million poses, each solved without a closed form: {lost} generating branches lost"
            + (f" ({', '.join(where)})" if where else "")
            + f", {silent} of them without a doubt; {empty} poses left without an answer. Asked for: 99.9999 % found: {met(1.0 - lost / poses >= 0.999999)}. "
            "Hard poses and public arms are on [the page on recall](recall.md)."
        ),
        "",
        origin(data),
    ]


def degenerate_arms(data: dict) -> list[str]:
    figures = data["figures"]
    return [
        "### Arms that no one would build",
        "",
        (
            f"{data['arms']:,} arms with coincident, parallel, zero-length and nearly equal axes, {figures['poses']:,} poses: {figures['empty']} left empty, "
            f"{figures['false']} false answers, {figures['lost']} of {figures['regular']:,} regular joint values lost, {data['slowest_ms']:.1f} ms at most."
        ),
        "",
        origin(data),
    ]


TASK_SECTIONS = (
    general_recall,
    degenerate_arms,
    motion,
    planning,
    planned_motion,
    pick,
    see_and_reach,
    workspace,
    viewer,
)
