"""One arm, prepared for inverse kinematics: which method suits its axes, and the call that uses it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper._native import kernels
from pieper.errors import ArrayError, unknown_name
from pieper.ik import general_6r
from pieper.ik.branches import Branches, name_branches
from pieper.ik.family import Family, find_family
from pieper.ik.numeric import require_counts, require_tolerances, solve_numeric
from pieper.ik.question import ask
from pieper.ik.solutions import IKSolutions, Nearest, Status
from pieper.ik.target import Target

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

METHODS = ("closed form", "general", "numeric")

_MODES = {name: kernels.GeneralMode[name] for name in general_6r.MODES}

_SAME = 1e-5
"""[rad or m] Answers of two methods that are no further apart are one."""

_TIGHT = 1e-9
"""[m or rad] With tolerances beyond this a target out of reach may still be near enough, which iteration finds out."""

_FURTHER = 8
"""Answers to look for by iteration where a method that lists all of them has doubts."""

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class IKInfo:
    """How an arm is solved.

    Attributes
    ----------
    method : str
        ``"closed form"``, ``"general"`` (the polynomial of six revolute joints) or ``"numeric"``.
    structure : str
        What was found in the joint axes, in words.
    level : str
        ``"exact"`` or ``"rounded"`` for a closed form, see `pieper.ik.family`; else ``""``.
    deviation : float
        The largest amount by which a relation between the axes is off [rad, or m in units of the size of the arm].
    max_solutions : int
        Isolated answers that one pose can have at most; 0 where that is not known.
    complete : bool
        True when every isolated answer of a pose is listed.
    self_test : str
        What the method did on poses of the arm itself when it was chosen.
    branch_names : tuple of str
        What the branches are called, as in `IKSolutions.labels`.
    """

    method: str
    structure: str
    level: str
    deviation: float
    max_solutions: int
    complete: bool
    self_test: str
    branch_names: tuple[str, ...]

    def __str__(self) -> str:
        how = {"closed form": "in closed form", "general": "by its polynomial", "numeric": "by iteration"}[self.method]
        every = "every answer is listed" if self.complete else "some answers are found"
        return f"solved {how}, {every}: {self.structure}" + (f"; {self.self_test}" if self.self_test else "")


class Solver:
    """An arm and the method that solves it, chosen once from its joint axes.

    Parameters
    ----------
    chain : Chain

    Examples
    --------
    >>> from pieper.model import catalog
    >>> print(Solver(catalog.describe("crx10ia").chain()).info.method)
    general
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.family: Family = find_family(chain)
        self.method = "numeric"
        self._branches = Branches((), ())
        self._form: kernels.ClosedForm | None = None
        if self.family.complete:
            self.method = "closed form"
            self._branches = name_branches(chain, self.family)
            self._form = self.family.native
            self._form.name_branches(self._branches.of_slot)
        elif general_6r.fits(chain):
            self.method = "general"

    @cached_property
    def info(self) -> IKInfo:
        """How the arm is solved, in words."""
        family, test = self.family, self.family.self_test
        if self.method == "closed form" and test is not None:
            doubtful = f", {100.0 * test.doubtful:.3g} % of them solved twice" if test.doubtful else ""
            tested = f"self-test: all of 200 random poses{doubtful} and 64 at right angles, worst error {test.worst_error:.1e}"
            return IKInfo(
                self.method,
                family.reason,
                family.level,
                family.deviation,
                family.max_solutions,
                True,
                tested,
                self._branches.names,
            )
        if self.method == "general":
            reports = [r for r in general_6r.prepare(self.chain).native.reports if r.rank == 0]
            tested = "".join(
                f"self-test: solved for {self.chain.joint_names[r.remaining_joint]} first, "
                f"{100.0 * r.found:.4g} % of the answers by the first of its forms"
                for r in reports
            )
            return IKInfo(self.method, family.reason, "", 0.0, general_6r.MOST_SOLUTIONS, True, tested, ())
        return IKInfo("numeric", family.reason, "", 0.0, 0, False, "", ())

    # --- the call

    def solve(
        self,
        target: ArrayLike | Target,
        seed: ArrayLike | None = None,
        *,
        method: str | None = None,
        count: int | None = None,
        mode: str = "checked",
        position_tolerance: float = 1e-9,
        rotation_tolerance: float = 1e-9,
        restarts: int = 512,
        threads: int = 1,
    ) -> IKSolutions:
        """Joint values that bring the tip to a target; see `pieper.ik.solve.solve`."""
        if method is None and count is None and mode in _MODES and self.method != "numeric":
            try:  # plain arrays of the right shape: one call of the compiled solver
                found = self._ask(self.method, target, seed, mode, position_tolerance, rotation_tolerance, threads)
            except TypeError:
                pass
            else:
                doubts, missed = found[8], found[9]
                if doubts == 0 and (missed == 0 or max(position_tolerance, rotation_tolerance) <= _TIGHT):
                    find_nearest: Callable[[IKSolutions], Nearest] = _nothing_missed
                    if missed:
                        kept = np.array(target), None if seed is None else np.array(seed)
                        find_nearest = partial(self._nearest_of, *kept, restarts, threads)
                    arrays = *found[:8], find_nearest, position_tolerance, rotation_tolerance, self._branches.names
                    return IKSolutions(self.chain, *arrays)
        return self._solve_with_care(
            target, seed, method, count, mode, (position_tolerance, rotation_tolerance), restarts, threads
        )

    def _solve_with_care(
        self,
        target: ArrayLike | Target,
        seed: ArrayLike | None,
        method: str | None,
        count: int | None,
        mode: str,
        tolerances: tuple[float, float],
        restarts: int,
        threads: int,
    ) -> IKSolutions:
        if method is not None and method not in METHODS:
            raise unknown_name("method", method, METHODS, "inverse kinematics")
        if mode not in general_6r.MODES:
            raise unknown_name("mode", mode, general_6r.MODES, "the general solver")
        chosen = method or self.method
        whole = not isinstance(target, Target) or (target.axis is None and all(target.weights))
        iterate = partial(
            solve_numeric,
            self.chain,
            position_tolerance=tolerances[0],
            rotation_tolerance=tolerances[1],
            restarts=restarts,
            threads=threads,
        )
        if chosen == "numeric" or (method is None and not whole):
            return self._numeric(iterate, target, seed, 1 if count is None else count)
        if not whole:
            raise ArrayError(f"the method {chosen!r} takes whole poses; leave the method out for a target of some rows")
        require_tolerances(*tolerances)
        require_counts(restarts=restarts, threads=threads, **({} if count is None else {"count": count}))
        question = ask(self.chain, target.T_base_tip if isinstance(target, Target) else target, seed)
        T, seeds = question.T_base_tip, question.seed
        found = self._ask(chosen, T, seeds, mode, *tolerances, threads)
        names = self._branches.names if chosen == "closed form" else ()
        arrays = *found[:8], _nothing_missed, *tolerances, names
        answers = IKSolutions(self.chain, *arrays)
        self._look_again(answers, T, seeds, iterate)
        wanted = (
            Target(T, target.weights, target.position_axes, target.rotation_axes) if isinstance(target, Target) else T
        )
        answers.find_nearest = partial(self._nearest_of, wanted, seeds, restarts, threads)
        _mark_malformed(answers, question.malformed)
        return answers if count is None else _first(answers, count)

    # --- the methods

    def _ask(
        self,
        method: str,
        T: Any,
        seeds: Any,
        mode: str,
        position_tolerance: float,
        rotation_tolerance: float,
        threads: int,
    ) -> tuple[Any, ...]:
        """One call of a compiled solver: the first eight fields of `IKSolutions` after the chain, and two counts."""
        native = self.chain.native
        if method == "closed form":
            form = self._form
            if form is None:
                raise ArrayError(f"chain {self.chain.name!r} has no closed form: {self.family.reason}")
            return native.answer_by_closed_form(form, T, seeds, position_tolerance, rotation_tolerance, threads)
        prepared = self._general
        return native.answer_by_polynomial(
            prepared, _MODES[mode], T, seeds, position_tolerance, rotation_tolerance, threads
        )

    @cached_property
    def _general(self) -> kernels.NativeGeneral6R:
        return general_6r.prepare(self.chain).native

    def _numeric(self, iterate: Any, target: ArrayLike | Target, seed: ArrayLike | None, count: int) -> IKSolutions:
        if isinstance(target, Target):
            return iterate(target, seed=seed, count=count)  # type: ignore[no-any-return]
        try:
            return iterate(target, seed=seed, count=count)  # type: ignore[no-any-return]
        except ArrayError:
            question = ask(self.chain, target, seed)
            if not question.malformed:
                raise
        answers: IKSolutions = iterate(question.T_base_tip, seed=question.seed, count=count)
        _mark_malformed(answers, question.malformed)
        return answers

    # --- what follows

    def _look_again(self, answers: IKSolutions, T: FloatArray, seeds: FloatArray | None, iterate: Any) -> None:
        """Solves again, by another method, what is doubtful; and by iteration what is missed but may be near enough."""
        loose = max(answers.position_tolerance, answers.rotation_tolerance) > _TIGHT
        none = answers.status == Status.unreachable
        again = ~answers.complete if not loose else ~answers.complete | none
        if not again.any():
            return
        more: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        some = None if seeds is None else seeds[again]
        if general_6r.fits(self.chain) and answers.branch_names:
            second = general_6r.solve_general_6r(self.chain, T[again], mode="complete")
            more.append((second.q, second.position_error, second.rotation_error))
            certain = np.asarray((second.flags & general_6r.Flag.doubtful) == 0)
        else:
            certain = np.zeros(int(again.sum()), dtype=bool)
        if not certain.all() or loose:
            further = iterate(T[again], seed=some, count=_FURTHER)
            more.append((further.q, further.position_error, further.rotation_error))
        self._add(answers, again, T, some, more)
        answers.complete[again] = certain

    def _add(
        self,
        answers: IKSolutions,
        rows: BoolArray,
        T: FloatArray,
        seeds: FloatArray | None,
        more: list[tuple[FloatArray, FloatArray, FloatArray]],
    ) -> None:
        """Joins further answers to those that there are, each once, as many as there are places."""
        places = answers.valid.shape[-1]
        q = np.concatenate([answers.q[rows], *(m[0] for m in more)], axis=1)
        position = np.concatenate([answers.position_error[rows], *(m[1] for m in more)], axis=1)
        rotation = np.concatenate([answers.rotation_error[rows], *(m[2] for m in more)], axis=1)
        branch = np.full(position.shape, -1, dtype=np.int8)
        branch[:, :places] = answers.branch[rows]
        turning = self.chain.is_revolute
        for k in range(places, q.shape[1]):
            apart = q[:, :k] - q[:, k : k + 1]
            apart = np.where(turning, np.remainder(apart + np.pi, 2.0 * np.pi) - np.pi, apart)
            with np.errstate(invalid="ignore"):
                known = (np.abs(apart).max(axis=-1) < _SAME).any(axis=-1)
            position[known, k] = np.nan
        joined: Any = self.chain.native.arrange(
            q, position, rotation, branch, T[rows], seeds, answers.position_tolerance, answers.rotation_tolerance
        )
        fields = ("q", "valid", "position_error", "rotation_error", "within_limits", "branch")
        for name, values in zip(fields, joined, strict=False):
            getattr(answers, name)[rows] = values[:, :places]
        answers.status[rows] = joined[-1]

    def _nearest_of(
        self, target: FloatArray | Target, seeds: FloatArray | None, restarts: int, threads: int, answers: IKSolutions
    ) -> Nearest:
        """The nearest poses of the targets that have no answer inside limits."""
        near = _nothing_missed(answers)
        missed = (answers.status != Status.reached) & (answers.status != Status.malformed)
        if not missed.any():
            return near
        wanted: FloatArray | Target
        if isinstance(target, Target):
            wanted = Target(target.T_base_tip[missed], target.weights, target.position_axes, target.rotation_axes)
        else:
            wanted = target[missed]
        found = solve_numeric(
            self.chain,
            wanted,
            seed=None if seeds is None else seeds[missed],
            position_tolerance=answers.position_tolerance,
            rotation_tolerance=answers.rotation_tolerance,
            restarts=restarts,
            threads=threads,
        )
        there = found.valid[..., 0]  # an answer after all, which the other method did not find
        near.q[missed] = np.where(there[:, None], found.q[:, 0], found.nearest.q)
        near.position_error[missed] = np.where(there, found.position_error[:, 0], found.nearest.position_error)
        near.rotation_error[missed] = np.where(there, found.rotation_error[:, 0], found.nearest.rotation_error)
        near.out_of_reach[missed] = np.where(there, 0.0, found.nearest.out_of_reach)
        return near


def _nothing_missed(answers: IKSolutions) -> Nearest:
    shape = answers.status.shape
    return Nearest(np.full((*shape, answers.chain.dof), np.nan), *(np.full(shape, np.nan) for _ in range(3)))


def _mark_malformed(answers: IKSolutions, malformed: dict[tuple[int, ...], str]) -> None:
    """Takes the answers away from rows that held no pose."""
    for index in malformed:
        for values in (answers.q, answers.position_error, answers.rotation_error):
            values[index] = np.nan
        answers.valid[index] = answers.within_limits[index] = False
        answers.branch[index] = -1
        answers.status[index] = Status.malformed
        answers.complete[index] = False
    answers.malformed = malformed or None


def _first(answers: IKSolutions, count: int) -> IKSolutions:
    """No more than the first `count` answers."""
    for name in ("q", "valid", "position_error", "rotation_error", "within_limits", "branch"):
        values = getattr(answers, name)
        setattr(answers, name, values[..., :count, :] if name == "q" else values[..., :count])
    return answers
