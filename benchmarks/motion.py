"""What do a path IK of 1000 poses, a cycle of the servo and a timed path cost, and do the limits hold at every sample?

Path IK: 1000 poses on straight lines of UR5e and KR210, all answers of all poses and the shortest route through them, in processor time.
Servo: cycles of 2 ms that follow a pose or a twist, each timed by the clock on the wall, as single calls are too short for the other.
Limits: random paths of lines, arcs, splines, corners and roundings on both arms, timed with limits of joints and tip, then sampled at 4001
even places that know nothing of the points of the trajectory; reported is the largest share of a limit that any sample uses.

    python benchmarks/motion.py [--rounds 25] [--cycles 20000] [--paths 40]
"""

import argparse
import gc
import time

import paired

# isort: split
import numpy as np
import results

import pieper
from pieper.motion.limits import JointLimits
from pieper.motion.path import arc_through, join, line, spline
from pieper.motion.path_ik import follow_path
from pieper.motion.servo import Servo
from pieper.motion.timing import TcpLimits, time_path

HOME = {"ur5e": [0.3, -1.2, 1.4, -1.7, -1.5, 0.3], "kr210": [0.1, 0.2, -0.3, 0.4, 0.5, 0.6]}
WAY = {"ur5e": [0.2, -0.3, 0.1], "kr210": [0.2, -0.5, 0.2]}
PANDA = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]  # by iteration: it has no closed form
AT_A_TIME = 10
LIMITS = {"max_velocity": 2.0, "max_acceleration": 8.0, "max_jerk": 80.0}


def beside(T: np.ndarray, by) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] += by
    return moved


def path_ik(rounds: int) -> dict:
    found = {}
    for name, q in HOME.items():
        arm = pieper.load(name)
        T = arm.fk(q)
        Ts = line(T, beside(T, WAY[name])).sample(count=1000)[1]
        way = follow_path(arm.chain, Ts)
        assert way.complete
        assert len(way.q) == 1000
        assert np.abs(arm.fk(way.q) - Ts).max() < 1e-9
        ways = {  # the clock of the process ticks every 4 ms on some systems: several at a time
            "all branches": lambda arm=arm, Ts=Ts: [follow_path(arm.chain, Ts) for _ in range(AT_A_TIME)],
            "from a start": lambda arm=arm, Ts=Ts, q=q: [
                follow_path(arm.chain, Ts, q_start=q) for _ in range(AT_A_TIME)
            ],
        }
        for label, seconds in paired.in_turn(ways, rounds=rounds).items():
            found[f"{name}, {label}"] = paired.quartiles([1e3 * value / AT_A_TIME for value in seconds])
    return found


def servo(cycles: int) -> dict:
    found = {}
    for name, q in [*HOME.items(), ("panda", PANDA)]:
        arm = pieper.load(name)
        T = arm.fk(q)
        path = line(T, beside(T, WAY.get(name, [0.1, -0.1, 0.1])))
        there = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 2000)))
        Ts = path.at(np.concatenate([there, there[::-1]]) * path.length)
        swing = np.sin(np.linspace(0.0, 2.0 * np.pi, 2000))[:, None] * np.array([0.05, -0.05, 0.05, 0.1, 0.0, 0.1])
        for kind, targets in (("pose", Ts), ("twist", swing)):
            control = Servo(arm, JointLimits.of(arm.chain, **LIMITS), q=q)
            times = np.empty(cycles)
            held = 0
            gc.disable()
            for k in range(cycles):
                target = targets[k % len(targets)]
                start = time.perf_counter_ns()
                control.step(target)
                times[k] = time.perf_counter_ns() - start
                held += control.held is not None
            gc.enable()
            median, p99, worst = np.percentile(times * 1e-3, [50, 99, 100])
            found[f"{name}, {kind}"] = {"median": median, "p99": p99, "most": worst, "held": held}
    return found


