"""Solvers that list every inverse solution, behind one face: pieper and its peers.

Each `Solver` takes the poses of one arm in the form that its package wants them, made beforehand, and a call ends when
its answers can be read as numbers. A peer that counts its frames differently gets poses moved by two fixed
transforms, which are found and checked by its own forward kinematics or by the judge's.
"""

import contextlib
import functools
import importlib.util
import io
import pathlib
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import arms
import numpy as np
import public_arms

CLAIMED = 1e-6


@dataclass
class Solver:
    """How one package solves poses of one arm.

    Attributes
    ----------
    name : str
    poses : sequence
        What `call` takes, one for each pose.
    call : callable
        Solves one and reads its answers.
    answers : callable
        The answers (k, n) in what `call` returned, and for each whether the solver calls it a solution (k,).
    batch : callable or None
        Solves all poses in one call, on one thread.
    before : callable
        Run before each round, outside the clock.
    """

    name: str
    poses: Sequence[Any]
    call: Callable[[Any], Any]
    answers: Callable[[Any], tuple[np.ndarray, np.ndarray]]
    batch: Callable[[], object] | None = None
    before: Callable[[], object] = lambda: None


def chain_of(arm: public_arms.Arm, *, limits: np.ndarray | None = None) -> Any:
    """The arm for pieper, from its axes."""
    from pieper.model.chain import Chain

    endless = np.tile([-np.inf, np.inf], (arm.dof, 1))
    return Chain(
        name=arm.name,
        screws=arm.screws,
        home=arm.home,
        limits=endless if limits is None else limits,
        joint_names=tuple(f"joint_{k + 1}" for k in range(arm.dof)),
    )


def pieper(solve: Callable[..., Any], T: np.ndarray, *, instructions: str | None = None, **options: Any) -> Solver:
    """``arm.ik`` of this package (or a function like it), with an instruction set (the widest when not given)."""
    from pieper._native import kernels

    chosen = instructions or kernels.instruction_sets()[-1]
    if options:
        solve = functools.partial(solve, **options)

    def call(poses: np.ndarray) -> object:
        found = solve(poses)
        return found.q, found.valid

    def answers(found: Any) -> tuple[np.ndarray, np.ndarray]:
        q, valid = found
        return q[valid], np.ones(int(valid.sum()), dtype=bool)

    name = "pieper" + "".join(f", {options[key]}" for key in ("method", "mode") if key in options)
    name += "" if instructions is None else f", {instructions}"
    poses = [pose.copy() for pose in T]
    return Solver(name, poses, call, answers, lambda: call(T), lambda: kernels.use_instruction_set(chosen))


def eaik_robot(arm: public_arms.Arm) -> Any:
    import eaik.IK_HP

    directions, points = arm.screws[:, 3:], np.cross(arm.screws[:, 3:], arm.screws[:, :3])
    steps, at = [], np.zeros(3)
    for direction, point in zip(directions, points, strict=True):  # the point of each axis nearest to the one before
        foot = point + direction * (direction @ (at - point))
        steps.append(foot - at)
        at = foot
    steps.append(arm.home[:3, 3] - at)
    return eaik.IK_HP.HPRobot(directions, np.array(steps))


def eaik(arm: public_arms.Arm, T: np.ndarray) -> Solver:
    """EAIK ignores the rotation of the tip at rest, so poses have that taken off. It flags what only comes near."""
    robot = eaik_robot(arm)
    at_rest = np.eye(4)
    at_rest[:3, :3] = arm.home[:3, :3].T
    poses = [np.ascontiguousarray(pose @ at_rest) for pose in T]

    def call(pose: np.ndarray) -> object:
        found = robot.IK(pose)
        return found.Q, found.is_LS

    def answers(found: Any) -> tuple[np.ndarray, np.ndarray]:
        q, only_near = found
        return np.reshape(q, (-1, arm.dof)), ~np.reshape(np.asarray(only_near, dtype=bool), -1)

    return Solver("EAIK", poses, call, answers, lambda: robot.IK_batched(poses, 1))


def ssik(module: Any, T: np.ndarray, *, name: str = "ssik") -> Solver:
    """A solver that ssik ships or has generated: each geometric answer once, whatever the joint limits."""
    solve = module.solve

    def call(pose: np.ndarray) -> object:
        return [answer.q for answer in solve(pose, respect_limits=False, enumerate_windings=False)]

    def answers(found: Any) -> tuple[np.ndarray, np.ndarray]:
        return np.reshape(found, (-1, module.DOF)), np.ones(len(found), dtype=bool)

    return Solver(name, [pose.copy() for pose in T], call, answers)


def ssik_module(arm: str) -> Any:
    """The solver that ssik ships for an arm, as in ``"kinova/jaco2"``."""
    return importlib.import_module(f"ssik.prebuilt.{arm.replace('/', '.')}_ik")


