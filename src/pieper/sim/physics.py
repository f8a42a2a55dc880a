"""An arm with mass, in a world of things, simulated by MuJoCo: the same interface as the kinematic simulator.

What the arm is asked to do becomes a reference, joint values over time within its limits, and the drives follow it: position servos with
limited force that know the dynamics of the arm (computed torque), but nothing of what it carries or touches. Nothing is random, and
nothing runs by itself: the same calls give the same bits on the same machine.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError, MotionError, unknown_name
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import JointLimits
from pieper.motion.robot import RobotState, Simulator
from pieper.sim.gripper import GripperDrive, ParallelGripper, add_gripper
from pieper.sim.kinematic import joined, joint_vector, seconds
from pieper.sim.mujoco_arm import axis_name, build_arm, quaternion
from pieper.sim.offscreen import import_mujoco
from pieper.sim.pierced import CapsulesAndBoxes
from pieper.sim.scene import Scene, add_scene, friction_vector, pose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.motion.trajectory import Trajectory

FloatArray = NDArray[np.float64]

TIMESTEP = 0.002
"""Of the physics [s]."""

LONGEST_STEP = 3600.0
"""The longest time of one call of `MujocoSimulator.step` [s]."""

MARGIN = 0.01
"""Solids nearer than this are in each other's way, for `MujocoSimulator.blocked` [m]."""

_AT_REST = 1e-3  # [rad/s or m/s] of the axes


