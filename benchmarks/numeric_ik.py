"""How often does a numeric solver find a reachable pose, and how long does it take?

Joint values are drawn evenly between the limits of each built-in arm with six or seven joints; the poses they reach
are the targets. Every solver gets the same poses, one call each, from its own cold start (TRAC-IK wants a start and gets
the joint values of another pose). An answer counts when the judge, a separate forward kinematics, finds position [m]
and rotation [rad] both within the tolerance and every joint within its limits to 1e-8 rad. Time is processor time of the
call, all threads together; what a solver prepares on its first call is told apart.

    python benchmarks/numeric_ik.py [--poses 10000] [--arms ur5e franka_panda ...] [--solvers pieper ...]

The settings of a solver are in its name; how many poses it got is in the data.
"""

import argparse
import time
import warnings
from collections.abc import Callable

import paired  # noqa: F401  (one thread for linear algebra)

# isort: split
import arms
import numpy as np
import results

TOLERANCES = (1e-9, 1e-6, 2e-5)
LIMIT_SLACK = 1e-8
Solve = Callable[[np.ndarray, np.ndarray], "np.ndarray | None"]


def pieper_numeric(arm: arms.Arm) -> Solve:
    import pieper

    ours = pieper.load(arm.name)

    def solve(T: np.ndarray, _: np.ndarray) -> np.ndarray | None:
        answers = ours.ik(T, method="numeric")
        return answers.q[answers.valid][0] if answers.valid.any() else None

    return solve


