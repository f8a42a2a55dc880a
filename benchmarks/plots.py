"""Pictures of the measurements in results/, written to docs/images/.

    python benchmarks/plots.py

Colours are those of Okabe and Ito, which stay apart for colour-blind readers; every colour has a label or a marker of
its own as well. The background is a card of its own, so that the pictures read the same on light and dark pages.
"""

import math
import pathlib
from collections.abc import Callable

import matplotlib as mpl
import recall_table
import results
from markdown import time_text
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

IMAGES = results.HERE.parent / "docs" / "images"
INK, FAINT, CARD = "#1f2328", "#8b949e", "#fbfbfa"
OURS, YARDSTICK, OTHERS = "#0072b2", "#009e73", "#b8bec6"
SERVO = "#56b4e9"
SOLVERS = {  # how a solver's name begins: label, colour, marker
    "pieper": ("pieper", "#0072b2", "o"),
    "Robotics Toolbox": ("Robotics Toolbox", "#d55e00", "s"),
    "Pinocchio": ("Pinocchio, loop in Python", "#009e73", "^"),
    "TRAC-IK, eps 1e-10, 5 ms": ("TRAC-IK, eps 1e-10, 5 ms", "#cc79a7", "D"),
}
ARMS = {
    "ur5e": "UR5e",
    "kuka_kr210_robond": "KR210",
    "yaskawa_mh12": "MH12",
    "kuka_youbot": "youBot",
    "kinova/jaco2": "JACO 2",
    "fanuc/crx10ia": "CRX-10iA",
    "ufactory/xarm6": "xArm6",
    "yaskawa/hc10": "HC10",
    "agilex/piper": "PiPER",
    "unimation/puma560": "Puma 560",
    "franka/panda": "Panda",
    "kuka/iiwa14": "iiwa14",
    "kassow/kr810": "KR810",
}
LISTERS = {  # solvers that list every solution: colour, marker
    "pieper": (OURS, "o"),
    "EAIK": ("#d55e00", "s"),
    "ssik": ("#009e73", "^"),
    "ur-analytic-ik": ("#cc79a7", "D"),
    "py-opw": ("#e69f00", "v"),
}

mpl.rcParams.update(
    {
        "figure.facecolor": CARD,
        "axes.facecolor": CARD,
        "savefig.facecolor": CARD,
        "font.family": "sans-serif",
        "font.size": 10,
        "text.color": INK,
        "axes.labelcolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.edgecolor": FAINT,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 11,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "svg.fonttype": "path",
        "svg.hashsalt": "pieper",
    }
)


def bars(axes: plt.Axes, rows: list[tuple[str, float, str]]) -> None:
    """Horizontal bars of nanoseconds on a logarithmic scale, quickest on top: label, value, colour."""
    rows = sorted(rows, key=lambda row: row[1])
    heights = range(len(rows))
    axes.barh(heights, [row[1] for row in rows], color=[row[2] for row in rows], height=0.66)
    axes.set_xscale("log")
    axes.set_yticks(heights, [row[0] for row in rows])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    lowest, highest = rows[0][1], rows[-1][1]
    axes.set_xlim(10 ** math.floor(math.log10(lowest) - 0.2), highest * 5)
    axes.xaxis.set_major_formatter(lambda value, _: time_text(value))
    axes.xaxis.set_minor_locator(NullLocator())
    for height, (_, value, _) in zip(heights, rows, strict=True):
        axes.annotate(time_text(value), (value, height), (4, 0), textcoords="offset points", va="center", fontsize=9)
    for label, row in zip(axes.get_yticklabels(), rows, strict=True):
        if row[2] == OURS:
            label.set_fontweight("bold")


def headline(figure: plt.Figure, text: str) -> None:
    """A title over the whole width."""
    figure.suptitle(text, x=0.012, ha="left", fontsize=11, fontweight="bold")
    figure.tight_layout()


def medians(rows: list[dict]) -> dict[str, float]:
    return {row["name"]: row["nanoseconds"]["median"] for row in rows}


