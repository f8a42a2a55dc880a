"""Does the general solver lose anything, arm by arm, and how long does a pose take?

Random joints within a half turn either way (a slide within its limits) make a pose; they have to be among the answers. Every
answer is judged by a forward kinematics written here. Poses go in rounds, and the figures of every round are kept, so that
a run that was stopped goes on where it was.

    python benchmarks/general_recall.py [--poses 1000000] [--mode checked] [--arms ur5e puma560 ...] [--again]
"""

import argparse
import gzip
import json
import time

import paired

# isort: split
import numpy as np
import results
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pieper._native import kernels
from pieper.ik.general_6r import Flag, prepare, solve_general_6r
from pieper.model import catalog
from pieper.model.chain import Chain

QUESTION = "general_recall"
ROUND = 20_000
BLOCK = 1_000  # poses that the judge takes at once: they stay in the cache
SAME = 1e-6  # rad or m
TIMED = 3_000
ORACLE = results.HERE.parent / "tests" / "golden" / "ik_oracle.json.gz"
FROM_ORACLE = {"hc10": "a169", "m0609": "a170"}  # arms that the fixture of proved cases carries


def euler(rpy: list[float]) -> np.ndarray:
    """The rotation of a URDF origin."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def from_links(name: str, links: list, *, slide: int = -1) -> Chain:
    """The chain Rz(q1) L1 ... Rz(q6) L6, with Tz in place of one Rz."""
    T = np.eye(4)
    screws = []
    for i, link in enumerate(links):
        z, p = T[:3, 2], T[:3, 3]
        screws.append(np.concatenate([z, 0 * z] if i == slide else [np.cross(p, z), z]))
        T = T @ np.asarray(link)
    limits = [[-0.5, 1.0] if i == slide else [-np.pi, np.pi] for i in range(6)]
    return Chain(name, screws, T, limits, [f"joint_{i + 1}" for i in range(6)])


def dh(theta: float, d: float, a: float, alpha: float) -> np.ndarray:
    """A classical Denavit-Hartenberg link at zero."""
    (ct, ca), (st, sa) = np.cos([theta, alpha]), np.sin([theta, alpha])
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def jaco2() -> Chain:
    """Kinova JACO2, six joints, curved wrist, from the table of its user guide."""
    d1, d2, d3, d4, d5, d6, e2, half = 0.2755, 0.41, 0.2073, 0.0741, 0.0741, 0.16, 0.0098, np.pi / 6
    part = np.sin(half) / np.sin(2 * half)
    rows = [
        (0, d1, 0, np.pi / 2),
        (0, 0, d2, np.pi),
        (0, -e2, 0, np.pi / 2),
        (0, -(d3 + part * d4), 0, 2 * half),
        (0, -part * (d4 + d5), 0, 2 * half),
        (0, -(part * d5 + d6), 0, np.pi),
    ]
    return from_links("jaco2", [dh(*row) for row in rows])


def piper() -> Chain:
    """AgileX PiPER as its URDF has it: a wrist whose axes miss each other by 0.09 mm, right angles of five digits."""
    origins = [
        ([0, 0, 0], [1.5708, -0.1359, -3.1416]),
        ([0.28503, 0, 0], [0, 0, -1.7939]),
        ([-0.021984, -0.25075, 0], [1.5708, 0, 0]),
        ([0, 0, 0], [-1.5708, 0, 0]),
        ([8.8259e-05, -0.091, 0], [1.5708, 0, 0]),
    ]
    links = [np.eye(4) for _ in range(6)]
    for link, (xyz, rpy) in zip(links, origins, strict=False):
        link[:3, :3], link[:3, 3] = euler(rpy), xyz
    return from_links("piper", links)


def sixteen() -> Chain:
    """The arm with sixteen real answers of Manocha and Zhu (1994), after Wampler and Morgan."""
    right, one = np.pi / 2, np.pi / 180
    rows = [
        (0, 0, 0.3, right),
        (0, 0, 1, one),
        (0, 0.2, 0, right),
        (0, 0, 1.5, one),
        (0, 0, 0, right),
        (0, 0, 0, one),
    ]
    return from_links("sixteen answers", [dh(*row) for row in rows])


def random_arm(seed: int, *, slide: int = -1) -> Chain:
    """Links drawn at random, the numbers of the test suite."""
    rng = np.random.default_rng(seed)
    links = []
    for _ in range(6):
        twist, a, d = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)
        links.append(dh(0, d, a, twist))
    return from_links(f"random {seed}" + (f", slide {slide + 1}" if slide >= 0 else ""), links, slide=slide)


def calibrated(name: str, size: float, seed: int) -> Chain:
    """A built-in arm with every axis displaced and turned by random amounts [m, rad] of a size."""
    arm = catalog.describe(name).chain()
    rng = np.random.default_rng(seed)
    screws = arm.screws + size * rng.normal(size=(6, 6))
    w = screws[:, 3:] / np.linalg.norm(screws[:, 3:], axis=1, keepdims=True)
    v = screws[:, :3] - w * (w * screws[:, :3]).sum(axis=1, keepdims=True)
    return Chain(f"{name}, off by {size:.0e}", np.hstack([v, w]), arm.home, arm.limits, arm.joint_names)


def arms() -> dict[str, Chain]:
    """Every arm of the table."""
    built_in = [catalog.describe(name).chain() for name in catalog.names()]
    chains = [chain for chain in built_in if len(chain.screws) == 6 and chain.is_revolute.all()]
    with gzip.open(ORACLE) as file:
        fixture = json.load(file)["arms"]
    chains += [jaco2(), piper(), sixteen()]
    chains += [from_links(name, fixture[key]["links"]) for name, key in FROM_ORACLE.items()]
    chains += [random_arm(seed) for seed in range(4)]
    chains += [random_arm(10 + slide, slide=slide) for slide in range(6)]
    for size in (1e-6, 1e-5, 1e-4, 1e-3):
        chains += [calibrated(name, size, 5) for name in ("kuka_kr210_robond", "puma560")]
    return {chain.name: chain for chain in chains}


def forward(arm: Chain, q: np.ndarray) -> np.ndarray:
    """The judge: axis after axis turns the columns of the home pose about itself (Rodrigues); (count, 6) to (count, 4, 4)."""
    if len(q) > BLOCK:
        return np.concatenate([forward(arm, q[k : k + BLOCK]) for k in range(0, len(q), BLOCK)])
    columns = np.repeat(arm.home[:3].T[..., None], len(q), axis=2).transpose(1, 0, 2).copy()  # xyz, column, pose
    for screw, value in zip(arm.screws[::-1], q.T[::-1], strict=True):
        v, w = screw[:3], screw[3:]
        if not w.any():
            columns[:, 3] += v[:, None] * value
            continue
        point = np.cross(w, v)[:, None]
        x, y, z = w
        W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        columns[:, 3] -= point
        once = (W @ columns.reshape(3, -1)).reshape(columns.shape)
        twice = (W @ once.reshape(3, -1)).reshape(columns.shape)
        columns += np.sin(value) * once + (1 - np.cos(value)) * twice
        columns[:, 3] += point
    T = np.zeros((len(q), 4, 4))
    T[:, :3], T[:, 3, 3] = columns.transpose(2, 0, 1), 1
    return T


def distance(arm: Chain, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Largest difference of a joint, modulo whole turns of those that turn; infinite for rows of NaN."""
    apart = q - wanted
    apart = np.where(arm.is_revolute, (apart + np.pi) % (2 * np.pi) - np.pi, apart)
    apart = np.abs(apart).max(axis=-1)
    return np.where(np.isnan(apart), np.inf, apart)


