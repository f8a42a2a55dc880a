"""How many things are placed, and how long does a cycle take, when the slots are as crooked as they are in life?

Every arm that has a task picks through its nine slots again and again, in full contact physics; before each round the things stand up to
5 mm and 5 deg from where they should. Counted are the things in the bin; timed are the cycles in simulated time, and the processor
time that planning and simulating them takes; with both planners, over several seeds. The drives' tracking error is the largest difference between reference and measurement over all joints,
over one cycle of the KR210.

    python benchmarks/pick.py [--cycles 200] [--others 45] [--seeds 3] [--direct-seeds 1] [--first-seed 10]
"""

import argparse
import time

import numpy as np
import results

from pieper.tasks import pick_tasks
from pieper.tasks.pick import PLANNERS, PickAndPlace


def measured(name: str, planner: str, cycles: int, seeds: range) -> dict[str, object]:
    start = time.process_time()
    placed, durations, attempts, reasons, simulated = [], [], [], [], 0.0
    for seed in seeds:
        run = PickAndPlace(pick_tasks.task(name), seed=seed, planner=planner)
        placed.append(0)
        for cycle in run.run(cycles):
            placed[-1] += cycle.placed
            attempts.append(cycle.attempts)
            durations.append(cycle.duration)
            if not cycle.placed:
                reasons.append(f"seed {seed}, cycle {cycle.number}, {cycle.target}: {cycle.reason}")
                print(reasons[-1], flush=True)
        simulated += run.robot.time
        print(f"{name}, {planner}, seed {seed}: {placed[-1]} of {cycles} placed", flush=True)
    taken = time.process_time() - start
    return {
        "cycles for each seed": cycles,
        "placed for each seed": placed,
        "cycles with a second grasp": int((np.array(attempts) > 1).sum()),
        "mean cycle [s]": float(np.mean(durations)),
        "longest cycle [s]": float(np.max(durations)),
        "processor time for a cycle [s]": taken / (cycles * len(seeds)),
        "times real time": simulated / taken,
        "reasons": reasons,
    }


def tracking(name: str) -> float:
    """The largest error of a joint over a cycle, against the reference at the same time [rad]."""
    run = PickAndPlace(pick_tasks.task(name))
    worst = [0.0]

    def look() -> None:
        worst[0] = max(worst[0], float(np.abs(run.robot.read().q - run.robot.reference.q).max()))

    run.robot.observers.append(look)
    for _ in run.run(1):
        pass
    return worst[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=200, help="of the KR210")
    parser.add_argument("--others", type=int, default=45, help="of each other arm")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--direct-seeds", type=int, default=1, help="with the mover that does not search")
    parser.add_argument("--first-seed", type=int, default=10, help="0 and 1 were looked at while the tasks were made")
    options = parser.parse_args()
    worst = tracking("kr210")
    print(f"tracking error {1e3 * worst:.3f} mrad", flush=True)
    found: dict[str, dict[str, object]] = {}
    for planner, seeds in zip(PLANNERS, (options.seeds, options.direct_seeds), strict=True):
        for name in pick_tasks.names():
            cycles = options.cycles if name == "kr210" else options.others
            found.setdefault(name, {})[planner] = measured(
                name, planner, cycles, range(options.first_seed, options.first_seed + seeds)
            )
            print(name, planner, results.rounded(found[name][planner]), flush=True)
            path = results.save(
                "pick",
                method="nine slots, +-5 mm along x and y, +-5 deg of yaw, uniform; physics at 2 ms; poses known to the simulator; "
                f"seeds from {options.first_seed} on; "
                "processor time of one process, models, start and planning included",
                packages=["mujoco", "coal", "ompl", "ruckig"],
                tracking_error_rad=worst,
                arms=results.rounded(found),
            )
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