def forward_kinematics(data: dict) -> plt.Figure:
    """A million configurations, one thread."""
    found = medians(data["rows"])
    straight = min(value for name, value in found.items() if name.startswith("straight") and "nominal, output" in name)
    rows = [("straight-line C++ for this arm, output reused", straight, YARDSTICK)]
    rows += [
        ("pieper, output reused", found["pieper, nominal, output reused"], OURS),
        ("pieper, new output", found["pieper, nominal, new output"], OURS),
    ]
    skipped = ("pieper", "straight")
    rows += [(name, value, OTHERS) for name, value in found.items() if not name.startswith(skipped)]
    figure, axes = plt.subplots(figsize=(8, 3.1))
    bars(axes, rows)
    headline(figure, "Forward kinematics of a million configurations (UR5e), time for each")
    return figure


def single_call(data: dict) -> plt.Figure:
    """One call from Python."""
    titles = {"forward_kinematics": "One forward kinematics from Python", "jacobian": "One Jacobian from Python"}
    counts = [len(data[key]["rows"]) for key in titles]
    figure, panels = plt.subplots(len(titles), 1, figsize=(8, 5.2), height_ratios=counts, sharex=True)
    for axes, (key, title) in zip(panels, titles.items(), strict=True):
        found = medians(data[key]["rows"])
        bars(axes, [(name, value, OURS if name.startswith("pieper") else OTHERS) for name, value in found.items()])
        axes.set_title(title)
        axes.tick_params(axis="x", labelbottom=True)
    panels[0].set_xlim(100, 1e6)
    figure.tight_layout()
    return figure


def numeric_ik(data: dict) -> plt.Figure:
    """How often a solver misses, and how long it takes, arm by arm."""
    names = list(dict.fromkeys(row["arm"] for row in sorted(data["rows"], key=lambda row: (row["dof"], row["arm"]))))
    place = {name: i for i, name in enumerate(names)}
    figure, (left, right) = plt.subplots(1, 2, sharey=True, figsize=(9, 0.3 * len(names) + 1.6))
    shift = {begin: 0.18 * (i - (len(SOLVERS) - 1) / 2) for i, begin in enumerate(SOLVERS)}
    handles = []
    for begin, (label, colour, marker) in SOLVERS.items():
        rows = [row for row in data["rows"] if row["solver"].startswith(begin)]
        style = {"color": colour, "marker": marker, "linestyle": "none", "markersize": 4.5}
        for row in rows:
            y = place[row["arm"]] + shift[begin]
            left.plot(max(1 - row["success"]["1e-09"], 5e-5), y, **style)
            if row["success"]["1e-06"] - row["success"]["1e-09"] > 0.01:
                left.plot(max(1 - row["success"]["1e-06"], 5e-5), y, **style, markerfacecolor=CARD)
            right.plot([row["median_us"], row["p99_us"]], [y, y], color=colour, linewidth=1.2, alpha=0.7)
            right.plot(row["median_us"], y, **style)
        if rows:
            handles.append(Line2D([], [], **style, label=label))
    handles.append(
        Line2D([], [], color=FAINT, marker="D", linestyle="none", markerfacecolor=CARD, label="TRAC-IK, to 1e-6")
    )
    left.axvline(1e-3, color=FAINT, linewidth=1, linestyle=":")
    left.set_xscale("log")
    left.set_xlim(3.2e-5, 1.6)
    left.set_xticks([5e-5, 1e-3, 1e-2, 1e-1, 1], ["none", "0.1 %", "1 %", "10 %", "all"])
    left.set_yticks(range(len(names)), names)
    left.set_ylim(len(names) - 0.4, -0.6)
    left.set_title("Poses missed (to 1e-9 m and rad)")
    right.set_xscale("log")
    right.xaxis.set_major_formatter(lambda value, _: time_text(value * 1e3))
    right.set_title("Time, from median to 99th percentile")
    for axes in (left, right):
        axes.xaxis.set_minor_locator(NullLocator())
        axes.tick_params(axis="y", length=0)
        axes.hlines([i + 0.5 for i in range(len(names) - 1)], *axes.get_xlim(), color=FAINT, alpha=0.25, linewidth=0.6)
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=9, handletextpad=0.2)
    figure.tight_layout(rect=(0, 0.32 / figure.get_figheight(), 1, 1))
    return figure


