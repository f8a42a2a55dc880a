"""How long does the report's loop take, and how long do we?

The report solves the position of an MH12 (five screws, joint 4 held) from zero angles with

    theta <- theta + 0.06 pinv(J) e,   e = target - p(theta),   pinv(J) = J^T (J J^T)^-1,   255 times,

and in every iteration puts numbers into the SymPy expressions of p and J. That loop is written here again; a few of its
iterations are timed, the rest is extrapolated, or with --full all are run. Beside it: the same rule with our kernels, which
has to give the same angles, and our solver from the same start, to 1e-9 m.

    python benchmarks/report_loop.py [--iterations 5 | --full]
"""

import argparse
import json
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


if __name__ == "__main__":
    table = json.loads((arms.TABLES / "mh12-report.json").read_text())
    t = time.process_time()
    s = Symbolic(table)
    print("build", time.process_time() - t)
    theta, sec = report(s, TARGET + SHIFT, 5)
    print(theta, sec)