class MujocoSimulator(Simulator):
    """A simulated arm with masses, drives, and a world that it touches.

    A command that comes while the arm moves brings it to rest first, as quickly as its acceleration limits allow; `follow` replaces what
    runs, as on `pieper.sim.kinematic.KinematicSimulator`. What is refused raises before anything changes.

    Parameters
    ----------
    arm : Arm
        Its base frame is the world.
    q : (n,) array or mapping, optional
        Joint values at the beginning [rad or m]; when not given, the values nearest 0 within the limits.
    scene : Scene, optional
        What stands around it; an empty floor by default.
    gripper : ParallelGripper, optional
        On the tip of the arm.
    max_velocity : float or (n,) array, optional
        See `pieper.motion.limits.JointLimits.of`.
    timestep : float
        Of the physics [s].
    color : str
        Of the arm.

    Attributes
    ----------
    arm : Arm
    chain : Chain
    limits : JointLimits
    scene : Scene
    gripper : GripperDrive or None
    model, data : mujoco.MjModel, mujoco.MjData
        What MuJoCo works on.

    Raises
    ------
    ArrayError, MotionError, UnknownNameError
        As from the kinematic simulator.
    MissingExtraError, MissingLibraryError
        MuJoCo is not there.

    Examples
    --------
    >>> import pieper
    >>> robot = MujocoSimulator(pieper.load("ur5e"), q=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0])
    >>> robot.command({"elbow_joint": 1.0})
    >>> while robot.is_moving:
    ...     state = robot.step(0.01)
    >>> robot.settle()
    >>> bool(abs(robot.read().q[2] - 1.0) < 1e-4)
    True
    """

    def __init__(
        self,
        arm: Arm,
        *,
        q: ArrayLike | Mapping[str, float] | None = None,
        scene: Scene | None = None,
        gripper: ParallelGripper | None = None,
        max_velocity: ArrayLike | None = None,
        timestep: float = TIMESTEP,
        color: str = "#f28c28",
    ) -> None:
        mujoco = import_mujoco()
        self.arm, self.chain = arm, arm.chain
        self.scene = Scene() if scene is None else scene
        self.limits = JointLimits.of(self.chain, max_velocity=max_velocity)
        if not (np.isfinite(timestep) and 1e-5 <= timestep <= 0.01):
            raise ArrayError(f"timestep must be from 1e-5 to 0.01 s, got {timestep!r}")
        nearest_zero = np.clip(np.zeros(self.chain.dof), *self.chain.limits.T)
        start = nearest_zero if q is None else self.limits.check_position(joint_vector(self.chain, q, nearest_zero))

        def extend(spec: Any, last: Any) -> None:
            spec.option.timestep = timestep
            add_scene(spec, self.scene)
            if gripper is not None:
                T_body_tip = np.linalg.inv(self.chain.frame(len(self.chain.screws)).home) @ self.chain.home
                add_gripper(spec, last, gripper, T_body_tip)

        spec, self.drives = build_arm(arm, color=color, extend=extend)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._mujoco = mujoco
        if mujoco.get_mju_user_warning() is None:
            # MuJoCo would leave a MUJOCO_LOG.TXT in the working folder; `_tick` says it
            mujoco.set_mju_user_warning(_heard)
        joints = [self.model.joint(axis_name(axis)) for axis in range(len(self.chain.screws))]
        self._q = np.array([int(joint.qposadr[0]) for joint in joints], dtype=np.intp)
        self._dq = np.array([int(joint.dofadr[0]) for joint in joints], dtype=np.intp)
        self._ctrl = np.array(
            [int(self.model.actuator(axis_name(axis)).id) for axis in range(len(joints))], dtype=np.intp
        )
        self._from_axes = np.linalg.pinv(self.chain.coupling)
        self.gripper = None if gripper is None else GripperDrive(gripper, self.model, self.data)
        self.observers: list[Callable[[], None]] = []
        self._ticks, self._left_over = 0, 0.0
        self._wanted = np.zeros(self.chain.dof)  # velocity, while no samples are followed
        self._samples: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._next = 0
        self._goal: FloatArray | None = None
        self._reference = (start, np.zeros(self.chain.dof), np.zeros(self.chain.dof))
        names = [self.model.body(body).name for body in range(self.model.nbody)]
        self._is_arm = np.array([name.startswith(("arm/", "palm")) for name in names])
        self._is_finger = np.array([name.startswith("finger/") for name in names])
        wider = copy.deepcopy(self.model)
        wider.geom_margin[:] = np.maximum(wider.geom_margin, 0.5 * MARGIN)
        self._lookout = (wider, mujoco.MjData(wider))
        self._unseen = CapsulesAndBoxes(self.model)
        self._full = np.zeros(self.model.nv)
        self._force = np.zeros(self.model.nv)
        self.data.qpos[self._q] = self.chain.coupling @ start
        self._control(*self._reference)
        mujoco.mj_forward(self.model, self.data)

    # --- the robot

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of ``q``."""
        return self.chain.joint_names

    @property
    def timestep(self) -> float:
        """Of the physics [s]."""
        return float(self.model.opt.timestep)

    @property
    def time(self) -> float:
        """How long the physics has run [s]: whole time steps; the rest of what `step` was told is kept for the next call."""
        return self._ticks * self.timestep

    @property
    def reference(self) -> RobotState:
        """Where the drives want the arm to be; plan from here."""
        q, dq, _ = self._reference
        return RobotState(self.time, _read_only(q), _read_only(dq))

    @property
    def is_moving(self) -> bool:
        """True until the reference of what was commanded has ended."""
        return (
            self._samples is not None
            or self._goal is not None
            or bool(self._wanted.any())
            or bool(self._reference[1].any())
        )

    @property
    def at_rest(self) -> bool:
        """True when the reference has ended and the arm has come to rest."""
        return not self.is_moving and bool((np.abs(self.data.qvel[self._dq]) < _AT_REST).all())

    def read(self) -> RobotState:
        """Time, joint values and joint velocities now, as measured."""
        q = self._from_axes @ self.data.qpos[self._q]
        dq = self._from_axes @ self.data.qvel[self._dq]
        return RobotState(self.time, _read_only(q), _read_only(dq))

    def tip(self) -> FloatArray:
        """(4, 4) pose of the tip now."""
        return np.asarray(self.arm.fk(self.read().q))

    def command(self, q: ArrayLike | Mapping[str, float]) -> None:
        """Go to joint values (n,) [rad or m] on a straight line in joint space, with a smooth start and stop; from a motion, after a halt.

        Parameters and errors as for `pieper.sim.kinematic.KinematicSimulator.command`.
        """
        goal = self.limits.check_position(joint_vector(self.chain, q, self._reference[0]))
        self._brake()
        self._goal = goal

    def command_velocity(self, dq: ArrayLike | Mapping[str, float]) -> None:
        """Move with constant joint velocities (n,) [rad/s or m/s] until something else is commanded; a joint that comes to its limit stops there.

        Velocities are taken up within the acceleration limits. Parameters and errors as for the kinematic simulator.
        """
        velocity = self.limits.check_velocity(
            joint_vector(self.chain, dq, np.zeros(self.chain.dof), name="dq"), name="dq"
        )
        self._brake()
        self._wanted = velocity

    def follow(self, trajectory: Trajectory) -> None:
        """Follow a trajectory whose times count from now; at its end the arm rests. Replaces what runs.

        Rules and errors as for the kinematic simulator; what it has to begin near is the `reference`.
        """
        ordered = joined(trajectory.in_order(self.joint_names), self.reference)
        self.limits.check_trajectory(ordered)
        self._brake()
        self._wanted = np.zeros(self.chain.dof)
        self._follow(ordered)

    def stop(self) -> None:
        """Come to rest as quickly as the acceleration limits allow, within the joint limits."""
        self._brake()

    def step(self, dt: float) -> RobotState:
        """Let time pass, and read.

        Parameters
        ----------
        dt : float
            [s], from 0 to 3600.

        Returns
        -------
        RobotState
            Time, joint values and velocities at the end.

        Raises
        ------
        ArrayError
            Time cannot pass like that.
        MotionError
            The physics has lost its way; what was simulated since then is no use.
        """
        passed = seconds(dt, LONGEST_STEP)
        self._left_over += passed / self.timestep
        count = int(self._left_over + 1e-6)
        self._left_over = max(self._left_over - count, 0.0)
        for _ in range(count):
            self._tick()
        return self.read()

    def settle(self, *, longest: float = 5.0) -> None:
        """Let time pass until the arm rests, `longest` [s] at most."""
        end = self.time + longest
        while not self.at_rest and self.time < end:
            self._tick()

    # --- the world

    def pose(self, name: str) -> FloatArray:
        """(4, 4) where a thing of the scene is now.

        Raises
        ------
        UnknownNameError
            No thing of that name.
        """
        thing = self._thing(name)
        entry = self.scene.object(name)
        if not entry.moves:
            return np.array(entry.T_world_object)
        where = np.asarray(self.data.joint(thing).qpos)  # MuJoCo's poses of bodies are those before the last time step
        R, T = np.zeros(9), np.eye(4)
        self._mujoco.mju_quat2Mat(R, where[3:] / np.linalg.norm(where[3:]))
        T[:3, :3], T[:3, 3] = R.reshape(3, 3), where[:3]
        return T

    def put(self, name: str, T_world_object: ArrayLike) -> None:
        """Put a thing that moves somewhere else, (4, 4) [m, -], at rest.

        Raises
        ------
        UnknownNameError
            No thing of that name.
        ArrayError
            It is fixed, or the pose is none.
        """
        T = pose(T_world_object, "T_world_object")
        thing = self._thing(name)
        if not self.scene.object(name).moves:
            raise ArrayError(f"{name!r} is fixed; give it a mass to move it")
        joint = self.data.joint(thing)
        joint.qpos = np.concatenate([T[:3, 3], quaternion(T[:3, :3])])
        joint.qvel = np.zeros(6)
        self._mujoco.mj_forward(self.model, self.data)

    def positions(self, q: ArrayLike, places: Mapping[str, FloatArray] | None = None) -> FloatArray:
        """MuJoCo's positions as they would be with the arm and some things elsewhere, to be drawn; nothing moves.

        Parameters
        ----------
        q : (n,) array
            Joint values [rad or m].
        places : mapping of str to (4, 4) array, optional
            Things that move, and where in the world.

        Returns
        -------
        (nq,) array
            MuJoCo's ``qpos`` [m, rad, -].
        """
        positions = np.array(self.data.qpos)
        positions[self._q] = self.chain.coupling @ np.asarray(q, dtype=np.float64)
        for name, T in (places or {}).items():
            first = int(self.model.joint(self._thing(name)).qposadr[0])
            positions[first : first + 7] = np.concatenate([T[:3, 3], quaternion(T[:3, :3])])
        return positions

    def speed(self, name: str) -> float:
        """How fast a thing moves, and its surface at 0.1 m from its middle turns, together [m/s]."""
        if not self.scene.object(name).moves:
            return 0.0
        velocity = np.asarray(self.data.joint(self._thing(name)).qvel)
        return float(np.linalg.norm(velocity[:3]) + 0.1 * np.linalg.norm(velocity[3:]))

    def set_friction(self, name: str, friction: float) -> None:
        """Change the friction of a thing [-]: oil it, or dry it.

        Raises
        ------
        UnknownNameError
            No thing of that name.
        ArrayError
            It is negative or not finite.
        """
        if not (np.isfinite(friction) and friction >= 0.0):
            raise ArrayError(f"friction must be 0 or more and finite, got {friction!r}")
        self.model.geom(self._thing(name)).friction = friction_vector(friction)

    def collisions(self) -> frozenset[tuple[str, str]]:
        """Pairs of names of what the arm itself, without its fingers, touches now."""
        pairs = np.concatenate([self.model.geom_bodyid[self.data.contact.geom], self._unseen.near(self.data, 0.0)])
        return frozenset(self._names(pairs[self._is_arm[pairs].any(axis=1)]))

    def overlaps(self, depth: float) -> list[tuple[str, str, float]]:
        """Pairs of names of what is deeper than `depth` [m] in each other now, and how deep [m], the deepest first.

        Physics throws such things apart.
        """
        found = []
        for contact in self.data.contact:
            if contact.dist < -depth:
                ((one, other),) = self._names(self.model.geom_bodyid[contact.geom][None])
                found.append((one, other, -float(contact.dist)))
        return sorted(found, key=lambda row: -row[2])

    def blocked(self, q: ArrayLike, *, held: str | None = None, T_tip_held: FloatArray | None = None) -> str:
        """What the arm would touch at other joint values, in words; empty when nothing. Things stay where they are now.

        Parameters
        ----------
        q : (n,) array
            Joint values [rad or m].
        held : str, optional
            A thing that goes along in the hand; it must touch nothing but the hand.
        T_tip_held : (4, 4) array, optional
            Where it is in the hand, in the frame of the tip [m, -].

        Returns
        -------
        str
            The two things, or nothing.

        Notes
        -----
        Solids nearer than `MARGIN` count as touching, also those that have gone right through each other.
        """
        model, data = self._lookout
        data.qpos[:] = self.data.qpos
        data.qpos[self._q] = self.chain.coupling @ np.asarray(q, dtype=np.float64)
        hand = self._is_arm | self._is_finger
        carried = np.zeros(model.nbody, dtype=np.bool_)
        if held is not None and T_tip_held is not None:
            T = self.arm.fk(q) @ T_tip_held
            data.joint(self._thing(held)).qpos = np.concatenate([T[:3, 3], quaternion(T[:3, :3])])
            carried[int(model.body(self._thing(held)).id)] = True
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_comPos(model, data)
        self._mujoco.mj_collision(model, data)
        pairs = np.concatenate([model.geom_bodyid[data.contact.geom], self._unseen.near(data, MARGIN)])
        ours, load = hand[pairs], carried[pairs]
        wrong = (
            (ours | load).any(axis=1) & ~(ours.any(axis=1) & load.any(axis=1)) & ~(self._is_finger[pairs].all(axis=1))
        )
        touching = sorted(self._names(pairs[wrong]))
        return f"{touching[0][0]} would touch {touching[0][1]}" if touching else ""

    def _names(self, pairs: NDArray[np.intp]) -> set[tuple[str, str]]:
        found = set()
        for a, b in pairs:
            one, other = sorted(self.model.body(int(body)).name.removeprefix("thing/") for body in (a, b))
            found.add((one, other))
        return found

    # --- beneath

    def _thing(self, name: str) -> str:
        if name not in {thing.name for thing in self.scene.objects}:
            raise unknown_name("object", name, [thing.name for thing in self.scene.objects], "the scene")
        return f"thing/{name}"

    def _brake(self) -> None:
        self._samples, self._goal = None, None
        self._wanted = np.zeros(self.chain.dof)

    def _follow(self, trajectory: Trajectory) -> None:
        h = self.timestep
        count = int(np.ceil(trajectory.t[-1] / h - 1e-9))
        if count < 1:
            self._reference = (trajectory.q[-1].copy(), np.zeros(self.chain.dof), np.zeros(self.chain.dof))
            return
        times = np.minimum(np.arange(1, count + 1) * h, trajectory.t[-1])
        q, dq, ddq = trajectory.sample(times)
        q = np.clip(q, *self.chain.limits.T)  # what rounding adds
        dq[-1], ddq[-1] = 0.0, 0.0
        self._samples, self._next = (q, dq, ddq), 0

    def _advance(self) -> None:
        """The reference, one time step on."""
        if self._goal is not None and self._samples is None and not self._reference[1].any():
            goal, self._goal = self._goal, None
            self._follow(joint_move(self.chain, self._reference[0], goal, max_velocity=self.limits.velocity))
        if self._samples is not None:
            q, dq, ddq = self._samples
            self._reference = (q[self._next], dq[self._next], ddq[self._next])
            self._next += 1
            if self._next == len(q):
                self._samples = None
        elif self._wanted.any() or self._reference[1].any():
            self._reference = self._ramp()
        elif self._reference[2].any():  # it has come to rest: nothing accelerates any more
            self._reference = (self._reference[0], self._reference[1], np.zeros(self.chain.dof))

    def _ramp(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Towards the wanted velocity with the largest acceleration, slow enough to stop before the joint limits."""
        q, v, _ = self._reference
        h, a = self.timestep, self.limits.acceleration
        lower, upper = self.chain.limits.T
        new = v + np.clip(self._wanted - v, -a * h, a * h)
        # v = a h k with k (k + 1) / 2 steps of a h^2 left to go; a stop that is late for it is harder
        with np.errstate(invalid="ignore"):
            ahead, behind = (
                a * h * (np.sqrt(0.25 + 2.0 * np.maximum(room, 0.0) / (a * h * h)) - 0.5)
                for room in (upper - q, q - lower)
            )
        new = np.clip(new, -behind, ahead)
        new = np.where(np.abs(new) < 1e-12, 0.0, new)
        there = np.clip(q + new * h, lower, upper)
        new = np.where((there == q) & (self._wanted == 0.0), 0.0, new)
        if ((there == lower) & (self._wanted < 0.0)).any() or ((there == upper) & (self._wanted > 0.0)).any():
            new = np.where(((there == lower) & (new < 0.0)) | ((there == upper) & (new > 0.0)), 0.0, new)
        return there, new, (new - v) / h

    def _control(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> None:
        """What the drives are told: the reference, ahead by what velocity and dynamics need."""
        axes = self.chain.coupling
        self._full[:] = 0.0
        self._full[self._dq] = axes @ ddq
        self._mujoco.mj_mulM(self.model, self.data, self._force, self._full)
        force = self._force[self._dq] + self.data.qfrc_bias[self._dq] - self.data.qfrc_gravcomp[self._dq]
        ahead = (self.drives.damping * (axes @ dq) + force) / self.drives.stiffness
        self.data.ctrl[self._ctrl] = axes @ q + ahead

    def _tick(self) -> None:
        q, dq, _ = self._reference
        self._advance()
        self._control(q, dq, self._reference[2])
        if self.gripper is not None:
            self.gripper.tick(self.timestep)
        self._mujoco.mj_step(self.model, self.data)
        self._ticks += 1
        if any(self.data.warning[kind].number for kind in _LOST):
            raise MotionError(
                f"the physics lost its way at {self.time:.3f} s: positions or accelerations without bounds; "
                "try a smaller timestep, and look for things that begin inside each other and for forces that are far too large"
            )
        for observe in self.observers:
            observe()


def _heard(_: str) -> None:
    """What MuJoCo warns of; read from its counters instead."""


_LOST = (3, 4, 5)  # MuJoCo's warnings of bad positions, velocities and accelerations


def _read_only(values: FloatArray) -> FloatArray:
    copy = np.array(values)
    copy.setflags(write=False)
    return copy
