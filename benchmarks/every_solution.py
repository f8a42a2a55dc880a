"""What does every inverse solution of a pose cost, and are they all there? Each kind of arm beside the peers that take it.

Poses are those of joint values drawn evenly from a whole turn, and every solver gets the same ones. Each is solved by one call, whose
answers are read, and all by a batch where there is one. A judge, a forward kinematics that shares no code with any solver,
says which answers hold (1e-6 m and rad) and whether the joint values that made the pose are among them.

The parts, each of which is measured in one go:

closed      arms with a closed form: UR5e, KR210, MH12, and the youBot with five joints
singular    the same arms at straight wrists, stretched elbows and shoulder singularities, and 1e-8 rad beside them
general     six joints without a closed form, the constants read from ssik; and the Puma 560 by the general solver
redundant   seven joints, 16 values of the redundancy
unreachable poses out of reach, and poses within reach that no joint values give
load        text of a URDF that was never seen to its first complete answer
numeric     one answer within limits by iteration, to 1e-9

    python benchmarks/every_solution.py [--parts closed general ...] [--rounds 15] [--scale 1.0]

A part that is measured again replaces what was there. ``--scale 0.1`` takes a tenth of the poses, for a look.
"""

import argparse
import contextlib
import dataclasses
import functools
import io
import json
import os
import time
import warnings
from collections.abc import Callable
from typing import Any

import paired

# isort: split
import arms
import numeric_ik
import numpy as np
import public_arms
import results
import solvers
from solvers import Solver

CLOSED = ("ur5e", "kuka_kr210_robond", "yaskawa_mh12", "kuka_youbot")
GENERAL = ("kinova/jaco2", "fanuc/crx10ia", "ufactory/xarm6", "yaskawa/hc10", "agilex/piper")
PUMA = "unimation/puma560"
REDUNDANT = ("franka/panda", "kuka/iiwa14")
NO_CLOSED_FORM = "kassow/kr810"
VALUES = 16
SAME = 1e-5  # rad
SAME_BRANCH = 1e-2  # rad, beside a singularity
BESIDE = 1e-8  # rad
Row = dict[str, Any]


# --- one arm, several solvers


def compare(arm: public_arms.Arm, T: np.ndarray, q: np.ndarray | None, several: list[Solver], *, rounds: int) -> Row:
    """Times and quality of each solver, and our time beside that of the best peer."""
    tasks = {solver.name: paired.Task(solver.call, solver.poses, solver.before) for solver in several}
    seconds = {name: np.array(values) for name, values in paired.each_in_turn(tasks, rounds=rounds).items()}
    together = {solver.name: functools.partial(at_once, solver) for solver in several if solver.batch}
    batch = paired.in_turn(together, rounds=max(rounds, 15))
    found: Row = {"arm": arm.name, "poses": len(T), "solvers": {}}
    for solver in several:
        spent = np.median(seconds[solver.name], axis=0) * 1e6
        figures: Row = {
            "median_us": float(np.median(spent)),
            "mean_us": float(spent.mean()),
            "p99_us": float(np.percentile(spent, 99)),
            "most_us": float(spent.max()),
            "quality": dataclasses.asdict(solvers.judged(arm.forward, T, q, solver, same=SAME)),
        }
        if solver.name in batch:
            figures["batch_us"] = float(np.median(batch[solver.name]) * 1e6 / len(T))
        found["solvers"][solver.name] = figures
    peers = [solver.name for solver in several if not solver.name.startswith("pieper")]
    best = min(peers, key=lambda name: found["solvers"][name]["median_us"])
    found["best peer"] = best
    least = {
        name: min(found["solvers"][name].get("batch_us", np.inf), found["solvers"][name]["median_us"]) for name in peers
    }
    for name, figures in found["solvers"].items():
        rounded = (list(np.median(seconds[one], axis=1)) for one in (best, name))
        figures["best peer / this"] = {
            "median": paired.ratio(*rounded),
            "p99": found["solvers"][best]["p99_us"] / figures["p99_us"],
        }
        if name in batch:
            figures["best peer / this"]["batch"] = min(least.values()) / figures["batch_us"]
    for name, figures in found["solvers"].items():
        quality = figures["quality"]
        print(
            f"{arm.name:20} {name:26} median {figures['median_us']:9.2f} us  p99 {figures['p99_us']:9.2f}  "
            f"batch {figures.get('batch_us', np.nan):8.3f}  answers {quality['answers_per_pose']:7.3f}  "
            f"recall {quality['recall']}  false {quality['false_answers']}  "
            f"best peer / this {figures['best peer / this']['median']['median']:7.3f}",
            flush=True,
        )
    return found


