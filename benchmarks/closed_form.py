"""What does every inverse solution of a pose cost, for arms with a closed form?

Poses are those of joint values drawn evenly from a whole turn; each solver gets the same ones, one call each and as a batch.
EAIK ignores the rotation of the tip at rest, so it is given poses with that taken off. An answer counts when the judge, a
separate forward kinematics, finds it within 1e-6 [m and rad]; recall is the share of poses whose own joint values are
among the answers.

    python benchmarks/closed_form.py [--poses 500] [--rounds 25]
"""

import argparse
from collections.abc import Callable

import paired

# isort: split
import arms
import numpy as np
import results

NAMES = ("ur5e", "kuka_kr210_robond", "yaskawa_mh12", "kuka_youbot")
GOOD = 1e-6
SAME = 1e-5
Candidates = dict[str, tuple[Callable[[], object], Callable[[], object], list[np.ndarray]]]


def candidates(name: str, T: np.ndarray) -> Candidates:
    """One call each, a batch, and the answers, by solver."""
    import eaik.IK_HP

    from pieper.ik.closed_form import solve_closed_form
    from pieper.ik.family import find_family
    from pieper.model import catalog

    chain = catalog.describe(name).chain()
    family = find_family(chain)
    singly = [pose.copy() for pose in T]
    ours = solve_closed_form(chain, family, T)

    w, points = chain.screws[:, 3:], np.cross(chain.screws[:, 3:], chain.screws[:, :3])
    steps, at = [], np.zeros(3)
    for direction, point in zip(w, points, strict=True):  # the point of each axis nearest to the one before
        foot = point + direction * (direction @ (at - point))
        steps.append(foot - at)
        at = foot
    steps.append(chain.home[:3, 3] - at)
    peer = eaik.IK_HP.HPRobot(w, np.array(steps))
    at_rest = np.eye(4)
    at_rest[:3, :3] = chain.home[:3, :3].T
    theirs = [np.ascontiguousarray(pose @ at_rest) for pose in T]

    def each(solve: Callable[[np.ndarray], object], poses: list[np.ndarray]) -> Callable[[], None]:
        def run() -> None:
            for pose in poses:
                solve(pose)

        return run

    return {
        "pieper": (
            each(lambda pose: solve_closed_form(chain, family, pose), singly),
            lambda: solve_closed_form(chain, family, T),
            [q[valid] for q, valid in zip(ours.q, ours.valid, strict=True)],
        ),
        "EAIK": (
            each(peer.IK, theirs),
            lambda: peer.IK_batched(theirs),
            [np.reshape(answer.Q, (-1, chain.dof)) for answer in peer.IK_batched(theirs)],
        ),
    }


def judged(arm: arms.Arm, q: np.ndarray, T: np.ndarray, answers: list[np.ndarray]) -> dict[str, float]:
    """Answers per pose that hold, the worst of them, and the share of poses whose joint values are there."""
    good, worst, found = 0, 0.0, 0
    for joints, pose, several in zip(q, T, answers, strict=True):
        errors = np.abs(arm.forward(several) - pose).max(axis=(1, 2)) if len(several) else np.empty(0)
        holds = errors < GOOD
        good += int(holds.sum())
        worst = max(worst, float(errors[holds].max(initial=0.0)))
        apart = np.abs(np.remainder(several[holds] - joints + np.pi, 2 * np.pi) - np.pi).max(axis=-1, initial=0.0)
        found += bool((apart < SAME).any())
    return {"answers_per_pose": good / len(q), "worst_error": worst, "recall": found / len(q)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=25)
    options = parser.parse_args()
    paired.pin_to_one_core()

    rows = []
    for name in NAMES:
        arm = arms.load(name)
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (options.poses, arm.dof))
        T = np.ascontiguousarray(arm.forward(q))
        solvers = candidates(name, T)
        row: dict[str, object] = {"arm": name}
        for way, index in (("one call", 0), ("batch", 1)):
            seconds = paired.in_turn({key: item[index] for key, item in solvers.items()}, rounds=options.rounds)
            row[way] = {
                "microseconds": {
                    key: paired.quartiles([value / options.poses * 1e6 for value in values])
                    for key, values in seconds.items()
                },
                "EAIK / pieper": paired.ratio(seconds["EAIK"], seconds["pieper"]),
            }
        row["quality"] = {key: judged(arm, q, T, item[2]) for key, item in solvers.items()}
        rows.append(row)
        for way in ("one call", "batch"):
            times = {key: value["median"] for key, value in row[way]["microseconds"].items()}  # type: ignore[index]
            ratio = row[way]["EAIK / pieper"]["median"]  # type: ignore[index]
            print(
                f"{name:20} {way:9} pieper {times['pieper']:7.3f} us  EAIK {times['EAIK']:7.3f} us  {ratio:5.1f} times"
            )

    results.save(
        "closed_form",
        method=f"{options.poses} poses, one thread, processor time, {options.rounds} rounds in turn, medians, per pose",
        packages=["EAIK"],
        rows=results.rounded(rows),
    )


if __name__ == "__main__":
    main()