def every_solution(data: dict) -> plt.Figure:
    """One call for all solutions, arm by arm, from median to 99th percentile; and ours in a batch."""
    kinds = {"closed": "closed form", "general": "no closed form", "redundant": "seven joints"}
    rows = [(kind, row) for kind in kinds for row in data["parts"].get(kind, {"rows": []})["rows"]]
    rows = [(kind, row) for kind, row in rows if "pieper" in row["solvers"]]
    figure, axes = plt.subplots(figsize=(9, 0.42 * len(rows) + 1.5))
    for y, (_, row) in enumerate(rows):
        present = [name for name in LISTERS if name in row["solvers"]]
        for i, name in enumerate(present):
            figures, (colour, marker) = row["solvers"][name], LISTERS[name]
            style = {"color": colour, "marker": marker, "linestyle": "none", "markersize": 5}
            place = y + 0.18 * (i - (len(present) - 1) / 2)
            ends = [figures["median_us"], figures["p99_us"]]
            axes.plot(ends, [place, place], color=colour, linewidth=1.4, alpha=0.7)
            axes.plot(figures["median_us"], place, **style)
            if name == "pieper" and "batch_us" in figures:
                axes.plot(figures["batch_us"], place, **style, markerfacecolor=CARD)
        best = row["solvers"]["pieper"]["best peer / this"]["median"]["median"]
        axes.annotate(
            f"{best:.3g} times",
            (1.0, y),
            (6, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
    axes.annotate(
        "best peer / pieper,\none call",
        (1.0, 1.0),
        (6, 4),
        xycoords="axes fraction",
        textcoords="offset points",
        va="bottom",
        fontsize=9,
    )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: time_text(value * 1e3))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(rows)), [ARMS[row["arm"]] for _, row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    for y in range(len(rows) - 1):
        between = rows[y][0] != rows[y + 1][0]
        axes.axhline(y + 0.5, color=FAINT, alpha=0.8 if between else 0.25, linewidth=1.0 if between else 0.6)
    for kind, words in kinds.items():
        first = next((y for y, (own, _) in enumerate(rows) if own == kind), None)
        if first is not None:
            axes.annotate(
                words, (0.99, first - 0.4), xycoords=("axes fraction", "data"), ha="right", va="top", fontsize=9
            )
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle="none", markersize=5, label=name)
        for name, (colour, marker) in LISTERS.items()
    ]
    handles.insert(
        1,
        Line2D(
            [], [], color=OURS, marker="o", linestyle="none", markerfacecolor=CARD, label="pieper, a pose of a batch"
        ),
    )
    figure.suptitle(
        "Every solution of a pose: time of one call, from median to 99th percentile",
        x=0.012,
        ha="left",
        fontsize=11,
        fontweight="bold",
    )
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=9, handletextpad=0.2)
    figure.tight_layout(rect=(0, 0.32 / figure.get_figheight(), 1, 1))
    return figure


def motion(data: dict) -> plt.Figure:
    """A pose of a path, and a cycle of the servo."""
    path = data["path_ik_ms_per_1000_poses"]
    rows = [(f"path IK, a pose: {label(name)}", 1e3 * row["median"], YARDSTICK) for name, row in path.items()]
    rows += [(f"servo, a cycle: {label(name)}", 1e3 * row["median"], SERVO) for name, row in data["servo_us"].items()]
    figure, axes = plt.subplots(figsize=(8, 0.27 * len(rows) + 0.9))
    bars(axes, rows)
    headline(figure, "Following: medians of one pose of a path and of one cycle of the servo")
    return figure