def at_once(solver: Solver) -> object:
    assert solver.batch is not None
    solver.before()
    return solver.batch()


def everyone(name: str, T: np.ndarray, q: np.ndarray | None) -> list[Solver]:
    """All solvers that take an arm of the part ``closed``."""
    import pieper

    arm = public_arms.built_in(name)
    several = [solvers.pieper(pieper.load(name).ik, T), solvers.eaik(arm, T)]
    if arm.dof == 6:
        several.append(solvers.ssik(generated(name), T))
    if name == "ur5e":
        several.append(solvers.ur_analytic_ik(arm, name, T, q))
    if name in solvers.OPW:
        several.append(solvers.py_opw(arm, T))
    return several


@functools.cache
def generated(name: str) -> Any:
    return solvers.ssik_module("universal_robots/ur5e") if name == "ur5e" else solvers.ssik_built(arms.load(name))


def slower(solve: Callable[..., Any], T: np.ndarray, **options: Any) -> list[Solver]:
    """The same with narrower instruction sets, where this machine has more than one."""
    from pieper._native import kernels

    return [solvers.pieper(solve, T, instructions=name, **options) for name in kernels.instruction_sets()[-2::-1]]


def drawn(arm: public_arms.Arm, count: int, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, arm.dof))
    return q, np.ascontiguousarray(arm.forward(q))


# --- parts


def closed(count: int, rounds: int) -> list[Row]:
    import pieper

    rows = []
    for name in CLOSED:
        arm = public_arms.built_in(name)
        q, T = drawn(arm, count)
        rows.append(compare(arm, T, q, [*everyone(name, T, q), *slower(pieper.load(name).ik, T)], rounds=rounds))
    return rows


def singular(count: int, rounds: int) -> list[Row]:
    """The share of poses with an answer; and of those 1e-8 rad beside, the share with the branch they came from."""
    del rounds
    rows = []
    for name in CLOSED[:3]:
        arm = public_arms.built_in(name)
        for kind, joint in (("wrist", 4), ("elbow", 2), ("shoulder", 1)):
            q = singular_joints(arm, kind, joint, count)
            row: Row = {"arm": name, "kind": kind, "poses": len(q), "solvers": {}}
            for beside in (0.0, BESIDE):
                moved = q.copy()
                moved[:, joint] += beside
                T = np.ascontiguousarray(arm.forward(moved))
                for solver in everyone(name, T, moved):
                    quality = solvers.judged(arm.forward, T, moved, solver, same=SAME_BRANCH)
                    figures = row["solvers"].setdefault(solver.name, {})
                    figures["beside" if beside else "exact"] = dataclasses.asdict(quality)
            rows.append(row)
            for solver, figures in row["solvers"].items():
                print(
                    f"{name:20} {kind:9} {solver:20} answered {figures['exact']['answered']:.3f}, unflagged "
                    f"{figures['exact']['answered_unflagged']:.3f}; beside: answered {figures['beside']['answered']:.3f}, "
                    f"branch {figures['beside']['recall']:.3f}",
                    flush=True,
                )
    return rows


def singular_joints(arm: public_arms.Arm, kind: str, joint: int, count: int) -> np.ndarray:
    """(count, 6) joint values with a singular Jacobian, found along one joint to the last digit.

    An elbow is singular whatever joint 2 is; a shoulder is not.
    """
    rng = np.random.default_rng(1)
    grid = np.linspace(-np.pi, np.pi, 73)
    found: list[np.ndarray] = []

    def at(row: np.ndarray, value: float) -> np.ndarray:
        moved = row.copy()
        moved[joint] = value
        return moved

    while len(found) < count:
        row = rng.uniform(-np.pi, np.pi, arm.dof)
        values = determinant(arm, np.array([at(row, value) for value in grid]))
        for k in np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:])):
            low, high = grid[k], grid[k + 1]
            for _ in range(60):
                middle = 0.5 * (low + high)
                same = np.sign(determinant(arm, at(row, middle)[None])[0]) == np.sign(values[k])
                low, high = (middle, high) if same else (low, middle)
            here = at(row, 0.5 * (low + high))
            other = here.copy()
            other[1 if kind == "elbow" else 0] += 0.7
            if abs(determinant(arm, other[None])[0]) < 1e-12 and len(found) < count:
                found.append(here)
    return np.array(found)