def limits_held(paths: int) -> dict:
    rng = np.random.default_rng(7)
    used = {"velocity": 0.0, "acceleration": 0.0, "jerk": 0.0, "tip velocity": 0.0, "tip acceleration": 0.0}
    samples = timed = 0
    planning, moving = [], []
    for _ in range(paths):
        name = ("ur5e", "kr210")[int(rng.integers(2))]
        arm = pieper.load(name)
        A = arm.fk(HOME[name])
        size = float(np.linalg.norm(WAY[name]))
        B, C = (beside(A, rng.uniform(-0.4, 0.4, 3) * size) for _ in range(2))
        kinds = (
            lambda A=A, B=B: line(A, B),
            lambda A=A, B=B, C=C: arc_through(A, B[:3, 3], C),
            lambda A=A, B=B, C=C: spline([A, B, C]),
            lambda A=A, B=B, C=C: join([line(A, B), line(B, C)]),
            lambda A=A, B=B, C=C, size=size: join([line(A, B), line(B, C)], blend=0.15 * size),
        )
        way = follow_path(arm.chain, kinds[int(rng.integers(5))](), q_start=HOME[name], step=0.005 * size / 0.4)
        if not way.complete:
            continue
        tip = TcpLimits(float(rng.uniform(0.1, 1.0)), float(rng.uniform(0.5, 5.0)))
        start = time.process_time()
        move = time_path(way, tcp=tip, **LIMITS)
        planning.append(1e3 * (time.process_time() - start))
        moving.append(move.duration)
        limits = JointLimits.of(arm.chain, **LIMITS)
        t = np.linspace(0.0, move.duration, 4001)
        q, dq, ddq = move.sample(t)
        J, dJ = arm.jacobian(q), arm.jacobian_rate(q, dq)
        tip_rate = (J @ ddq[..., None] + dJ @ dq[..., None])[:, :3, 0]
        shares = {
            "velocity": (np.abs(dq) / limits.velocity).max(),
            "acceleration": (np.abs(ddq) / limits.acceleration).max(),
            "jerk": (np.abs(np.diff(ddq, axis=0)) / np.diff(t)[:, None] / limits.jerk).max(),
            "tip velocity": np.linalg.norm((J @ dq[..., None])[:, :3, 0], axis=1).max() / tip.velocity,
            "tip acceleration": np.linalg.norm(tip_rate, axis=1).max() / tip.acceleration,
        }
        used = {key: max(used[key], float(shares[key])) for key in used}
        samples += len(t)
        timed += 1
    return {
        "paths": timed,
        "samples": samples,
        "most_over_a_limit": max(used.values()) - 1.0,
        "largest_share": used,
        "planning_ms": paired.quartiles(planning),
        "motion_s": paired.quartiles(moving),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--cycles", type=int, default=20_000)
    parser.add_argument("--paths", type=int, default=40)
    options = parser.parse_args()
    paired.pin_to_one_core()
    figures = {
        "path_ik_ms_per_1000_poses": path_ik(options.rounds),
        "servo_us": servo(options.cycles),
        "limits": limits_held(options.paths),
    }
    for name, value in figures["path_ik_ms_per_1000_poses"].items():
        print(f"path IK, {name:22} {value['median']:7.2f} ms")
    for name, value in figures["servo_us"].items():
        print(
            f"servo, {name:24} {value['median']:7.2f} us median, {value['p99']:7.2f} us p99, {value['held']} held back"
        )
    limits = figures["limits"]
    print(
        f"limits, {limits['paths']} paths, {limits['samples']} samples: most over a limit {limits['most_over_a_limit']:.2e}"
    )
    print(
        f"        timing {limits['planning_ms']['median']:.0f} ms for motions of {limits['motion_s']['median']:.2f} s"
    )
    path = results.save(
        "motion",
        method="medians over rounds of processor time; servo: each cycle by the clock on the wall, one core, no collection of garbage",
        packages=["ruckig"],
        **{key: results.rounded(value) for key, value in figures.items()},
    )
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