def one_round(arm: Chain, mode: str, seed: int, count: int) -> dict:
    """Figures of some poses."""
    rng = np.random.default_rng([7, seed])
    q = rng.uniform(-np.pi, np.pi, (count, 6))
    slides = np.flatnonzero(~arm.is_revolute)
    q[:, slides] = rng.uniform(*arm.limits[slides].T, (count, len(slides)))
    T = forward(arm, q)
    answers = solve_general_6r(arm, T, mode=mode)
    nearest = distance(arm, answers.q, q[:, None]).min(axis=1)
    doubtful = (answers.flags & Flag.doubtful) != 0
    valid = answers.q[answers.valid]
    off = forward(arm, valid)
    off -= np.repeat(T, answers.valid.sum(axis=1), axis=0)
    turned = np.sqrt(np.einsum("kij,kij->k", off[:, :3, :3], off[:, :3, :3]) / 2)  # the angle, when it is small
    lost = np.flatnonzero(nearest > SAME)
    return {
        "poses": count,
        "answers": len(valid),
        "most": int(answers.valid.sum(axis=1).max()),
        "empty": int((~answers.valid.any(axis=1)).sum()),
        "doubtful": int(doubtful.sum()),
        "position_error": float(np.sqrt((off[:, :3, 3] ** 2).sum(axis=1)).max(initial=0.0)),
        "rotation_error": float(turned.max(initial=0.0)),
        "lost": [
            {"q": q[k].tolist(), "nearest": float(nearest[k]), "doubtful": bool(doubtful[k])} for k in lost.tolist()
        ],
    }