def determinant(arm: public_arms.Arm, q: np.ndarray) -> np.ndarray:
    """Of the Jacobian, by the axes in place."""
    columns, T = [], np.broadcast_to(arm.constants[0], (len(q), 4, 4))
    for value, constant in zip(q.T, arm.constants[1:], strict=True):
        z = T[:, :3, 2]
        columns.append(np.concatenate([np.cross(T[:, :3, 3], z), z], axis=1))
        turn = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(value)
        turn[:, 1, 0] = np.sin(value)
        turn[:, 0, 1] = -turn[:, 1, 0]
        T = T @ turn @ constant
    return np.linalg.det(np.stack(columns, axis=2))


def general(count: int, rounds: int) -> list[Row]:
    import pieper
    from pieper.ik.general_6r import solve_general_6r

    rows, shipped = [], {arm.name: arm for arm in public_arms._ssik()}
    for name in (*GENERAL, PUMA):
        arm = shipped[name]
        q, T = drawn(arm, count)
        ours = pieper.load(solvers.chain_of(arm))
        options = {} if ours.ik_info.method == "general" else {"method": "general"}
        several = [solvers.pieper(ours.ik, T, **options), *slower(ours.ik, T, **options)]
        several += [solvers.pieper(ours.ik, T, mode=mode, **options) for mode in ("fast", "complete")]
        engine = solvers.pieper(functools.partial(solve_general_6r, ours.chain), T)
        several.append(dataclasses.replace(engine, name="pieper, solve_general_6r"))
        several.append(solvers.ssik(solvers.ssik_module(name), T))
        rows.append(compare(arm, T, q, several, rounds=rounds))
    return rows


