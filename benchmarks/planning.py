"""How often, and how quickly, is a path found among shelves, and does it touch anything?

python benchmarks/planning.py              measure (a minute or two), write results/planning.json and the figures of docs/guides/planning.md
python benchmarks/planning.py --shelves 5  fewer random shelves, and nothing is written
python benchmarks/planning.py --picture    draw docs/images/plan_shelf.png
python benchmarks/planning.py --motion     how much quicker are motions with rounded corners? writes results/planned_motion.json

18 questions of a KR210 before a shelf with nine cans (from rest before each can, and from rest to each can), and 100 of a UR5e from a pose in one
bay of a random shelf to a pose in another. Every path is walked again in steps of 2 mm by a judge that shares nothing with the planner:
kinematics and geometry of MuJoCo. A question that is not answered in time is asked again with more time and other seeds; if that finds a path,
the question counts as failed, otherwise as having none.
"""

import argparse
import statistics
import time

import numpy as np
import paired  # noqa: F401  before NumPy: one thread
import results
from shelves import MARGIN, Judge, dense, kr210_queries, ur5e_queries
from table import origin, table

from pieper.motion.blending import time_blended
from pieper.motion.edges import EdgeCheck
from pieper.motion.limits import JointLimits
from pieper.motion.planning import plan
from pieper.motion.timing import usage

TIMEOUT = 10.0  # [s]
SPACING = 0.002  # [m] between states that the judge looks at
PATIENCE = 20.0  # [s] for each of the seeds by which it is found out whether there is a path
SEEDS = 3


def ask(query, judged: bool = True) -> dict:
    """One question, answered and judged."""
    begun, worked = time.perf_counter(), time.process_time()
    path = plan(query.model, query.q_start, query.goal, timeout=TIMEOUT)
    row = {
        "name": query.name,
        "arm": query.arm,
        "found": path.found,
        "status": path.status,
        "seconds": time.perf_counter() - begun,
        "processor_seconds": time.process_time() - worked,
        "points": len(path.q),
        "length": path.length,
        "edges": path.edges,
        "states": path.states,
    }
    if path.found:
        judge, states = Judge(query.model), dense(path.q, query.model, SPACING)
        touching = [touched for touched in map(judge.touches, states) if touched] if judged else []
        return row | {"judged": len(states), "touching": len(touching), "first": touching[0][:2] if touching else []}
    exists = any(
        plan(query.model, query.q_start, query.goal, timeout=PATIENCE, seed=seed).found for seed in range(1, 1 + SEEDS)
    )
    return row | {"judged": 0, "touching": 0, "first": [], "exists": exists, "reason": path.reason}


def summary(rows: list[dict]) -> dict:
    """What the rows say together."""
    asked = [row for row in rows if row["found"] or row["exists"]]
    seconds = sorted(row["processor_seconds"] for row in asked)
    return {
        "questions": len(rows),
        "with_a_path": len(asked),
        "found": sum(row["found"] for row in asked),
        "median_seconds": statistics.median(seconds),
        "p99_seconds": float(np.quantile(seconds, 0.99)),
        "worst_seconds": seconds[-1],
        "states_judged": sum(row["judged"] for row in rows),
        "states_touching": sum(row["touching"] for row in rows),
    }


def move(query) -> dict:
    """The motion along a path, at rest at each point and with rounded corners; judged every 8 ms."""
    path = plan(query.model, query.q_start, query.goal, timeout=TIMEOUT)
    row = {"name": query.name, "found": path.found, "points": len(path.q)}
    if not path.found:
        return row
    worked = time.process_time()
    motion = time_blended(EdgeCheck(query.model), path.q)
    worked = time.process_time() - worked
    made = motion.trajectory
    states = made.sample(np.append(np.arange(0.0, made.duration, 0.008), made.duration)).q
    judge = Judge(query.model)
    return row | {
        "rest_at_each": motion.at_rest,
        "rounded": made.duration,
        "corners": int((motion.rounded > 0.0).sum()),
        "timing_seconds": worked,
        "limits_used": max(usage(made, JointLimits.of(query.model.chain))),
        "judged": len(states),
        "touching": sum(bool(judge.touches(state)) for state in states),
    }


