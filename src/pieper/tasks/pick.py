"""Pick and place: one thing after another out of its slot and into a bin, stage by stage, each logged with its outcome.

A cycle goes through `STAGES`. What is waited for is a state, of the arm, of the gripper or of the thing, never a time; a state that does not
come within `PATIENCE` fails its stage. When the fingers close on nothing, or what they hold slips, the arm draws back, looks again and
tries again. A thing that cannot be picked is left, with the reason, and the next one is tried.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, PieperError, unknown_name
from pieper.model.description import Box, Cylinder
from pieper.motion.collision import CollisionModel
from pieper.motion.world import Item, World
from pieper.sim.gripper import GripperState
from pieper.sim.physics import MujocoSimulator
from pieper.sim.scene import at
from pieper.tasks.mover import DirectMover, Mover
from pieper.tasks.pick_stage import STAGES, Cycle, Stage
from pieper.tasks.pick_task import FloatArray, PickTask
from pieper.tasks.planned_mover import PlannedMover, is_there

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from pieper.motion.trajectory import Trajectory

__all__ = [
    "MOST_TILT",
    "PATIENCE",
    "PLANNERS",
    "STAGES",
    "Cycle",
    "PickAndPlace",
    "PickTask",
    "Stage",
    "chosen_planner",
]

PATIENCE = 8.0
"""How long a state is waited for [s of the simulation]."""
MOST_TILT = float(np.radians(15.0))
"""How far a thing may lean and still be gripped [rad]."""
_INSIDE = 0.002  # [m] deeper than things rest on each other
_GUARDED_EVERY = 5  # time steps between looks at what touches what
_LOOSE = 0.02  # [m] how far from its place in the hand a thing may be
STILL = 0.02  # [m/s]
_STAYS, _FOR = 0.005, 0.25  # [m] and [s]: what lies in a heap may tremble
PLANNERS = ("rrt", "direct")
"""By name, the ways to get from pose to pose that a run can be told to take."""


def chosen_planner(name: str | None = None) -> str:
    """The planner of that name, or the best one that is installed.

    >>> chosen_planner("direct")
    'direct'
    """
    if name is None:
        return "rrt" if is_there() else "direct"
    if name not in PLANNERS:
        raise unknown_name("planner", name, PLANNERS)
    return name


class StageFailedError(Exception):
    """A stage failed; `lost` says that a grasp was lost and trying again may help."""

    def __init__(self, reason: str, *, lost: bool = False) -> None:
        super().__init__(reason)
        self.lost = lost


class _CancelledError(StageFailedError):
    """`PickAndPlace.cancel` was called."""


@dataclass(eq=False)
class _Held:
    """What is in the hand, and where it was in it when it was gripped."""

    name: str
    T_tip_object: FloatArray = field(repr=False)


class PickAndPlace:
    """The task as it runs.

    Parameters
    ----------
    task : PickTask
    seed : int
        Of the places of the things in their slots. The places of a cycle depend on the seed and the number of the cycle alone.
    mover : Mover, optional
        How to get from pose to pose, instead of a `planner`.
    planner : {"rrt", "direct"}, optional
        ``"rrt"`` searches for free ways (`pieper.tasks.planned_mover.PlannedMover`, which needs the extra ``plan``), ``"direct"`` tries straight
        ones (`pieper.tasks.mover.DirectMover`). By default the first where it is installed.
    look : callable, optional
        Given the name of a target, where it is, (4, 4), or None when it is not seen; the simulator's own knowledge by default.
    log : callable, optional
        Called with every `Stage` when it ends.

    Attributes
    ----------
    robot : MujocoSimulator
    planner : str
        ``"rrt"``, ``"direct"``, or ``"own"`` for a mover that was given.
    cancelled : bool
        See `cancel`.
    stages : list of Stage

    Raises
    ------
    UnknownNameError
        No planner of that name.
    MissingExtraError
        MuJoCo is not installed, or what the planner needs.
    """

    def __init__(
        self,
        task: PickTask,
        *,
        seed: int = 0,
        mover: Mover | None = None,
        planner: str | None = None,
        look: Callable[[str], FloatArray | None] | None = None,
        log: Callable[[Stage], None] | None = None,
    ) -> None:
        self.task, self.seed = task, seed
        axis = task.gripper.T_tip_grasp[:3, 2] if task.spin_free else None
        self.robot = MujocoSimulator(task.arm, q=task.q_home, scene=task.scene, gripper=task.gripper)
        self.cancelled = False
        self.planner = "own" if mover is not None else chosen_planner(planner)
        self.mover: Mover
        if mover is not None:
            self.mover = mover
        elif self.planner == "rrt":
            self.mover = PlannedMover(
                task.arm, model=self.collision_model, axis_tip=axis, speed=task.speed, seed=seed, cancelled=lambda: self.cancelled
            )  # fmt: skip
        else:
            self.mover = DirectMover(
                task.arm, axis_tip=axis, speed=task.speed, blocked=self.blocked, postures=(task.q_home, *task.postures)
            )
        assert self.robot.gripper is not None
        self.gripper = self.robot.gripper
        self.look: Callable[[str], FloatArray | None] = self.robot.pose if look is None else look
        self.log = log
        self.stages: list[Stage] = []
        self._cycle, self._target = 0, ""
        self._held: _Held | None = None
        self._tolerated: frozenset[tuple[str, str]] = frozenset()
        self._models: dict[bytes, CollisionModel] = {}
        self._hands: dict[tuple[_Held | None, float], CollisionModel] = {}

    def cancel(self) -> None:
        """End the run as soon as it can: the stage that runs fails as cancelled, the arm comes to rest, and no cycle follows.

        It may be called from a handler of a signal, or from another thread.
        """
        self.cancelled = True

    def collision_model(self, margin: float, reaching: bool = False) -> CollisionModel:
        """The arm, with its gripper and what it holds, among the things where they are now, for planning.

        Parameters
        ----------
        margin : float
            To keep between solids [m].
        reaching : bool
            Whether the target, which the hand is then about to touch, is left out.

        Returns
        -------
        CollisionModel
        """
        robot, task = self.robot, self.task
        out = {self._held.name if self._held is not None else None, self._target if reaching else None}
        things = [
            Item(thing.name, thing.solid, robot.pose(thing.name))
            for thing in task.scene.objects
            if thing.name not in out
        ]
        hand = self._hand_model(margin)
        key = (
            np.round([thing.pose for thing in things], 4).tobytes() + repr((id(hand), reaching, self._target)).encode()
        )
        if key not in self._models:
            if task.scene.floor is not None:
                things.append(
                    Item("the floor", Box(np.array([20.0, 20.0, 0.1])), at(0.0, 0.0, task.scene.floor - 0.05))
                )
            self._models = dict([*self._models.items()][-3:])
            self._models[key] = hand.with_world(World(tuple(things)))
        return self._models[key]

    def _hand_model(self, margin: float) -> CollisionModel:
        """The arm with its gripper and what it holds, alone; made once for every grasp."""
        key = (self._held, margin)
        if key not in self._hands:
            task, held = self.task, self._held
            tool = [
                Item(f"gripper/{name}", solid, task.gripper.T_tip_mount @ T)
                for name, (solid, T) in task.gripper.solids(None if held is None else self.gripper.width).items()
            ]
            attached = [] if held is None else [Item(held.name, task.scene.object(held.name).solid, held.T_tip_object)]
            self._hands = {other: model for other, model in self._hands.items() if other[0] in (None, held)}
            self._models = {}
            self._hands[key] = CollisionModel(task.arm, tool=tool, attached=attached, margin=margin)
        return self._hands[key]

    def blocked(self, q: FloatArray) -> str:
        """What the arm, with what it holds, would touch at joint values (n,), in words; empty when nothing."""
        if self._held is None:
            return self.robot.blocked(q)
        return self.robot.blocked(q, held=self._held.name, T_tip_held=self._held.T_tip_object)

    # --- cycles

    def run(self, cycles: int, *, first: int = 1) -> Iterator[Cycle]:
        """Run cycles, one for every item that is taken from the iterator: from number `first` on, `cycles` of them.

        Targets come in their order, again and again; before the first one of a round the slots are filled. After `cancel`, the cycle that runs
        is the last one, and not placed.

        Raises
        ------
        ArrayError
            A number that is not positive.
        PieperError
            The things in their slots do not come to rest.
        """
        given: dict[str, object] = {"cycles": cycles, "first": first}
        for name, value in given.items():
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
                raise ArrayError(f"{name} must be a whole number of 1 or more, got {value!r}")
        for number in range(first, first + cycles):
            if self.cancelled:
                return
            slot = (number - 1) % len(self.task.targets)
            if slot == 0 or number == first:
                try:
                    self.fill_slots(number - slot)
                except _CancelledError:
                    self._halt()
                    return
                except StageFailedError as cause:
                    raise PieperError(str(cause)) from cause
            yield self.cycle(number)

    def fill_slots(self, number: int) -> None:
        """Put every target into its slot, shifted and turned by the noise of the round that begins with cycle `number`."""
        rng = np.random.default_rng((self.seed, number))
        for name in self.task.targets:
            T = self.task.scene.object(name).T_world_object
            x, y = rng.uniform(-self.task.position_noise, self.task.position_noise, 2)
            yaw = rng.uniform(-self.task.yaw_noise, self.task.yaw_noise)
            self.robot.put(name, at(x, y, 0.0) @ T @ at(0.0, 0.0, 0.0, yaw=yaw))
        inside = self.robot.overlaps(_INSIDE)
        if inside:
            one, other, depth = inside[0]
            raise StageFailedError(f"{one} begins {1e3 * depth:.0f} mm inside {other}: they need places of their own")
        self._wait(
            lambda: max(map(self.robot.speed, self.task.targets)) < STILL,
            "the things in their slots do not come to rest",
            guard=False,
        )

    def cycle(self, number: int) -> Cycle:
        """One thing from its slot to the bin."""
        self._cycle, self._target = number, self.task.targets[(number - 1) % len(self.task.targets)]
        start, attempt, placed, reason = self.robot.time, 0, False, ""
        while not placed and attempt < self.task.attempts:
            attempt += 1
            try:
                self._pick()
                self._place()
                placed = True
            except _CancelledError:
                break
            except StageFailedError as failed:
                reason = str(failed)
                if not self._recover(again=failed.lost and attempt < self.task.attempts) or not failed.lost:
                    break
        if self.cancelled:
            self._halt()
            return Cycle(number, self._target, placed, attempt, "" if placed else "cancelled", self.robot.time - start)
        with suppress(StageFailedError), self._stage("next target"):
            left = len(self.task.targets) - 1 - (number - 1) % len(self.task.targets)
            if not placed:
                raise StageFailedError(f"{self._target} is left: {reason}; {left} to go")
        return Cycle(number, self._target, placed, attempt, "" if placed else reason, self.robot.time - start)

    def _halt(self) -> None:
        """Bring the arm to rest."""
        self.robot.stop()
        self.robot.settle(longest=PATIENCE)

    # --- the stages

    def _pick(self) -> None:
        task, robot = self.task, self.robot
        with self._stage(STAGES[0]):
            T_grasp = task.grasp_at(_upright(self._seen()))
            T_pre, T_via = task.back(T_grasp, task.approach), task.back(T_grasp, task.approach + task.clearance)
        with self._stage(STAGES[1]):
            ways = self._ways(T_via, T_pre, T_grasp)
        with self._stage(STAGES[2]):
            self._open()
            for way in ways[:-1]:
                self._follow(way)
        with self._stage(STAGES[3]):
            self._follow(ways[-1])
        with self._stage(STAGES[4]):
            self.gripper.close()
            self._wait(
                lambda: self.gripper.state in (GripperState.HOLDING, GripperState.EMPTY),
                "the fingers do not come to rest",
            )
            if self.gripper.state is GripperState.EMPTY:
                raise StageFailedError("the fingers closed on nothing", lost=True)
            self._held = _Held(self._target, np.linalg.inv(robot.tip()) @ robot.pose(self._target))
        with self._stage(STAGES[5]):
            T_up = self._lifted(T_grasp)
            self._follow(self.mover.line(robot.reference.q, T_up))
            self._follow(self.mover.line(robot.reference.q, task.back(T_up, task.approach)))

    def _lifted(self, T_grasp: FloatArray) -> FloatArray:
        """The tip once it has lifted what it grips off the board."""
        T = np.array(T_grasp)
        T[2, 3] += self.task.lift
        return T

    def _ways(self, T_via: FloatArray, T_pre: FloatArray, T_grasp: FloatArray) -> list[Trajectory]:
        """From here before the slot, to the pre-grasp, and along a line to the grasp, from where the lines out of the slot go too."""
        task = self.task
        onwards: dict[bytes, list[Trajectory]] = {}
        reasons: list[str] = []

        def goes_on(q_via: FloatArray) -> bool:
            try:
                ahead = self.mover.plan(q_via, T_pre)
                reach = self.mover.line(ahead.q[-1], T_grasp)
                up = self.mover.line(reach.q[-1], self._lifted(T_grasp))
                self.mover.line(up.q[-1], task.back(self._lifted(T_grasp), task.approach))
                onwards[np.asarray(q_via).tobytes()] = [ahead, reach]
            except PieperError as cause:
                reasons.append(str(cause))
                return False
            return True

        try:
            first = self.mover.plan(self.robot.reference.q, T_via, goes_on)
        except PieperError as cause:
            if self.cancelled:
                raise _CancelledError("cancelled") from cause
            raise StageFailedError(reasons[0] if reasons else str(cause)) from cause
        return [first, *onwards[first.q[-1].tobytes()]]

    def _place(self) -> None:
        task, robot = self.task, self.robot
        with self._stage(STAGES[6]):
            for way in self._ways_to_bin():
                self._follow(way)
        with self._stage(STAGES[7]):
            self._held = None
            self._open()
            self._wait(self._lies_in_bin(), f"{self._target} does not come to rest in the bin")
            p = robot.pose(self._target)[:3, 3]
            if not ((p >= task.bin_region[0]) & (p <= task.bin_region[1])).all():
                raise StageFailedError(f"{self._target} lies at ({p[0]:.2f}, {p[1]:.2f}, {p[2]:.2f}) m, not in the bin")

    def _lies_in_bin(self) -> Callable[[], bool]:
        """Whether the target is below the rim of the bin and has stayed in its place for a while, as a question."""
        robot, task = self.robot, self.task
        since, place = [robot.time], [robot.pose(self._target)[:3, 3]]

        def question() -> bool:
            p = robot.pose(self._target)[:3, 3]
            if np.linalg.norm(p - place[0]) > _STAYS or p[2] > task.bin_region[1, 2]:
                since[0], place[0] = robot.time, p
            return robot.time - since[0] > _FOR

        return question

    def _ways_to_bin(self) -> list[Trajectory]:
        """Away from the slot, less or more far, and from there to the bin."""
        q = self.robot.reference.q
        T_pre = self.robot.arm.fk(q)
        reason = ""
        for share in (1.0, 0.6, 1.4, 0.3):
            T_away = self.task.back(T_pre, share * self.task.clearance)
            for leave in (self.mover.plan, self.mover.line):
                try:
                    away = leave(q, T_away)
                    return [away, self.mover.plan(away.q[-1], self.task.drop_of(self._target))]
                except PieperError as cause:  # noqa: PERF203  a handful of ways
                    if self.cancelled:
                        raise _CancelledError("cancelled") from cause
                    reason = reason or str(cause)
        raise StageFailedError(reason)

    def _recover(self, *, again: bool) -> bool:
        """Draw back with open fingers; False when even that failed."""
        self._held = None
        try:
            with self._stage("recover"):
                self.robot.stop()
                self._tolerated = self.robot.collisions()
                self._wait(lambda: not self.robot.is_moving, "the arm does not stop")
                self._open()
                q = self.robot.reference.q
                if self._in_slot():
                    self._follow(self.mover.line(q, self.task.back(self.robot.arm.fk(q), self.task.approach)))
                if not again:
                    self._follow_home()
        except StageFailedError:
            return False
        finally:
            self._tolerated = frozenset()
        return True

    def _in_slot(self) -> bool:
        """Whether the hand is nearer to the target's slot than the approach is long."""
        T = self.task.grasp_at(self.task.scene.object(self._target).T_world_object)
        return bool(np.linalg.norm(self.robot.tip()[:3, 3] - T[:3, 3]) < self.task.approach)

    def _follow_home(self) -> None:
        from pieper.motion.joint_move import joint_move

        q = self.robot.reference.q
        T_away = self.task.back(self.robot.arm.fk(q), self.task.clearance)
        try:
            self._follow(self.mover.plan(q, T_away))
        except StageFailedError:
            raise
        except PieperError:  # nothing to draw back to: from here, then
            pass
        self._follow(joint_move(self.robot.chain, self.robot.reference.q, self.task.q_home))

    # --- beneath the stages

    def _seen(self) -> FloatArray:
        """Where the target is, if it can be gripped."""
        T = self.look(self._target)
        if T is None:
            raise StageFailedError(f"{self._target} is not seen", lost=True)
        T = np.asarray(T)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise StageFailedError(f"the pose of {self._target} must be a finite (4, 4) array, got {T.tolist()}")
        tilt = float(np.arccos(np.clip(T[2, 2], -1.0, 1.0)))
        if tilt > MOST_TILT:
            raise StageFailedError(
                f"{self._target} has fallen over: it leans by {np.degrees(tilt):.0f} deg and cannot be gripped"
            )
        wide = self._width()
        if wide > 0.95 * self.task.gripper.stroke:
            raise StageFailedError(
                f"{self._target} is {wide:.3f} m wide, too wide for fingers that open {self.task.gripper.stroke:.3f} m"
            )
        if wide < 2.0 * self.task.gripper.narrowest:
            raise StageFailedError(
                f"{self._target} is {wide:.3f} m wide, too thin for fingers that know {self.task.gripper.narrowest:.3f} m from nothing"
            )
        return T

    def _width(self) -> float:
        """Of the target, between the fingers [m]."""
        solid = self.task.scene.object(self._target).solid
        if isinstance(solid, Box):
            return float(np.abs(self.task.T_object_grasp[:3, 1]) @ solid.size)
        if isinstance(solid, Cylinder) and abs(self.task.T_object_grasp[2, 1]) > 0.5:
            return solid.length
        return 2.0 * solid.radius

    def _open(self) -> None:
        self.gripper.open()
        self._wait(lambda: self.gripper.state is GripperState.OPEN, "the fingers do not open", guard=False)

    def _follow(self, trajectory: Trajectory) -> None:
        self.robot.follow(trajectory)
        self._wait(lambda: self.robot.at_rest, "the arm does not come to rest", longest=trajectory.duration + PATIENCE)

    def _wait(self, done: Callable[[], bool], reason: str, *, longest: float = PATIENCE, guard: bool = True) -> None:
        """Let time pass until a state is there."""
        robot = self.robot
        end, ticks = robot.time + longest, 0
        while not done():
            if self.cancelled:
                raise _CancelledError("cancelled")
            robot.step(robot.timestep)
            ticks += 1
            if guard and ticks % _GUARDED_EVERY == 0:
                self._guard()
            if robot.time > end:
                raise StageFailedError(f"{reason}, after {longest:.0f} s")

    def _guard(self) -> None:
        """What must not happen while the arm moves: it touches something, or loses what it holds."""
        touched = self.robot.collisions() - self._tolerated
        if touched:
            self.robot.stop()
            one, other = min(touched)
            raise StageFailedError(f"{one} touches {other}")
        if self._held is None:
            return
        T = np.linalg.inv(self.robot.tip()) @ self.robot.pose(self._held.name)
        moved = float(np.linalg.norm(T[:3, 3] - self._held.T_tip_object[:3, 3]))
        if self.gripper.state is GripperState.EMPTY or moved > _LOOSE:
            self.robot.stop()
            raise StageFailedError(
                f"the grasp slipped: {self._held.name} is {1e3 * moved:.0f} mm from its place in the hand", lost=True
            )

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        start = self.robot.time
        try:
            if self.cancelled:
                raise _CancelledError("cancelled")
            yield
        except StageFailedError as failed:
            self._record(name, False, str(failed), start)
            raise
        except PieperError as cause:
            self._record(name, False, str(cause), start)
            raise (_CancelledError if self.cancelled else StageFailedError)(str(cause)) from cause
        self._record(name, True, "", start)

    def _record(self, name: str, succeeded: bool, reason: str, start: float) -> None:
        stage = Stage(self._cycle, self._target, name, succeeded, reason, start, self.robot.time)
        self.stages.append(stage)
        if self.log is not None:
            self.log(stage)


def _upright(T: FloatArray) -> FloatArray:
    """The pose without its lean: a hand that comes in level grips what leans a little, and five joints cannot lean with it."""
    return at(*map(float, T[:3, 3]), yaw=float(np.arctan2(T[1, 0] - T[0, 1], T[0, 0] + T[1, 1])))
