"""What a target means for an arm while it is dragged about: every solution, the one taken, and why there is none.

`Solving` holds a target and joint values and knows nothing of a browser. Each call gives a `Solved`, a picture of the
state that stays as it is; malformed numbers change nothing and are told in words, because they come from people who type.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError, PieperError, unknown_name
from pieper.ik.target import Target, ignore_orientation, position_and_axis
from pieper.kinematics.joints import LARGEST, periodic_joints
from pieper.spatial import rotation

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.arm import Arm
    from pieper.ik.curve import SolutionCurve
    from pieper.ik.solutions import IKSolutions
    from pieper.spatial._checks import FloatArray

Kind = Literal["pose", "position", "axis"]

KINDS: tuple[Kind, ...] = ("pose", "position", "axis")
"""What of the target counts: all of it, its position, or its position and the direction of one tool axis."""

AXES = ("x", "y", "z")
"""Tool axes that a target of the kind ``"axis"`` can ask for."""

_TURN = 2.0 * np.pi
_SAME = 1e-6  # [rad or m] solutions that differ by less are one
_LIMIT_ROUNDING = 1e-9  # [rad or m] by which the solvers let a limit be passed
_NUMBER = "number "  # begins the labels of branches without names
_FARTHEST_PLACE = 1e6  # [rad or m] along a closed curve many rounds are no nonsense, but numbers that overflow are
_FAR = 1.0  # [rad or m] a joint that moves by more while the target is dragged is worth a word
_FEW = 8  # starting points for a target that is being dragged
_NO_POSE = 1e-3  # a typed or dragged quaternion is never this far from a rotation; a matrix that is was meant otherwise


@dataclass(frozen=True, eq=False)
class Solved:
    """The solutions of a target at one moment.

    Attributes
    ----------
    kind : "pose", "position" or "axis"
        What of the target counts.
    T_base_target : (4, 4) array
        The target in the base frame [m, -].
    q : (k, n) array
        The solutions that are shown, each as the copy nearest to the one taken before [rad or m].
    labels : tuple of k str
        Their branches in words, or their numbers where branches have no names.
    inside : (k,) bool array
        True for those within the joint limits.
    chosen : int or None
        The one that is taken; None where nothing within limits meets the target and none was chosen by hand.
    nearest : (n,) array or None
        The joint values within limits that come nearest where `chosen` is None.
    position_error, rotation_error : float
        What those leave [m] and [rad]; 0 where a solution is taken.
    reason : str
        What became of the target, in words.
    notice : str
        What else to say: a branch that was left, or a number that was refused. Mostly empty.
    count : int
        Number of solutions that were found; `q` holds some of them where there are more than are shown.
    free : int
        Number of directions in which solutions can be moved while the target stays met.
    """

    kind: Kind
    T_base_target: FloatArray
    q: FloatArray
    labels: tuple[str, ...]
    inside: NDArray[np.bool_]
    chosen: int | None
    nearest: FloatArray | None
    position_error: float
    rotation_error: float
    reason: str
    notice: str
    count: int
    free: int

    @property
    def reached(self) -> bool:
        """True when a solution within the limits is taken."""
        return self.chosen is not None and bool(self.inside[self.chosen])

    @property
    def q_shown(self) -> FloatArray | None:
        """(n,) joint values to draw: the solution taken, else the nearest pose; None where there is neither."""
        return self.nearest if self.chosen is None else np.asarray(self.q[self.chosen])

    @property
    def ghosts(self) -> FloatArray:
        """(k - 1, n) or (k, n): the solutions that are not taken."""
        return np.asarray(self.q if self.chosen is None else np.delete(self.q, self.chosen, axis=0))

    @property
    def sentence(self) -> str:
        """One line for people: what is shown, and what there is to know about it."""
        said = self.reason
        if self.chosen is not None:
            where = "" if self.inside[self.chosen] else "outside the joint limits; "
            of = f"{self.chosen + 1} of {len(self.q)}" + (
                f" shown, {self.count} found" if self.count > len(self.q) else ""
            )
            said = f"solution {of}: {self.labels[self.chosen]}; {where}{self.reason}"
        return f"{said}. {self.notice}" if self.notice else said


class Solving:
    """A target of an arm, and the solution of it that is taken.

    The solution taken is the nearest one within the limits, and stays on its branch while the target moves. Where the branch
    ends the nearest of another branch is taken, and `Solved.notice` says so.

    Parameters
    ----------
    arm : Arm
    q : (n,) array, optional
        Joint values where it begins [rad or m]; the target is the pose of the tip there. The middle of the limits when not given.
    kind : "pose", "position" or "axis", optional
        What of the target counts. The default is what the arm can do in general: a pose with six joints and more, a position
        with fewer.
    axis : "x", "y" or "z"
        Which axis of the tip a target of the kind ``"axis"`` asks for.
    most : int
        Solutions to show at most. Where they form curves and surfaces as many samples are shown, far from each other.
    keep_branch : bool
        Whether the solution taken stays on its branch as long as that has one; else the nearest one is taken.

    Examples
    --------
    >>> import pieper
    >>> solving = Solving(pieper.load("ur5e"), [0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> solving.solved.labels[solving.solved.chosen], len(solving.solved.ghosts)
    ('front, elbow up, flip', 7)
    >>> solving.move_to([0.3, 0.2, 5.0], [0.0, 0.0, 0.0]).reason
    'out of reach by 3.89 m; the nearest pose found leaves 3.9 m and 0.262 rad'
    """

    def __init__(
        self,
        arm: Arm,
        q: ArrayLike | None = None,
        *,
        kind: Kind | None = None,
        axis: str = "z",
        most: int = 16,
        keep_branch: bool = True,
    ) -> None:
        self.arm = arm
        self.most = most
        self.keep_branch = keep_branch
        usual: Kind = "pose" if arm.dof >= 6 else "position"
        self.kind: Kind = _known_kind(kind or usual)
        self.axis = _known_axis(axis)
        self._turning = periodic_joints(arm.chain)
        self._held = _held_joint(arm)  # the joint whose value stays while a seven-joint arm is dragged, or None
        self._curve: SolutionCurve | None = None
        self._label = ""
        self._samples = np.empty((0, arm.dof))  # of a curve or surface, to be moved along with the target
        start = middle(arm) if q is None else np.array(q, dtype=np.float64)
        self.q = start
        """Joint values of the solution that was taken last [rad or m]."""
        self.solved = self.put(start)
        """What the last call gave."""

    # --- where the target is

    def put(self, q: ArrayLike) -> Solved:
        """Move the arm, and the target with it: the target is where the tip is at `q`, (n,) [rad or m]."""
        values = np.asarray(q, dtype=np.float64)
        if values.shape != (self.arm.dof,) or not (np.abs(values) <= LARGEST).all():
            return self._refuse(f"{self.arm.name} takes {self.arm.dof} finite joint values, got {_shown(values)}")
        self.q, self._label = values, ""
        solved = self._solve(self.arm.fk(values), dragging=False, stay=False)
        if self._is_inside(values) and not (np.abs(self.q - values) <= _SAME).all():
            self.solved = self._with(values, solved)  # one of a curve, which the samples are not
        return self.solved

    def move_to(
        self,
        position: ArrayLike,
        rpy: ArrayLike | None = None,
        *,
        xyzw: ArrayLike | None = None,
        dragging: bool = False,
    ) -> Solved:
        """Move the target.

        Parameters
        ----------
        position : (3,) array
            In the base frame [m].
        rpy : (3,) array, optional
            Roll, pitch and yaw [rad]; the orientation stays where neither this nor `xyzw` is given.
        xyzw : (4,) array, optional
            The orientation as a quaternion, scalar last, of any length but 0.
        dragging : bool
            True while the target moves in small steps: samples of curves and surfaces then move along instead of being
            drawn anew.

        Returns
        -------
        Solved
            Numbers that are not finite change nothing, and its `notice` tells them.
        """
        p = np.asarray(position, dtype=np.float64)
        if p.shape != (3,) or not (np.abs(p) <= LARGEST).all():
            return self._refuse(f"a position is three finite numbers [m], got {_shown(p)}")
        T = self._T.copy()
        T[:3, 3] = p
        if rpy is not None:
            angles = np.asarray(rpy, dtype=np.float64)
            if angles.shape != (3,) or not (np.abs(angles) <= LARGEST).all():
                return self._refuse(f"an orientation is three finite angles, roll, pitch and yaw, got {_shown(angles)}")
            T[:3, :3] = rotation.from_rpy(angles)
        elif xyzw is not None:
            quaternion = np.asarray(xyzw, dtype=np.float64)
            if quaternion.shape != (4,) or not np.isfinite(quaternion).all() or not np.abs(quaternion).max() > _NO_POSE:
                return self._refuse(f"an orientation is a quaternion of four finite numbers, got {_shown(quaternion)}")
            T[:3, :3] = rotation.from_quaternion(quaternion)
        return self._solve(T, dragging=dragging)

    def ask_for(self, kind: Kind, *, axis: str | None = None) -> Solved:
        """Choose what of the target counts, and for the kind ``"axis"`` which axis of the tip."""
        self.kind = _known_kind(kind)
        self.axis = self.axis if axis is None else _known_axis(axis)
        return self._solve(self._T, dragging=False, stay=False)

    # --- which solution

    def choose(self, number: int) -> Solved:
        """Take a solution by its place in `Solved.q`, within limits or not; it stays on that branch from now on."""
        count = len(self.solved.q)
        if not count:
            return self._refuse("there is no solution to take")
        self._take(number % count, self.solved)
        return self.solved

    def step(self, by: int = 1) -> Solved:
        """Take the next solution, or with -1 the one before, round and round."""
        now = self.solved.chosen
        return self.choose((-1 if by > 0 else 0) + by if now is None else now + by)

    # --- along the curve of a free arm

    @property
    def curve(self) -> SolutionCurve | None:
        """The curve of solutions that the one taken is on; None where it cannot move while the target stays met.

        Found when first asked for at a target, in some hundredths of a second. Surfaces of solutions are not followed.
        """
        if self._curve is None and self.solved.chosen is not None:
            from pieper.ik.curve import follow

            try:
                self._curve = follow(self.arm.chain, self._target(self._T), self.q)
            except ArrayError:  # a surface; the solutions that are shown are all there is to say
                return None
        return self._curve

    def span(self) -> tuple[float, float, float] | None:
        """From where to where the arm can move on its curve, and where it is: places along it [rad or m]; None without one.

        The ends are those of the part inside the joint limits that the arm is on, or of the whole curve where it is outside.
        On a closed curve the end of a part may be beyond the length, and a part that is the whole curve is one round.
        """
        curve = self.curve
        if curve is None:
            return None
        here = float(curve.place(self.q))
        if not np.isfinite(here):
            return None
        for start, end in curve.intervals.tolist():
            for place in (here, here + curve.length):
                if start - _SAME <= place <= end + _SAME:
                    return start, end, min(max(place, start), end)
        return 0.0, curve.length, here

    def slide(self, place: float) -> Solved:
        """Move along the curve to a place on it, as `span` counts them; the target stays met."""
        curve = self.curve
        if curve is None:
            return self._refuse("no joint can move while this target stays met")
        if not abs(place) <= _FARTHEST_PLACE:
            return self._refuse(
                f"a place along the curve is a finite number of at most {_FARTHEST_PLACE:g}, got {place}"
            )
        at = place if curve.closed else min(max(place, 0.0), curve.length)
        self.q = self._copy(np.asarray(curve.at(at)))
        if self.solved.free > 1 or self._held is None:
            # samples elsewhere stay as they are
            solutions = self.solved.q.copy()
            chosen = self.solved.chosen
            assert chosen is not None  # a curve begins at the solution taken
            solutions[chosen] = self.q
            inside = self.solved.inside.copy()
            inside[chosen] = self._is_inside(self.q)
            self.solved = replace(self.solved, q=solutions, inside=inside, notice="")
        else:
            solved = self._solve(self._T, dragging=True, stay=False)
            self.solved = solved
        self._curve = curve
        return self.solved

    # --- what the calls above share

    @property
    def _T(self) -> FloatArray:
        return self._T_base_target

    def _refuse(self, why: str) -> Solved:
        if not hasattr(self, "solved"):
            raise ArrayError(why)
        self.solved = replace(self.solved, notice=why)
        return self.solved

    def _target(self, T: FloatArray) -> Target | FloatArray:
        if self.kind == "position":
            return ignore_orientation(T[:3, 3])
        if self.kind == "axis":
            k = AXES.index(self.axis)
            return position_and_axis(T[:3, 3], T[:3, k], axis_tip=np.eye(3)[k])
        return T

    def _solve(self, T: FloatArray, *, dragging: bool, stay: bool = True) -> Solved:
        self._T_base_target = T
        self._curve = None
        try:
            solved = self._answer(T, dragging=dragging, stay=stay)
        except PieperError as problem:  # said by the solver about this arm and target; the window stays open
            solved = self._nothing(T, str(problem))
        self.solved = solved
        return solved

    def _answer(self, T: FloatArray, *, dragging: bool, stay: bool) -> Solved:
        target = self._target(T)
        found = self._follow(target) if dragging else None
        if found is None:
            found = self._find(target)
        answers, q, labels, inside, free = found
        before = self.q
        count = len(q)
        if not inside.any():
            near = answers.nearest
            known = bool(np.isfinite(near.q).all())
            order = self._some(q, None)
            return Solved(
                self.kind, T, q[order], _some_labels(labels, order), inside[order], None, near.q if known else None,
                float(near.position_error) if known else 0.0, float(near.rotation_error) if known else 0.0,
                answers.reason, "", count, free,
            )  # fmt: skip
        chosen, notice = self._pick(q, labels, inside, stay=stay)
        order = self._some(q, chosen)
        reason = _reached(answers)
        solved = Solved(
            self.kind, T, q[order], _some_labels(labels, order), inside[order], None, None, 0.0, 0.0, reason, notice,
            count, free,
        )  # fmt: skip
        solved = self._taken(order.index(chosen), solved)
        self._samples = solved.q if free else self._samples[:0]
        return self._jumped(before, solved) if dragging and stay and not notice else solved

    def _jumped(self, before: FloatArray, solved: Solved) -> Solved:
        """A word where the arm turns far although the target moves little."""
        change = np.abs(self.q - before)
        joint = int(np.argmax(change))
        if change[joint] <= _FAR:
            return solved
        amount = f"{np.degrees(change[joint]):.0f} deg" if self._turning[joint] else f"{change[joint]:.2f} m"
        return replace(solved, notice=f"The arm has to go far here: {self.arm.joint_names[joint]} by {amount}")

    def _find(self, target: Target | FloatArray) -> tuple[IKSolutions, FloatArray, list[str], NDArray[np.bool_], int]:
        """Every solution, and for arms with seven joints every one with the joint that is held where it is."""
        arm, q_now = self.arm, self.q
        if self._held is not None and self.kind == "pose":
            joint = self._held
            lower, upper = arm.limits[joint]
            value = float(np.clip(q_now[joint], lower, upper))
            answers = arm.ik(target, q_now, redundancy=[value])
            if not answers.within_limits.any():
                answers = arm.ik(target, q_now)
                if answers.within_limits.any():
                    q = answers.q[answers.within_limits]
                    best = q[int(np.argmin(np.linalg.norm(q - q_now, axis=-1)))]
                    at_value = arm.ik(target, best, redundancy=[float(np.clip(best[joint], lower, upper))])
                    answers = at_value if at_value.within_limits.any() else answers
            q, labels, inside = self._listed(answers)
            return answers, q, labels, inside, 1
        answers = arm.ik(target, q_now)
        if answers.valid.shape[-1] == 1 and answers.valid.any():  # a method that gives one unless asked for more
            answers = arm.ik(target, q_now, count=self.most)
        q, labels, inside = self._listed(answers)
        return answers, q, labels, inside, answers.free

    def _listed(self, answers: IKSolutions) -> tuple[FloatArray, list[str], NDArray[np.bool_]]:
        """The solutions in an order that stays while the target moves: by branch, or like those before."""
        valid = answers.valid
        q, inside = answers.q[valid], answers.within_limits[valid]
        names = [str(name) for name in answers.labels[valid]]
        if answers.branch_names and all(names):
            order = np.argsort(answers.branch[valid], kind="stable")
            return q[order], [names[i] for i in order], inside[order]
        order = self._like_before(q)
        return q[order], [names[i] for i in order], inside[order]

    def _like_before(self, q: FloatArray) -> NDArray[np.intp]:
        before = self.solved.q if hasattr(self, "solved") else np.empty((0, self.arm.dof))
        if not len(before) or not len(q) or len(q) > 4 * self.most:
            return np.lexsort(q.T[::-1])
        from scipy.optimize import linear_sum_assignment

        apart = np.linalg.norm(self._wrapped(q[:, None] - before), axis=-1)
        rows, columns = linear_sum_assignment(apart)
        place = np.full(len(q), len(before) + 1)
        place[rows] = columns
        return np.argsort(place, kind="stable")

    def _follow(
        self, target: Target | FloatArray
    ) -> tuple[IKSolutions, FloatArray, list[str], NDArray[np.bool_], int] | None:
        """The same samples of a curve or surface, moved along with the target; None where that is not the way.

        Where none of them comes along the answer is that of a few iterations, and who lets go of the target gets all of it.
        """
        before, seeds = self.solved, self._samples
        if not len(seeds) or before.kind != self.kind or (self._held is not None and self.kind == "pose"):
            return None
        wanted = target if isinstance(target, Target) else Target(target)
        many = replace(wanted, T_base_tip=np.repeat(wanted.T_base_tip[None], len(seeds), axis=0))
        answers = self.arm.ik(many, np.clip(seeds, *self.arm.limits.T), count=1, method="numeric", restarts=1)
        inside = np.array(answers.within_limits[:, 0])
        if not inside.any():
            one = self.arm.ik(target, np.clip(self.q, *self.arm.limits.T), count=1, method="numeric", restarts=_FEW)
            reached = one.within_limits
            return one, one.q[reached], [""] * int(reached.sum()), reached[reached], before.free
        q = answers.q[:, 0][inside]
        one = replace(answers)
        for name in ("q", "valid", "position_error", "rotation_error", "within_limits", "branch", "status", "complete"):
            setattr(one, name, getattr(answers, name)[int(np.argmax(inside))])
        return one, q, [""] * len(q), inside[inside], before.free

    def _pick(self, q: FloatArray, labels: list[str], inside: NDArray[np.bool_], *, stay: bool) -> tuple[int, str]:
        """The solution to take, and what to say about leaving a branch."""
        distance = np.where(inside, np.linalg.norm(q - self.q, axis=-1), np.inf)
        nearest = int(np.argmin(distance))
        if not stay or not self._label:
            return nearest, ""
        same = np.flatnonzero(inside & np.array([label == self._label for label in labels], dtype=bool))
        if self.keep_branch and len(same):
            return int(same[np.argmin(distance[same])]), ""
        if labels[nearest] != self._label:
            taken = f"{labels[nearest]!r} is the nearest" if labels[nearest] else "the nearest solution has no name"
            return nearest, f"The branch {self._label!r} ends here; {taken}"
        return nearest, ""

    def _some(self, q: FloatArray, chosen: int | None) -> list[int]:
        """Which solutions to show: all, or the one taken and others far from each other, in their order."""
        if len(q) <= self.most:
            return list(range(len(q)))
        first = 0 if chosen is None else chosen
        kept = [first]
        apart = np.abs(self._wrapped(q - q[first])).max(axis=-1)
        while len(kept) < self.most:
            kept.append(int(np.argmax(apart)))
            apart = np.minimum(apart, np.abs(self._wrapped(q - q[kept[-1]])).max(axis=-1))
        return sorted(kept)

    def _take(self, number: int, solved: Solved) -> None:
        self.solved = self._taken(
            number, replace(solved, notice="", nearest=None, position_error=0.0, rotation_error=0.0)
        )
        self._curve = None

    def _taken(self, number: int, solved: Solved) -> Solved:
        self.q = np.array(solved.q[number])
        label = solved.labels[number]
        self._label = "" if label.startswith(_NUMBER) else label
        return replace(solved, chosen=number)

    def _with(self, q: FloatArray, solved: Solved) -> Solved:
        """The same with `q` among the solutions, and taken."""
        self.q = q
        self._label = ""
        return replace(
            solved,
            q=np.concatenate([solved.q, q[None]]),
            labels=(*solved.labels, f"{_NUMBER}{len(solved.q) + 1}"),
            inside=np.append(solved.inside, True),
            chosen=len(solved.q),
            nearest=None,
            count=max(solved.count, len(solved.q) + 1),
        )

    def _nothing(self, T: FloatArray, why: str) -> Solved:
        none = np.empty((0, self.arm.dof))
        return Solved(self.kind, T, none, (), np.empty(0, dtype=bool), None, None, 0.0, 0.0, why, "", 0, 0)

    def _is_inside(self, q: FloatArray) -> bool:
        lower, upper = self.arm.limits.T
        return bool(((q >= lower - _LIMIT_ROUNDING) & (q <= upper + _LIMIT_ROUNDING)).all())

    def _wrapped(self, difference: FloatArray) -> FloatArray:
        return np.asarray(difference - np.where(self._turning, _TURN * np.round(difference / _TURN), 0.0))

    def _copy(self, q: FloatArray) -> FloatArray:
        """The copy of `q` by whole turns nearest to where the arm is, inside the limits where one is."""
        lower, upper = self.arm.limits.T
        lowest, highest = (
            np.ceil((lower - _LIMIT_ROUNDING - q) / _TURN),
            np.floor((upper + _LIMIT_ROUNDING - q) / _TURN),
        )
        wanted = np.round((self.q - q) / _TURN)
        turns = np.where(highest < lowest, wanted, np.clip(wanted, lowest, np.maximum(lowest, highest)))
        return np.asarray(q + np.where(self._turning, _TURN * turns, 0.0))


def middle(arm: Arm) -> FloatArray:
    """(n,) joint values in the middle of the limits; 0 for joints that have none [rad or m]."""
    lower, upper = arm.limits.T
    bounded = np.isfinite(lower) & np.isfinite(upper)
    return np.asarray(np.where(bounded, 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)), 0.0))


def _held_joint(arm: Arm) -> int | None:
    if arm.ik_info.method != "redundancy":
        return None
    from pieper.ik.redundancy import prepare

    return prepare(arm.chain).joint


def _some_labels(labels: list[str], order: list[int]) -> tuple[str, ...]:
    """Labels of those that are shown; a number where a branch has no name."""
    return tuple(labels[i] or f"{_NUMBER}{place + 1}" for place, i in enumerate(order))


def _reached(answers: IKSolutions) -> str:
    """The errors that are left, of the answer within limits that has the largest."""
    inside = answers.within_limits
    position = float(np.max(answers.position_error[inside]))
    turn = float(np.max(answers.rotation_error[inside]))
    return f"reached to {position:.1g} m" + (f" and {turn:.1g} rad" if turn else "")


def _shown(values: FloatArray) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values.ravel()[:8])})"


def _known_kind(kind: str) -> Kind:
    for known in KINDS:
        if kind == known:
            return known
    raise unknown_name("kind of target", kind, KINDS)


def _known_axis(axis: str) -> str:
    if axis not in AXES:
        raise unknown_name("tool axis", axis, AXES)
    return axis
