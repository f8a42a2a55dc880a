"""How many cans are picked when nobody tells where they are, and how far off is what the camera says?

Before each round of three, the cans are put anywhere in the stated area of the table, at least some distance apart, and the light changes:
direction, strength, light from everywhere, colour, with or without shadows. The camera was calibrated by showing it a board; one picture of
640 x 480 pixels for each can says where it is. Counted are the cans in the bin; the error is that of the place on the table against
the simulator's truth, which the arm never hears of. Each seed calibrates anew, learns the colours anew, and has places and light of its own.

    python benchmarks/see_and_reach.py [--cycles 100] [--seeds 3] [--arms kr210 ur10e]
"""

import argparse
import time

import numpy as np
import results

from pieper.spatial import pose
from pieper.tasks import see


def measured(name: str, cycles: int, seeds: int) -> dict[str, object]:
    task = see.see_task(name)
    start = time.process_time()
    placed, errors, agreement, cameras, runs, reasons, again = 0, [], [], [], [], [], 0
    expected, views = [], []
    for seed in range(seeds):
        with see.SeeAndPick(task, seed=seed) as run:
            found = run.calibration
            cameras.append(pose.distance(found.T_mount_camera, task.scene_camera.T_world_camera))
            expected.append(float(np.linalg.norm(found.position_deviation)))
            views.append(int(found.used.sum()))
            share = [len(part) for part in np.array_split(np.arange(cycles), seeds)][seed]
            done = list(run.run(share))
        placed += sum(cycle.placed for cycle in done)
        again += sum(cycle.attempts > 1 for cycle in done)
        reasons += [f"seed {seed}, cycle {c.number}, {c.target}: {c.reason}" for c in done if not c.placed]
        errors += [look.error for look in run.looks]
        agreement += [look.found.agreement for look in run.looks if look.found is not None]
        runs.append(float(np.mean([cycle.duration for cycle in done])))
        print(f"{name}, seed {seed}: {sum(c.placed for c in done)} of {share} placed", flush=True)
    seen = np.array(errors)[np.isfinite(errors)]
    return {
        "cycles": cycles,
        "seeds": seeds,
        "placed": placed,
        "cycles with a second grasp": again,
        "looks": len(errors),
        "looks that saw nothing": int(np.isnan(errors).sum()),
        "error of a place, mean [mm]": 1e3 * float(seen.mean()),
        "error of a place, 95 % [mm]": 1e3 * float(np.quantile(seen, 0.95)),
        "error of a place, largest [mm]": 1e3 * float(seen.max()),
        "worst agreement of outlines": float(min(agreement)),
        "views used to calibrate": views,
        "error of the camera [mm]": [1e3 * float(p) for p, _ in cameras],
        "error of the camera [deg]": [float(np.degrees(r)) for _, r in cameras],
        "its standard deviation as told [mm]": [1e3 * s for s in expected],
        "mean cycle [s]": float(np.mean(runs)),
        "processor time for a cycle, calibration included [s]": (time.process_time() - start) / cycles,
        "reasons": reasons,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=100, help="of each arm, over all seeds")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--arms", nargs="+", default=["kr210", "ur10e"])
    options = parser.parse_args()
    found: dict[str, object] = {}
    for name in options.arms:
        found[name] = measured(name, options.cycles, options.seeds)
        print(name, results.rounded(found[name]), flush=True)
    path = results.save(
        "see_and_reach",
        method="one picture of 640 x 480 pixels for each can; height of the table and size of the cans are known, places, light and the camera's pose are not; "
        "area of 0.7 x 1.3 m (KR210) or 0.35 x 0.7 m (UR10e); lamp up to 50 deg off the vertical, 0.25 to 0.8 strong, light from everywhere "
        "0.25 to 0.6, each channel +-15 %, shadows in 80 %; joints read with 5e-5 rad of noise while calibrating",
        packages=["mujoco", "opencv-python-headless"],
        arms=results.rounded(found),
    )
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
