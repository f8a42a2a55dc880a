"""How long does the report's loop take, and how long do we?

The report solves the position of an MH12 (five screws, joint 4 held) from zero angles with

    theta <- theta + 0.06 pinv(J) e,   e = target - p(theta),   pinv(J) = J^T (J J^T)^-1,   255 times,

and in every iteration puts numbers into the SymPy expressions of p and J. That loop is written here again; a few of its
iterations are timed, the rest is extrapolated, or with --full all are run. Beside it: the same rule in pieper.ik.iteration, which
has to give the same angles, and our solver from the same start, to 1e-9 m.

    python benchmarks/report_loop.py [--iterations 5 | --full]
"""

import argparse
import json
import statistics
import time

import paired

# isort: split
import arms
import numpy as np
import results

TARGET = np.array([0.3, 0.3, 0.3])
SHIFT = np.array([0.0003, 0.0003, 0.0004])  # the report moves each target away from zero by so much
STEP, ITERATIONS = 0.06, 255
PRECISION = 1e-9  # metres


class Symbolic:
    """Position and its Jacobian as SymPy expressions, from the screws the report prints."""

    def __init__(self, table: dict) -> None:
        import sympy

        self.theta = sympy.symbols(f"theta1:{len(table['screws']) + 1}")
        T = sympy.eye(4)
        for angle, screw in zip(self.theta, table["screws"], strict=True):
            T = T * self._exponential(sympy, screw["axis"], screw["point"], angle)
        home = sympy.Matrix([*table["home"]["position"], 1.0])
        self.position = (T * home)[:3, 0]
        self.jacobian = self.position.jacobian(self.theta)

    @staticmethod
    def _exponential(sympy: object, axis: list[float], point: list[float], angle: object) -> object:
        """The turn about an axis through a point, 4x4 (Rodrigues)."""
        x, y, z = axis
        K = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        R = sympy.eye(3) + sympy.sin(angle) * K + (1 - sympy.cos(angle)) * K * K
        centre = sympy.Matrix(point)
        return R.row_join(centre - R * centre).col_join(sympy.Matrix([[0, 0, 0, 1]]))

    def at(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers put into both, element by element, as the report does."""
        values = dict(zip(self.theta, theta.tolist(), strict=True))
        position = np.array(self.position.subs(values).evalf(), dtype=float)[:, 0]
        return position, np.array(self.jacobian.subs(values).evalf(), dtype=float)


def step(theta: np.ndarray, position: np.ndarray, J: np.ndarray, target: np.ndarray) -> np.ndarray:
    return theta + STEP * (J.T @ np.linalg.inv(J @ J.T)) @ (target - position)


def report(symbolic: Symbolic, target: np.ndarray, iterations: int) -> tuple[np.ndarray, list[float]]:
    """The angles after so many iterations, and the processor seconds of each."""
    theta, seconds = np.zeros(len(symbolic.theta)), []
    for _ in range(iterations):
        start = time.process_time()
        theta = step(theta, *symbolic.at(theta), target)
        seconds.append(time.process_time() - start)
    return theta, seconds


def same_rule(arm: object, iterations: int) -> np.ndarray:
    """The same rule as the package offers it: the angles after so many steps."""
    from pieper.ik import iteration

    start = np.zeros(arm.dof)
    return iteration.run(arm.chain, TARGET, start, alpha=STEP, iterations=iterations, target_offset=SHIFT).q


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=5, help="of the SymPy loop; the others are extrapolated")
    parser.add_argument("--full", action="store_true", help="run all of them")
    parser.add_argument("--rounds", type=int, default=21)
    options = parser.parse_args()
    paired.pin_to_one_core()
    iterations = ITERATIONS if options.full else options.iterations

    import pieper
    from pieper.ik.target import ignore_orientation

    symbolic = Symbolic(json.loads((arms.TABLES / "mh12-report.json").read_text()))
    target = TARGET + SHIFT
    theta, seconds = report(symbolic, target, iterations)
    sympy_loop = sum(seconds) + statistics.median(seconds) * (ITERATIONS - iterations)

    five, six = pieper.load("mh12-report"), pieper.load("mh12")
    difference = float(np.abs(same_rule(five, iterations) - theta).max())
    assert difference < 1e-12
    last = same_rule(five, ITERATIONS)
    goals = {
        "the report's five joints": (five, ignore_orientation(target)),
        "all six": (six, ignore_orientation(TARGET)),
    }
    judge = arms.load("yaskawa_mh12")
    for arm, goal in goals.values():
        answer = arm.ik(goal)
        assert answer.valid.any()
        assert answer.position_error[answer.valid].max() <= PRECISION
    found = judge.forward(six.ik(goals["all six"][1]).q[:1])[0, :3, 3]
    assert np.linalg.norm(found - TARGET) <= PRECISION

    zeros = {name: np.zeros(arm.dof) for name, (arm, _) in goals.items()}
    statements = {
        "pieper.ik.iteration, the same rule, 255 steps": (
            "loop(arm, n)",
            {"loop": same_rule, "arm": five, "n": ITERATIONS},
        ),
    }
    for name, (arm, goal) in goals.items():
        names = {"arm": arm, "goal": goal, "zeros": zeros[name]}
        statements[f"pieper, to 1e-9 m, {name}, from zero angles"] = ("arm.ik(goal, seed=zeros)", names)
        statements[f"pieper, to 1e-9 m, {name}, no starting angles"] = ("arm.ik(goal)", names)
    timed = paired.calls_in_turn(statements, rounds=options.rounds)

    error = np.linalg.norm(target - five.fk(last)[:3, 3])
    measured = "all measured" if options.full else f"{iterations} measured, the rest extrapolated from their median"
    rows = [
        {"name": f"SymPy loop, {ITERATIONS} steps", "nanoseconds": {"median": sympy_loop * 1e9}, "remark": measured}
    ]
    for name, values in timed.items():
        remark = f"leaves {error:.1e} m, as the report's does" if "rule" in name else "position only"
        rows.append(
            {"name": name, "nanoseconds": paired.quartiles([value * 1e9 for value in values]), "remark": remark}
        )
    ratios = {f"SymPy loop / {name}": sympy_loop / statistics.median(values) for name, values in timed.items()}
    for row in rows:
        print(f"{row['name']:60} {row['nanoseconds']['median'] / 1e9:14.9f} s   {row['remark']}")
    for name, value in ratios.items():
        print(f"{name:75} {value:12.0f}")
    print(
        f"angles after {iterations} steps differ by {difference:.1e} rad; after {ITERATIONS}: {last.round(6).tolist()}"
    )
    results.save(
        "report_loop",
        method="one thread, processor time; SymPy's expressions are written straight from the screws and not simplified, which "
        "is quicker than what the report describes",
        packages=["sympy"],
        rows=results.rounded(rows),
        ratios=results.rounded(ratios),
        sympy_seconds_per_step=results.rounded(paired.quartiles(seconds)),
        sympy_steps_measured=iterations,
        steps_compared=iterations,
        largest_difference_rad=difference,
        theta_after_255=last.tolist(),
    )


if __name__ == "__main__":
    main()