def times(arm: Chain) -> dict:
    """Median and 99th percentile of a call for one pose, least of three, and the time of a pose in a batch [us]."""
    solver = prepare(arm).native
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (TIMED, 6))
    slides = np.flatnonzero(~arm.is_revolute)
    q[:, slides] = np.random.default_rng(2).uniform(*arm.limits[slides].T, (TIMED, len(slides)))
    T = forward(arm, q)
    found: dict = {}
    before = kernels.instruction_set()
    for instructions in (name for name in kernels.instruction_sets() if name.startswith("avx")):
        kernels.use_instruction_set(instructions)
        for mode in ("fast", "checked"):
            chosen = kernels.GeneralMode[mode]
            least = np.full(TIMED, np.inf)
            whole = np.inf
            for _ in range(3):
                for k in range(TIMED):
                    begun = time.perf_counter_ns()
                    solver.solve(T[k], chosen, 1)
                    least[k] = min(least[k], time.perf_counter_ns() - begun)
                begun = time.perf_counter_ns()
                solver.solve(T, chosen, 1)
                whole = min(whole, time.perf_counter_ns() - begun)
            row = {"median": np.median(least), "p99": np.percentile(least, 99), "batch": whole / TIMED}
            found[f"{instructions} {mode}"] = {key: float(value) / 1e3 for key, value in row.items()}
    kernels.use_instruction_set(before)
    return found


def preparation(arm: Chain) -> float:
    """Milliseconds to prepare an arm, least of three."""
    least = np.inf
    for _ in range(3):
        copy = Chain(arm.name, arm.screws, arm.home, arm.limits, arm.joint_names)
        begun = time.perf_counter()
        prepare(copy)
        least = min(least, time.perf_counter() - begun)
    return 1e3 * least


def total(rounds: list[dict]) -> dict:
    """The figures of an arm."""
    lost = [pose for part in rounds for pose in part["lost"]]
    poses = sum(part["poses"] for part in rounds)
    return {
        "poses": poses,
        "lost": len(lost),
        "lost_without_doubt": sum(not pose["doubtful"] for pose in lost),
        "empty": sum(part["empty"] for part in rounds),
        "doubtful": sum(part["doubtful"] for part in rounds) / poses,
        "answers": sum(part["answers"] for part in rounds) / poses,
        "most_answers": max(part["most"] for part in rounds),
        "position_error": max(part["position_error"] for part in rounds),
        "rotation_error": max(part["rotation_error"] for part in rounds),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--mode", default="checked", choices=["fast", "checked", "complete"])
    parser.add_argument("--arms", nargs="*", help="some of them")
    parser.add_argument("--again", action="store_true", help="forget earlier rounds")
    chosen = parser.parse_args()
    paired.pin_to_one_core()
    all_arms = arms()
    names = chosen.arms or list(all_arms)
    path = results.RESULTS / f"{QUESTION}.json"
    rows: dict = {} if chosen.again or not path.exists() else results.load(QUESTION)["arms"]
    columns = (TextColumn("{task.description:>28}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        for name in names:
            arm = all_arms[name]
            row = rows.get(name, {})
            if row.get("mode") != chosen.mode or row.get("commit") != results.commit():
                row = {"mode": chosen.mode, "commit": results.commit(), "rounds": []}
            task = progress.add_task(name, total=chosen.poses, completed=sum(r["poses"] for r in row["rounds"]))
            while (done := sum(part["poses"] for part in row["rounds"])) < chosen.poses:
                part = one_round(arm, chosen.mode, done, min(ROUND, chosen.poses - done))
                row["rounds"].append(part)
                progress.update(task, completed=done + part["poses"])
            row |= total(row["rounds"])
            row["remaining_joints"] = [joint + 1 for joint in prepare(arm).remaining_joints]
            row["times_us"] = row.get("times_us") or times(arm)
            row["prepare_ms"] = row.get("prepare_ms") or preparation(arm)
            row["lost_poses"] = [pose for part in row["rounds"] for pose in part["lost"]]
            rows[name] = row
            kept = {key: {**value, "rounds": [compact(value)]} for key, value in rows.items()}
            results.save(QUESTION, method=str(__doc__), packages=[], arms=kept)
            fastest = row["times_us"][f"{kernels.instruction_set()} {chosen.mode}"]
            progress.console.print(
                f"{name:28} lost {row['lost']} ({row['lost_without_doubt']} unsaid) of {row['poses']}, "
                f"empty {row['empty']}, error {row['position_error']:.0e} m {row['rotation_error']:.0e} rad, "
                f"{fastest['median']:.1f} us, p99 {fastest['p99']:.0f}"
            )


def compact(row: dict) -> dict:
    """All rounds of an arm as one, as they are kept."""
    figures = total(row["rounds"])
    return {
        "poses": figures["poses"],
        "answers": round(figures["answers"] * figures["poses"]),
        "most": figures["most_answers"],
        "empty": figures["empty"],
        "doubtful": round(figures["doubtful"] * figures["poses"]),
        "position_error": figures["position_error"],
        "rotation_error": figures["rotation_error"],
        "lost": [pose for part in row["rounds"] for pose in part["lost"]],
    }


if __name__ == "__main__":
    main()