def trac_ik(arm: arms.Arm, *, tolerance: float, limit: float) -> Solve:
    """TRAC-IK through pytracik: two threads, limited by the clock on the wall."""
    import pytracik
    from scipy.spatial.transform import Rotation

    solver = pytracik.TRAC_IK(arm.base, arm.tip, arm.urdf(), limit, tolerance, pytracik.SolveType.Speed)

    def solve(T: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        answer = pytracik.ik(solver, start, *T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
        return answer[1:] if answer[0] >= 0 else None

    return solve


def robotics_toolbox(arm: arms.Arm, *, tolerance: float) -> Solve:
    """Its compiled Levenberg-Marquardt (Chan's damping, the default) with up to 100 random starts."""
    import roboticstoolbox

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ets = roboticstoolbox.Robot.URDF(str(arm.urdf_file())).ets(start=arm.base, end=arm.tip)

    def solve(T: np.ndarray, _: np.ndarray) -> np.ndarray | None:
        answer = ets.ik_LM(T, tol=tolerance)
        return answer.q if answer.success else None

    return solve


def pinocchio_loop(arm: arms.Arm, *, tolerance: float, starts: int = 30, steps: int = 60) -> Solve:
    """A damped loop around Pinocchio, as its users write one: the library has no such solver.

    Levenberg-Marquardt with Chan's damping, every step clamped to the limits, from random starts.
    """
    import pinocchio

    # Pinocchio keeps two numbers for a continuous joint; as a revolute one with wide limits it keeps one.
    model = pinocchio.buildModelFromXML(arm.urdf(continuous=False))
    data, tip = model.createData(), model.getFrameId(arm.tip)
    lower, upper = arm.bounds.T
    random = np.random.default_rng(0)
    first, last = arm.limits.T
    identity = np.eye(arm.dof)

    def solve(T: np.ndarray, _: np.ndarray) -> np.ndarray | None:
        target = pinocchio.SE3(T)
        for _ in range(starts):
            q = random.uniform(first, last)
            for _ in range(steps):
                pinocchio.framesForwardKinematics(model, data, q)
                difference = data.oMf[tip].actInv(target)
                error = pinocchio.log6(difference).vector
                if np.abs(error).max() < tolerance:
                    return q
                J = pinocchio.Jlog6(difference.inverse()) @ pinocchio.computeFrameJacobian(model, data, q, tip)
                damping = 0.5 * (error @ error) + 1e-12
                q = np.clip(q + np.linalg.solve(J.T @ J + damping * identity, J.T @ error), lower, upper)
        return None

    return solve


SOLVERS: dict[str, tuple[Callable[[arms.Arm], Solve], int]] = {
    "pieper": (pieper_numeric, 10_000),
    "TRAC-IK, eps 1e-5 (default), 5 ms": (lambda arm: trac_ik(arm, tolerance=1e-5, limit=0.005), 10_000),
    "TRAC-IK, eps 1e-10, 5 ms": (lambda arm: trac_ik(arm, tolerance=1e-10, limit=0.005), 2_000),
    "TRAC-IK, eps 1e-10, 50 ms": (lambda arm: trac_ik(arm, tolerance=1e-10, limit=0.05), 1_000),
    "Robotics Toolbox ik_LM, tol 1e-20": (lambda arm: robotics_toolbox(arm, tolerance=1e-20), 10_000),
    "Pinocchio, a loop in Python": (lambda arm: pinocchio_loop(arm, tolerance=5e-10), 500),
}
"""Each solver with the most poses it is given."""


def measure(arm: arms.Arm, build: Callable[[arms.Arm], Solve], poses: int) -> dict[str, object]:
    """Solve for the first so many poses of the arm's sample and judge the answers."""
    q = arm.sample(poses)
    targets = arm.forward(q)
    starts = arm.sample(poses, seed=1)
    solve = build(arm)
    before = time.process_time_ns()
    solve(targets[0], starts[0])
    first_call = time.process_time_ns() - before
    answers = np.full((poses, arm.dof), np.nan)
    microseconds = np.empty(poses)
    for i, (T, start) in enumerate(zip(targets, starts, strict=True)):
        before = time.process_time_ns()
        answer = solve(T, start)
        microseconds[i] = (time.process_time_ns() - before) * 1e-3
        if answer is not None:
            answers[i] = answer

    claimed = ~np.isnan(answers[:, 0])
    distance, angle = arms.pose_errors(arm.forward(np.nan_to_num(answers)), targets)
    inside = claimed & arm.within_limits(answers, slack=LIMIT_SLACK)
    error = np.where(claimed, np.maximum(distance, angle), np.inf)
    return {
        "poses": poses,
        "claimed": float(claimed.mean()),
        "missed": int((~inside | (error > TOLERANCES[0])).sum()),
        "success": {f"{tolerance:g}": float((inside & (error <= tolerance)).mean()) for tolerance in TOLERANCES},
        "median_us": float(np.median(microseconds)),
        "mean_us": float(microseconds.mean()),
        "p99_us": float(np.percentile(microseconds, 99)),
        "first_call_ms": first_call * 1e-6,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000, help="the most poses per arm")
    parser.add_argument("--arms", nargs="*", default=arms.names())
    parser.add_argument("--solvers", nargs="*", default=list(SOLVERS), help="names, or how they begin")
    options = parser.parse_args()

    solvers = {name: SOLVERS[name] for name in SOLVERS if name.startswith(tuple(options.solvers))}
    previous = results.load("numeric_ik") if (results.RESULTS / "numeric_ik.json").exists() else {"rows": []}
    rows = [row for row in previous["rows"] if not (row["arm"] in options.arms and row["solver"] in solvers)]
    for name in options.arms:
        arm = arms.load(name)
        for solver, (build, most) in solvers.items():
            figures = results.rounded(measure(arm, build, min(options.poses, most)), 5)
            rows.append({"arm": name, "dof": arm.dof, "solver": solver, **figures})
            success = "  ".join(f"{tolerance}: {share:.4f}" for tolerance, share in figures["success"].items())
            print(
                f"{name:28} {solver:36} {success}   median {figures['median_us']:8.1f} us"
                f"   p99 {figures['p99_us']:9.1f} us   n = {figures['poses']}",
                flush=True,
            )
    rows.sort(key=lambda row: (row["arm"], list(SOLVERS).index(row["solver"])))
    results.save(
        "numeric_ik",
        method="random joint values within limits (continuous joints within half a turn), cold start, one call per "
        "pose, processor time of all threads; judged by a separate forward kinematics, limits to 1e-8 rad",
        packages=["pin", "roboticstoolbox-python", "pytracik"],
        rows=rows,
    )


if __name__ == "__main__":
    main()