def label(name: str) -> str:
    """The name of an arm as its maker writes it."""
    arm, _, rest = name.partition(", ")
    return f"{ {'ur5e': 'UR5e', 'kr210': 'KR210', 'panda': 'Panda'}.get(arm, arm) }, {rest}"


def planning(data: dict) -> plt.Figure:
    """How many questions are answered within a time."""
    figure, axes = plt.subplots(figsize=(8, 3.1))
    for (words, arms), color in zip(
        {"KR210, nine slots": "kr210", "UR5e, random shelves": "ur5e"}.items(), (YARDSTICK, OURS), strict=True
    ):
        seconds = sorted(row["processor_seconds"] for row in data["rows"] if row["arm"] == arms)
        share = [100.0 * (k + 1) / len(seconds) for k in range(len(seconds))]
        axes.step(seconds, share, where="post", color=color, linewidth=1.8)
        middle = seconds[round(0.62 * len(seconds))]
        side = (8, -12) if color == OURS else (-8, 10)
        axes.annotate(
            words,
            (middle, 62.0),
            side,
            textcoords="offset points",
            color=color,
            ha="left" if color == OURS else "right",
        )
    for limit, words in ((0.15, "asked: median"), (2.0, "asked: 99 %")):
        axes.axvline(limit, color=FAINT, linewidth=1, linestyle=":")
        axes.annotate(words, (limit, 2), (-3, 0), textcoords="offset points", fontsize=9, color=FAINT, ha="right")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: time_text(1e9 * value))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_ylim(0, 112)
    axes.set_yticks([0, 25, 50, 75, 100], ["0 %", "25 %", "50 %", "75 %", "100 %"])
    headline(figure, "Paths among obstacles: share of questions answered within a time")
    return figure


def recall(data: dict) -> plt.Figure:
    """How many poses lose their branch, by kind of pose."""
    none = 1e-8
    groups = recall_table.groups(data)
    kinds = list(next(iter(groups.values())))
    figure, axes = plt.subplots(figsize=(8, 4.2))
    styles = zip(groups.items(), ((OURS, "o"), (YARDSTICK, "^"), ("#d55e00", "s")), strict=True)
    for k, ((words, by_kind), (color, marker)) in enumerate(styles):
        lost = {kind: recall_table.missing(kind, figures) for kind, figures in by_kind.items()}
        x = [max(part / whole, none) for part, whole in lost.values()]
        y = [kinds.index(kind) + 0.26 * (k - 1) for kind in lost]
        axes.plot(x, y, color=color, marker=marker, linestyle="none", markersize=6, label=words)
    axes.set_xscale("log")
    axes.set_xlim(none / 2, 1e-2)
    axes.set_xticks([none, *(10.0**p for p in range(-7, -1))])
    axes.xaxis.set_major_formatter(lambda x, _: "none" if x < 2 * none else f"{100 * x:.6g} %")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(kinds)), kinds)
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.hlines([i + 0.5 for i in range(len(kinds) - 1)], *axes.get_xlim(), color=FAINT, alpha=0.25, linewidth=0.6)
    figure.legend(loc="lower center", ncols=3, frameon=False, fontsize=9, handletextpad=0.2)
    figure.suptitle("Poses that lose their branch; below 1e-8 rad: that are not answered", x=0.012, ha="left", fontsize=11, fontweight="bold")  # fmt: skip
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    return figure


PICTURES: dict[str, Callable[[dict], plt.Figure]] = {
    "forward_kinematics": forward_kinematics,
    "single_call": single_call,
    "every_solution": every_solution,
    "numeric_ik": numeric_ik,
    "motion": motion,
    "planning": planning,
    "recall": recall,
}


def main() -> None:
    IMAGES.mkdir(parents=True, exist_ok=True)
    for question, draw in PICTURES.items():
        if not (results.RESULTS / f"{question}.json").exists():
            print(f"no results for {question}")
            continue
        figure = draw(results.load(question))
        path: pathlib.Path = IMAGES / f"benchmark_{question}.svg"
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
        print(path)


if __name__ == "__main__":
    main()