def motions(count: int) -> None:
    """Measure motions along the paths, and say what came out."""
    asked = {"KR210, nine slots": kr210_queries(), "UR5e, random shelves": ur5e_queries(count)[0]}
    rows = {name: [row for row in map(move, queries) if row["found"]] for name, queries in asked.items()}
    figures = {}
    for name, each in rows.items():
        turning = [row for row in each if row["points"] > 2]
        figures[name] = {
            "motions": len(each),
            "with_corners": len(turning),
            "corners": sum(row["points"] - 2 for row in turning),
            "corners_rounded": sum(row["corners"] for row in turning),
            "median_share_of_time": statistics.median(row["rounded"] / row["rest_at_each"] for row in turning),
            "share_of_time": sum(row["rounded"] for row in turning) / sum(row["rest_at_each"] for row in turning),
            "median_timing_seconds": statistics.median(row["timing_seconds"] for row in turning),
            "limits_used": max(row["limits_used"] for row in each),
            "states_judged": sum(row["judged"] for row in each),
            "states_touching": sum(row["touching"] for row in each),
        }
        print(name, figures[name])
    if count == 100:
        results.save(
            "planned_motion",
            method="motions along the paths of benchmarks/planning.py within the default limits of joints: duration with rounded corners "
            "over that with a rest at each point, for paths that have corners; processor time of the timing with its checks; states "
            "every 8 ms judged by MuJoCo",
            packages=["ompl", "coal", "mujoco", "ruckig"],
            figures=figures,
            rows=results.rounded([row for each in rows.values() for row in each]),
        )


def tell(name: str, figures: dict) -> None:
    """One line for people."""
    print(
        f"{name:22}  found {figures['found']} of {figures['with_a_path']} ({figures['questions']} asked)   median "
        f"{figures['median_seconds']:.3f} s  p99 {figures['p99_seconds']:.2f} s  worst {figures['worst_seconds']:.2f} s   "
        f"{figures['states_touching']} of {figures['states_judged']} states touch something"
    )


def write_page(data: dict) -> None:
    """Put the figures into the guide."""
    page = results.HERE.parent / "docs" / "guides" / "planning.md"
    head = ["questions", "found", "median [s]", "99 % [s]", "worst [s]", "states judged", "of them touching"]
    rows = [
        [
            name,
            f"{each['found']} of {each['with_a_path']}",
            *(f"{each[key]:.3f}" for key in ("median_seconds", "p99_seconds", "worst_seconds")),
            f"{each['states_judged']:,}".replace(",", " "),
            str(each["states_touching"]),
        ]
        for name, each in data["figures"].items()
    ]
    begin, end = "<!-- figures: written by benchmarks/planning.py -->\n", "<!-- end of figures -->"
    before, _, rest = page.read_text().partition(begin)
    after = rest.partition(end)[2]
    page.write_text("\n".join([before + begin.rstrip(), "", *table(head, rows), "", origin(data), "", end + after]))


def picture(query, path, file: str, view: tuple[float, float]) -> None:
    """A plan among its shelves."""
    import pieper
    from pieper.cli.plan import draw_plan
    from pieper.motion.world import World
    from pieper.sim.picture import Picture

    shown = Picture(size=(960, 720), view=view, grid=False, smooth=False)
    near = World(tuple(item for item in query.model.world if item.name != "floor" and not item.name.startswith("bin")))
    draw_plan(shown, pieper.load(query.arm), near, path)
    tool = {item.name for item in query.model.tool}
    for k, q in enumerate(path.q):
        solids = [(solid, T) for name, solid, T in query.model.solids(q) if name in tool]
        shown.add_solids(solids, color="#41464d", opacity=1.0 if k == len(path.q) - 1 else 0.25)
    shown.save(results.HERE.parent / "docs" / "images" / file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shelves", type=int, default=100)
    parser.add_argument("--picture", action="store_true")
    parser.add_argument("--motion", action="store_true")
    arguments = parser.parse_args()
    if arguments.motion:
        motions(arguments.shelves)
        return
    if arguments.picture:
        query = kr210_queries()[1]
        picture(
            query,
            plan(query.model, query.q_start, query.goal),
            "plan_shelf.png",
            (np.radians(-125.0), np.radians(22.0)),
        )
        return
    slots = kr210_queries()
    plan(slots[0].model, slots[0].q_start, slots[0].goal)  # imports
    rows = {"KR210, nine slots": [ask(query) for query in slots]}
    shelves, seeds = ur5e_queries(arguments.shelves)
    rows["UR5e, random shelves"] = [ask(query) for query in shelves]
    figures = {name: summary(each) for name, each in rows.items()}
    figures["together"] = summary([row for each in rows.values() for row in each])
    for name, each in figures.items():
        tell(name, each)
    if arguments.shelves == 100:
        results.save(
            "planning",
            method=f"processor time of one core for plan() with a margin of {MARGIN} m and seed 0, the collision model made before; "
            f"random shelves are those of the first {seeds} seeds that have a free start and a free goal; states {SPACING} m apart judged by MuJoCo",
            packages=["ompl", "coal", "mujoco"],
            figures=figures,
            rows=results.rounded([row for each in rows.values() for row in each]),
        )
        write_page(results.load("planning"))


if __name__ == "__main__":
    main()
