"""How fast is forward kinematics of a million configurations, on one thread?

Pieper against the Python peers that take a batch (and Pinocchio in a loop), and against straight_line/ur5e.cpp, kernels
written for that one arm. The arm is the UR5e; py-opw-kinematics cannot describe it and gets a KUKA KR210 instead.
Every candidate fills 4x4 matrices of doubles. Like is compared with like: the nominal arm (exact quarter turns) with the
nominal straight line, the literal arm (the printed 1.570796327, the default of `pieper.load`) with the literal one.

    python benchmarks/forward_kinematics.py [--poses 1000000] [--rounds 41]
"""

import argparse
import ctypes
import pathlib
import statistics
import subprocess
import tempfile
import warnings
from collections.abc import Callable

import paired

# isort: split
import arms
import numpy as np
import results

CAREFUL = "with our sine"
KEPT, FRESH = "output reused", "new output"
OURS = "pieper, literal, new output, beside the peers"
COMPILER = ["g++", "-std=c++20", "-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-shared", "-fPIC"]


def aligned(*shape: int) -> np.ndarray:
    """A fresh array of doubles that starts at a cache line, untouched."""
    count = int(np.prod(shape))
    buffer = np.empty(count + 8)
    start = -buffer.ctypes.data % 64 // 8
    return buffer[start : start + count].reshape(shape)


def straight_lines() -> dict[str, Callable[..., np.ndarray]]:
    """Compile the hand-written kernels and wrap them: (q, out, around_cache) -> out."""
    source = pathlib.Path(__file__).parent / "straight_line" / "ur5e.cpp"
    folder = pathlib.Path(tempfile.mkdtemp(prefix="pieper-bench-"))

    def library(name: str, *options: str) -> ctypes.CDLL:
        subprocess.run([*COMPILER, *options, str(source), "-o", str(folder / name)], check=True)
        return ctypes.CDLL(str(folder / name))

    def wrapped(kernel: Callable[..., None]) -> Callable[..., np.ndarray]:
        kernel.argtypes = [ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int]
        kernel.restype = None

        def forward(q: np.ndarray, out: np.ndarray, around_cache: bool) -> np.ndarray:
            kernel(q.ctypes.data, len(q), out.ctypes.data, around_cache)
            return out

        return forward

    plain, careful = library("ur5e.so"), library("ur5e_careful.so", "-DCAREFUL_SINE")
    return {
        "nominal": wrapped(plain.ur5e_nominal),
        "literal": wrapped(plain.ur5e_literal),
        f"nominal, {CAREFUL}": wrapped(careful.ur5e_nominal),
        f"literal, {CAREFUL}": wrapped(careful.ur5e_literal),
    }