def redundant(count: int, rounds: int) -> list[Row]:
    import pieper
    from pieper.ik.redundancy import solve_redundant

    rows, shipped = [], {arm.name: arm for arm in public_arms._ssik()}
    for name in (*REDUNDANT, NO_CLOSED_FORM):
        arm = shipped[name]
        slow = name == NO_CLOSED_FORM
        _, T = drawn(arm, max(count // 10, 3) if slow else count)
        ours = pieper.load(solvers.chain_of(arm))
        theirs = solvers.ssik(solvers.ssik_module(name), T)
        below = solvers.pieper(functools.partial(solve_redundant, ours.chain), T, samples=VALUES)
        several = [solvers.pieper(ours.ik, T, samples=VALUES), *slower(ours.ik, T, samples=VALUES)]
        several += [dataclasses.replace(below, name="pieper, solve_redundant"), theirs]
        if not slow:
            wanted = sum(len(theirs.call(pose)) for pose in T)
            enough = next(m for m in range(1, 200) if ours.ik(T, samples=m).valid.sum() >= wanted)
            as_many = solvers.pieper(ours.ik, T, samples=enough)
            several.append(dataclasses.replace(as_many, name=f"pieper, {enough} values"))
            below = solvers.pieper(functools.partial(solve_redundant, ours.chain), T, samples=enough)
            several.append(dataclasses.replace(below, name=f"pieper, solve_redundant, {enough} values"))
        rows.append(compare(arm, T, None, several, rounds=min(rounds, 5) if slow else rounds))
    return rows


def unreachable(count: int, rounds: int) -> list[Row]:
    """Poses half as far again as the arm can reach; and random poses within its reach that have no answer."""
    import pieper

    rows, shipped = [], {arm.name: arm for arm in public_arms._ssik()}
    for name in (*CLOSED[:3], *GENERAL):
        arm = public_arms.built_in(name) if name in CLOSED else shipped[name]
        ours = pieper.load(name if name in CLOSED else solvers.chain_of(arm))
        _, T = drawn(arm, 20 * count)
        reach = np.linalg.norm(T[:, :3, 3], axis=1).max()
        rng = np.random.default_rng(2)
        rng.shuffle(T[:, :3, 3])  # positions that can be reached with rotations of others
        nowhere = ours.ik(T).count == 0
        inside = T[nowhere][:count]
        outside = T[:count].copy()
        outside[:, :3, 3] *= 1.5 * reach / np.linalg.norm(outside[:, :3, 3], axis=1, keepdims=True)
        for kind, poses in (("out of reach", outside), ("within reach, but not so turned", inside)):
            if len(poses) < 3:
                continue
            poses = np.ascontiguousarray(poses)
            if name in CLOSED:
                several = everyone(name, poses, None)
            else:
                several = [solvers.pieper(ours.ik, poses), solvers.ssik(solvers.ssik_module(name), poses)]
            rows.append({"kind": kind} | compare(arm, poses, None, several, rounds=rounds))
    return rows


def load(count: int, rounds: int) -> list[Row]:
    """Every run has an arm of its own: all lengths of an arm, times a number that was not there before."""
    del rounds
    import pieper

    shipped = {arm.name: arm for arm in public_arms._ssik()}
    rows: list[Row] = []
    for name in (*CLOSED, *GENERAL, *REDUNDANT, NO_CLOSED_FORM):
        source = arms.load(name) if name in CLOSED else as_table(shipped[name])
        figures: Row = {"pieper": [], "EAIK": []}
        method = ""
        for run in range(max(count, 3)):
            arm = longer(source, 1.0 + 0.01 * np.random.default_rng(run).uniform(-1, 1))
            judge = public_arms._from_table(arm, "")
            q, T = drawn(judge, 1, seed=run)
            text, pose = arm.urdf(), T[0].copy()
            start = time.process_time_ns()
            ours = pieper.load(text)
            answers = ours.ik(pose)
            found = answers.q[answers.valid]
            figures["pieper"].append((time.process_time_ns() - start) * 1e-6)
            errors = arms.pose_errors(judge.forward(found), pose)
            apart = np.abs(np.remainder(found - q[0] + np.pi, 2 * np.pi) - np.pi).max(axis=1)
            assert np.max(errors) < 1e-9
            assert ours.dof == 7 or apart.min() < SAME, (name, run)
            method = ours.ik_info.method
            if name in CLOSED:
                figures["EAIK"].append(1e3 * eaik_from_file(arm, q[0]))
        row = {"arm": name, "method": method, "runs": len(figures["pieper"]), "milliseconds": {}}
        for key, values in figures.items():
            if values:
                row["milliseconds"][key] = {"median": float(np.median(values)), "most": max(values)}
        rows.append(row)
        shown = {key: {k: round(v, 2) for k, v in value.items()} for key, value in row["milliseconds"].items()}
        print(f"{name:20} {method:12} {json.dumps(shown)}", flush=True)
    for name in ("kuka_kr210_robond", GENERAL[0]):
        seconds = ssik_from_file(arms.load(name) if name in CLOSED else as_table(shipped[name]))
        next(row for row in rows if row["arm"] == name)["milliseconds"]["ssik"] = {"once": seconds * 1e3}
        print(f"{name:20} ssik {seconds:.2f} s", flush=True)
    return rows


def longer(arm: arms.Arm, factor: float) -> arms.Arm:
    joints = [{**joint, "xyz": [factor * x for x in joint["xyz"]]} for joint in arm.joints]
    return arms.Arm(arm.name, {"base": arm.base, "tip": arm.tip, "joints": joints})


def as_table(arm: public_arms.Arm) -> arms.Arm:
    """An arm of constant motions as a table of joints, axes along z."""
    from scipy.spatial.transform import Rotation

    joints = []
    for k, constant in enumerate(arm.constants):
        last = k == arm.dof
        joint = {
            "name": f"joint_{k + 1}",
            "type": "fixed" if last else "continuous",
            "parent": f"link_{k}",
            "child": f"link_{k + 1}",
            "xyz": [float(x) for x in constant[:3, 3]],
            "rpy": [float(x) for x in Rotation.from_matrix(constant[:3, :3]).as_euler("xyz")],
            "axis": [0.0, 0.0, 1.0],
        }
        joints.append(joint)
    return arms.Arm(arm.name.replace("/", "_"), {"base": "link_0", "tip": f"link_{arm.dof + 1}", "joints": joints})


def eaik_from_file(arm: arms.Arm, q: np.ndarray) -> float:
    """Processor seconds that EAIK takes from a URDF to its first answers; the pose is one of its own frames."""
    import eaik.IK_URDF

    path = str(arm.urdf_file())
    pose = eaik.IK_URDF.UrdfRobot(path).fwdKin(q)
    start = time.process_time_ns()
    answers = eaik.IK_URDF.UrdfRobot(path).IK(pose)
    assert len(answers.Q)
    return (time.process_time_ns() - start) * 1e-9


def ssik_from_file(arm: arms.Arm) -> float:
    """The same for ssik, without what it kept from earlier runs."""
    from ssik import Manipulator

    os.environ["SSIK_DERIVATION_CACHE"] = "off"
    path = arm.urdf_file()
    _, T = drawn(public_arms._from_table(arm, ""), 1)
    start = time.process_time_ns()
    with contextlib.redirect_stdout(io.StringIO()):
        robot = Manipulator.from_urdf(path, base=arm.base, ee=arm.tip)
        robot.solve(T[0], respect_limits=False)
    return (time.process_time_ns() - start) * 1e-9


def numeric(count: int, rounds: int) -> list[Row]:
    """Targets within limits, one call each from a cold start; percentiles over all calls, by the clock of the process."""
    del rounds
    import pieper

    rows = []
    for name in ("ur5e", "kuka_kr210_robond", "yaskawa_mh12"):
        arm, ours = arms.load(name), pieper.load(name)
        q = arm.sample(count)
        T = np.ascontiguousarray(arm.forward(q))
        calls: dict[str, Callable[[np.ndarray], np.ndarray | None]] = {}

        def iterate(pose: np.ndarray, ours: Any = ours) -> np.ndarray | None:
            answers = ours.ik(pose, method="numeric")
            return answers.q[0] if answers.within_limits[0] else None

        levenberg = numeric_ik.robotics_toolbox(arm, tolerance=1e-20)
        calls["pieper, numeric"] = iterate
        calls["Robotics Toolbox ik_LM, tol 1e-20"] = lambda pose, solve=levenberg: solve(pose, pose)
        poses = [pose.copy() for pose in T]
        answers = {key: [call(pose) for pose in poses] for key, call in calls.items()}
        tasks = {key: paired.Task(call, poses, lambda: None) for key, call in calls.items()}
        timed = paired.each_in_turn(tasks, rounds=3, clock=time.process_time_ns)
        seconds = {key: np.array(value) * 1e6 for key, value in timed.items()}
        row: Row = {"arm": name, "poses": count, "solvers": {}}
        for key, found in answers.items():
            joints = np.array([np.full(arm.dof, np.nan) if one is None else one for one in found])
            distance, angle = arms.pose_errors(arm.forward(np.nan_to_num(joints)), T)
            inside = ~np.isnan(joints[:, 0]) & arm.within_limits(joints, slack=numeric_ik.LIMIT_SLACK)
            row["solvers"][key] = {
                "success": float((inside & (np.maximum(distance, angle) <= 1e-9)).mean()),
                "median_us": float(np.median(seconds[key])),
                "mean_us": float(seconds[key].mean()),
                "p99_us": float(np.percentile(seconds[key], 99)),
            }
            print(f"{name:20} {key:36} {results.rounded(row['solvers'][key])}", flush=True)
        peer, own = (list(np.median(seconds[key], axis=1)) for key in reversed(calls))
        row["times as long"] = paired.ratio(peer, own)
        rows.append(row)
    return rows


PARTS: dict[str, tuple[Callable[[int, int], list[Row]], int]] = {
    "closed": (closed, 1000),
    "singular": (singular, 200),
    "general": (general, 1000),
    "redundant": (redundant, 300),
    "unreachable": (unreachable, 300),
    "load": (load, 21),
    "numeric": (numeric, 10_000),
}
"""Each part with the number of its poses."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of poses")
    options = parser.parse_args()
    paired.pin_to_one_core()
    warnings.simplefilter("ignore")
    from pieper._native import kernels

    exists = (results.RESULTS / "every_solution.json").exists()
    parts = results.load("every_solution")["parts"] if exists else {}
    for name in options.parts:
        measure, count = PARTS[name]
        kernels.use_instruction_set(kernels.instruction_sets()[-1])
        count = max(3, round(options.scale * count))
        parts[name] = {"commit": results.commit(), "rows": results.rounded(measure(count, options.rounds))}
        results.save(
            "every_solution",
            method="one thread; single calls by the clock on the wall, every solver in each round in random order, the "
            f"median of {options.rounds} rounds for each pose, then median and 99th percentile over poses; the rest by processor time: "
            "batches for each pose, iteration over all calls, and what comes before the first answer",
            packages=["EAIK", "ssik", "ur-analytic-ik", "py-opw-kinematics", "roboticstoolbox-python"],
            instruction_sets=kernels.instruction_sets(),
            parts={key: parts[key] for key in PARTS if key in parts},
        )


if __name__ == "__main__":
    main()
