"""The figure of docs/derivations/general_6r.md: the determinant of one pose, its real roots, and its harmonics.

    python native/derivations/degree_8_polynomial.py

Drawn from the slow, independent implementation of the tests; the lines at the roots are answers of the compiled solver.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from pieper.ik.general_6r import solve_general_6r  # noqa: E402
from pieper.model import catalog  # noqa: E402
from tests.reference import determinant_polynomial as slow  # noqa: E402

INK, FAINT, CARD, BLUE, ORANGE = "#1f2328", "#8b949e", "#fbfbfa", "#0072b2", "#d55e00"
REMAINING = 1  # joint 2


def pose_with_most_answers(chain, tries=3000):
    """The pose among random ones with the most answers, whose angles of the remaining joint are well apart."""
    rng = np.random.default_rng(7)
    T = chain.native.fk(rng.uniform(-np.pi, np.pi, (tries, 6)))
    answers = solve_general_6r(chain, T, mode="complete")
    best, best_gap = 0, -1.0
    for k in np.flatnonzero(answers.count == answers.count.max()):
        angles = np.sort(answers.q[k][answers.valid[k]][:, REMAINING])
        gap = np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).min()
        if gap > best_gap:
            best, best_gap = int(k), float(gap)
    return T[best], np.sort(answers.q[best][answers.valid[best]][:, REMAINING])


def offset_of(chain, T, wanted):
    """What the remaining angle is off by, because the slow implementation has its own zero."""
    roots = slow.roots(chain, T, REMAINING)
    shifts = [np.remainder(roots[0] - w, 2.0 * np.pi) for w in wanted]

    def misfit(shift):
        moved = np.remainder(wanted + shift + np.pi, 2.0 * np.pi) - np.pi
        return np.abs(np.sort(moved) - roots).max() if len(roots) == len(moved) else np.inf

    return min(shifts, key=misfit), min(map(misfit, shifts))


def main() -> None:
    chain = catalog.describe("crx10ia").chain()
    T, wanted = pose_with_most_answers(chain)
    shift, misfit = offset_of(chain, T, wanted)
    angles = np.linspace(-np.pi, np.pi, 1441)
    values = slow.determinants(chain, T, REMAINING, angles + shift)
    values = values / np.abs(values).max()
    harmonics = np.abs(slow.spectrum(chain, T, REMAINING))
    middle = len(harmonics) // 2
    print(f"{len(wanted)} answers; roots of both implementations agree to {misfit:.1e} rad")
    print("beyond the eighth harmonic:", np.abs(harmonics[middle + 9 :]).max())

    mpl.rcParams.update(
        {
            "figure.facecolor": CARD, "axes.facecolor": CARD, "savefig.facecolor": CARD, "text.color": INK,
            "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK, "axes.edgecolor": FAINT,
            "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left", "axes.titlesize": 11,
            "axes.titleweight": "bold", "svg.fonttype": "path", "svg.hashsalt": "pieper",
        }
    )  # fmt: skip
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), width_ratios=(2, 1), layout="constrained")
    left.axhline(0.0, color=FAINT, linewidth=0.8)
    left.plot(np.degrees(angles), values, color=BLUE, linewidth=1.6)
    left.plot(np.degrees(wanted), np.zeros(len(wanted)), "o", color=ORANGE, markersize=6, zorder=3)
    left.set_xticks(range(-180, 181, 60))
    left.set_xlabel("angle of joint 2 [deg]")
    left.set_ylabel("determinant, of its largest value")
    left.set_title(f"FANUC CRX-10iA, one pose: {len(wanted)} real roots are its {len(wanted)} answers")

    k = np.arange(13)
    size = np.maximum(harmonics[middle : middle + 12], 1e-18)
    size = np.append(size, max(harmonics[0], 1e-18))
    right.bar(k[:9], size[:9], color=BLUE, bottom=1e-18)
    right.bar(k[9:], size[9:], color=FAINT, bottom=1e-18)
    right.set_yscale("log")
    right.set_ylim(1e-18, 3.0)
    right.set_xticks(k)
    right.set_xlabel("harmonic")
    right.set_ylabel("size, of the largest sample")
    right.set_title("Nothing beyond the eighth")
    right.annotate("rounding", (10.5, size[9:].max()), (0, 6), textcoords="offset points", ha="center", color=INK)
    figure.savefig(ROOT / "docs" / "images" / "degree_8_polynomial.svg", metadata={"Date": None})
    if len(sys.argv) > 1:
        figure.savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()