def peers(arm: arms.Arm) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """What can be installed: (count, 6) to (count, 4, 4)."""
    import pinocchio
    import py_opw_kinematics as opw
    import roboticstoolbox

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ets = roboticstoolbox.Robot.URDF(str(arm.urdf_file())).ets(start=arm.base, end=arm.tip)

    model = pinocchio.buildModelFromXML(arm.urdf())
    data, tip = model.createData(), model.getFrameId(arm.tip)

    def pinocchio_loop(q: np.ndarray) -> np.ndarray:
        T = np.empty((len(q), 4, 4))
        update, placements = pinocchio.framesForwardKinematics, data.oMf
        for i, row in enumerate(q):
            update(model, data, row)
            T[i] = placements[tip].homogeneous
        return T

    kr210 = opw.KinematicModel(
        a1=0.35, a2=-0.054, b=0.0, c1=0.75, c2=1.25, c3=1.5, c4=0.303,
        offsets=(0.0, 0.0, -np.pi / 2, 0.0, 0.0, 0.0), flip_axes=(True, False, True, True, False, True),
    )  # fmt: skip
    public = opw.Robot(kr210, degrees=False)
    private = opw._RobotInternal(kr210, False)

    return {
        "Robotics Toolbox ets.eval": ets.eval,
        "Pinocchio, loop in Python": pinocchio_loop,
        "py-opw batch_forward (KR210)": lambda q: public.batch_forward(q).as_matrix(),
        "py-opw, its private array call (KR210)": private.batch_forward,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=41, help="of the fast candidates")
    parser.add_argument("--peer-rounds", type=int, default=7, help="of the slow ones")
    parser.add_argument("--peers-only", action="store_true", help="leave pieper out")
    options = parser.parse_args()
    paired.pin_to_one_core()

    arm = arms.load("ur5e")
    q = aligned(options.poses, 6)
    q[:] = arm.sample(options.poses)
    out = aligned(options.poses, 4, 4)
    straight = straight_lines()

    fast = {}
    for geometry, kernel in straight.items():
        fast[f"straight line, {geometry}, {KEPT}"] = lambda kernel=kernel: kernel(q, out, False)
        fast[f"straight line past the caches, {geometry}, {KEPT}"] = lambda kernel=kernel: kernel(q, out, True)
    kernel = straight["nominal"]
    fast[f"straight line, nominal, {FRESH}"] = lambda: kernel(q, aligned(options.poses, 4, 4), False)
    fast[f"straight line past the caches, nominal, {FRESH}"] = lambda: kernel(q, aligned(options.poses, 4, 4), True)
    slow = {name: (lambda run=run: run(q)) for name, run in peers(arm).items()}
    ours = {}
    if not options.peers_only:
        import pieper

        ours = {"nominal": pieper.load("ur5e", nominal=True), "literal": pieper.load("ur5e")}
        for geometry, each in ours.items():
            fast[f"pieper, {geometry}, {KEPT}"] = lambda each=each: each.fk(q, out=out)
            fast[f"pieper, {geometry}, {FRESH}"] = lambda each=each: each.fk(q)
        slow[OURS] = lambda: ours["literal"].fk(q)

    # All must compute the same thing before any is timed.
    some = slice(0, 1001)
    truth = {"nominal": arm.nominal().forward(q[some]), "literal": arm.forward(q[some])}
    for geometry, kernel in straight.items():
        for around_cache in (False, True):
            assert np.abs(kernel(q, out, around_cache)[some] - truth[geometry.partition(",")[0]]).max() < 3e-15
    for geometry, each in ours.items():
        assert np.abs(each.fk(q, out=out)[some] - truth[geometry]).max() < 3e-15
    for name in ("Robotics Toolbox ets.eval", "Pinocchio, loop in Python"):
        assert np.abs(slow[name]()[some] - truth["literal"]).max() < 3e-15

    quick = paired.in_turn(fast, rounds=options.rounds)
    others = paired.in_turn(slow, rounds=options.peer_rounds)

    nanoseconds = 1e9 / options.poses
    rows = [
        {"name": name, "nanoseconds": paired.quartiles([value * nanoseconds for value in seconds])}
        for name, seconds in {**others, **quick}.items()
    ]
    rows.sort(key=lambda row: row["nanoseconds"]["median"])
    ratios = {}
    if ours:
        for geometry, state in (*((each, KEPT) for each in straight), ("nominal", FRESH)):
            ways = [f"straight line{way}, {geometry}, {state}" for way in ("", " past the caches")]
            best = min(ways, key=lambda name: statistics.median(quick[name]))
            own = f"pieper, {geometry.partition(',')[0]}, {state}"
            ratios[f"pieper / straight line, {geometry}, {state}"] = paired.ratio(quick[own], quick[best])
        for name in others:
            if name != OURS:
                ratios[f"{name} / pieper"] = paired.ratio(others[name], others[OURS])

    for row in rows:
        print(f"{row['name']:50} {row['nanoseconds']['median']:9.2f} ns/pose")
    for name, value in ratios.items():
        print(f"{name:60} {value['median']:8.2f}")
    results.save(
        "forward_kinematics",
        method=f"{options.poses} configurations, one thread, processor time; {options.rounds} rounds in turn for pieper and "
        f"the straight-line kernel, {options.peer_rounds} for the peers; medians; ratios round by round",
        packages=["pin", "roboticstoolbox-python", "py-opw-kinematics"],
        compiler=" ".join(COMPILER[:-2])
        + ", "
        + subprocess.run(["g++", "--version"], capture_output=True, text=True).stdout.splitlines()[0],
        output_bytes=out.nbytes,
        rows=results.rounded(rows),
        ratios=results.rounded(ratios),
    )


if __name__ == "__main__":
    main()