def ssik_built(arm: arms.Arm) -> Any:
    """A solver that ssik generates for an arm with a closed form (seconds)."""
    from ssik import cli

    path = pathlib.Path(tempfile.mkdtemp(prefix="pieper-bench-")) / f"{arm.name}_ik.py"
    command = ["build", str(arm.urdf_file()), "--base", arm.base, "--ee", arm.tip, "--out", str(path)]
    with contextlib.redirect_stdout(io.StringIO()):
        assert cli.main(command) == 0
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def ur_analytic_ik(arm: public_arms.Arm, name: str, T: np.ndarray, q: np.ndarray | None) -> Solver:
    """It counts from the frames of the controller, turned against those of the URDF, and has exact right angles.

    Poses are those of its own arm where joint values are given: beside a singularity 1e-9 rad count.
    """
    import ur_analytic_ik as package

    module = getattr(package, name)

    def forward(q: np.ndarray) -> np.ndarray:
        return np.array([module.forward_kinematics(*row) for row in q])

    before, after = related(arm, forward)
    poses = [np.ascontiguousarray(pose) for pose in (before @ T @ after if q is None else forward(q))]

    def answers(found: Any) -> tuple[np.ndarray, np.ndarray]:
        return np.reshape(found, (-1, 6)), np.ones(len(found), dtype=bool)

    return Solver("ur-analytic-ik", poses, module.inverse_kinematics, answers)


OPW: dict[str, dict[str, Any]] = {
    "kuka_kr210_robond": {"a1": 0.35, "a2": 0.054, "c1": 0.75, "c2": 1.25, "c3": 1.5, "c4": 0.303},
    "yaskawa_mh12": {"a1": 0.155, "a2": -0.2, "c1": 0.45, "c2": 0.614, "c3": 0.64, "c4": 0.1}
    | {"flip_axes": (False, False, True, True, True, True)},
}


def py_opw(arm: public_arms.Arm, T: np.ndarray) -> Solver:
    """It takes SciPy's transforms, and for a batch with every branch it has `reach`."""
    import py_opw_kinematics as package
    from scipy.spatial.transform import RigidTransform

    model = {"b": 0.0, "offsets": (0.0, 0.0, -np.pi / 2, 0.0, 0.0, 0.0), "flip_axes": (False,) * 6} | OPW[arm.name]
    robot = package.Robot(package.KinematicModel(**model), degrees=False)
    before, after = related(arm, lambda q: robot.batch_forward(q).as_matrix())
    moved = before @ T @ after
    together = RigidTransform.from_matrix(moved)

    def answers(found: Any) -> tuple[np.ndarray, np.ndarray]:
        return np.reshape(found, (-1, 6)), np.ones(len(found), dtype=bool)

    poses = [RigidTransform.from_matrix(pose) for pose in moved]
    return Solver("py-opw", poses, robot.inverse, answers, lambda: robot.reach(together))


def related(arm: public_arms.Arm, forward: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """A, B for which the forward kinematics of a peer is ``A T B``, with A a turn about z by whole quarters."""
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (8, arm.dof))
    ours, theirs = arm.forward(q), forward(q)
    for quarters in range(4):
        A = public_arms._about_z(quarters * np.pi / 2)
        B = np.linalg.inv(A @ ours[0]) @ theirs[0]
        if np.abs(A @ ours @ B - theirs).max() < 1e-8:
            return A, B
    raise ValueError(f"{arm.name}: not the arm that the peer has")


@dataclass(frozen=True)
class Quality:
    """What the judge says about the answers for some poses."""

    answers_per_pose: float
    false_answers: int
    recall: float | None
    answered: float
    answered_unflagged: float
    worst_position: float
    worst_rotation: float


def judged(
    forward: Callable[[np.ndarray], np.ndarray], T: np.ndarray, q: np.ndarray | None, solver: Solver, *, same: float
) -> Quality:
    """Answers that hold to 1e-6 [m and rad], the worst of them, and the share of poses whose joint values are there.

    False are answers that do not hold though the solver calls them solutions. Those it flags as only near count where
    they hold.
    """
    solver.before()
    good, false, found, answered, unflagged, worst = 0, 0, 0, 0, 0, np.zeros(2)
    for i, pose in enumerate(T):
        several, claimed = solver.answers(solver.call(solver.poses[i]))
        if not len(several):
            continue
        errors = np.array(arms.pose_errors(forward(several), pose))
        holds = errors.max(axis=0) < CLAIMED
        good += int(holds.sum())
        false += int((claimed & ~holds).sum())
        answered += bool(holds.any())
        unflagged += bool((holds & claimed).any())
        worst = np.maximum(worst, errors[:, holds].max(axis=1, initial=0.0))
        if q is not None:
            apart = np.abs(np.remainder(several[holds] - q[i] + np.pi, 2 * np.pi) - np.pi).max(axis=-1, initial=0.0)
            found += bool((apart < same).any())
    n = len(T)
    return Quality(
        good / n, false, None if q is None else found / n, answered / n, unflagged / n, float(worst[0]), float(worst[1])
    )
