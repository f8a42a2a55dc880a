"""What does the general solver do with arms that no one would build?

Arms with coincident, parallel, zero-length and nearly equal axes (1e-12 to 1e-3 rad and m apart), every second one with a
slide. Most have fewer than six degrees of freedom, so that solutions form curves everywhere. Their own joints make the
poses, at random and at multiples of 90 degrees. Counted are targets left empty, false answers (by the judge of
`general_recall.py`), and regular joints that are not among the answers, with and without a doubt.

    python benchmarks/degenerate_arms.py [--arms 1000] [--poses 20]
"""

import argparse
import time

import general_recall
import numpy as np
import results
from rich.progress import track

from pieper.ik.general_6r import Flag, solve_general_6r
from pieper.kinematics.jacobian import jacobian
from pieper.model.chain import Chain

QUESTION = "degenerate_arms"
REGULAR = 1e-3  # least singular value of the Jacobian
ACCURACY = 1e-9  # m and rad


def hostile_arm(seed: int) -> Chain:
    """Links of five kinds, drawn at random."""
    rng = np.random.default_rng(seed)
    near = 10.0 ** rng.uniform(-12, -3)
    links = []
    for kind in rng.integers(0, 5, 6):
        theta, d = rng.choice([0, np.pi / 2, 0.7]), rng.choice([0, 0, 0.2])
        a, alpha = rng.choice([0, 0, 0.3, 0.5]), rng.choice([0, np.pi / 2, -np.pi / 2, np.pi])
        if kind == 0:
            d = a = alpha = 0.0
        elif kind == 1:
            alpha += near
        elif kind == 2:
            a, alpha = rng.uniform(-0.5, 0.5), rng.uniform(-np.pi, np.pi)
        elif kind == 3:
            a += near
        links.append(general_recall.dh(theta, d, a, alpha))
    return general_recall.from_links(f"hostile {seed}", links, slide=seed // 2 % 6 if seed % 2 else -1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=1000)
    parser.add_argument("--poses", type=int, default=20, help="of each kind and arm")
    chosen = parser.parse_args()
    figures = dict.fromkeys(("poses", "empty", "false", "regular", "lost", "lost_without_doubt", "doubtful"), 0)
    slowest = 0.0
    for seed in track(range(chosen.arms), description="arms"):
        arm = hostile_arm(seed)
        rng = np.random.default_rng([1, seed])
        for grid in (False, True):
            q = rng.integers(-2, 3, (chosen.poses, 6)) * np.pi / 2
            if not grid:
                q = rng.uniform(-np.pi, np.pi, (chosen.poses, 6))
            slides = ~arm.is_revolute
            q[:, slides] = rng.uniform(-0.5, 1.0, (chosen.poses, slides.sum()))
            T = general_recall.forward(arm, q)
            begun = time.perf_counter()
            answers = solve_general_6r(arm, T)
            slowest = max(slowest, (time.perf_counter() - begun) / len(q))
            valid = answers.q[answers.valid]
            off = np.abs(general_recall.forward(arm, valid) - np.repeat(T, answers.count, axis=0))
            doubtful = (answers.flags & Flag.doubtful) != 0
            regular = np.linalg.svd(jacobian(arm, q), compute_uv=False)[:, -1] > REGULAR
            lost = regular & (general_recall.distance(arm, answers.q, q[:, None]).min(axis=1) > 1e-5)
            for name, what in (
                ("poses", np.ones(len(q))),
                ("empty", ~answers.valid.any(axis=1)),
                ("false", off.max(axis=(1, 2), initial=0.0) > ACCURACY),
                ("regular", regular),
                ("lost", lost),
                ("lost_without_doubt", lost & ~doubtful),
                ("doubtful", doubtful),
            ):
                figures[name] += int(what.sum())
    print(figures, f"slowest batch {1e3 * slowest:.1f} ms a pose")
    results.save(
        QUESTION, method=str(__doc__), packages=[], arms=chosen.arms, figures=figures, slowest_ms=1e3 * slowest
    )


if __name__ == "__main__":
    main()
