"""One arm, prepared for inverse kinematics: which method suits its axes, and the call that uses it."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper._native import kernels
from pieper.errors import ArrayError, unknown_name
from pieper.ik import general_6r, partial
from pieper.ik import redundancy as redundancy_
from pieper.ik.branches import Branches, name_branches
from pieper.ik.family import Family, find_family, size_of
from pieper.ik.info import IKInfo
from pieper.ik.numeric import require_counts, require_tolerances, solve_numeric
from pieper.ik.question import ask
from pieper.ik.solutions import IKSolutions, Nearest, Status
from pieper.ik.target import Target
from pieper.kinematics.joints import without_turns

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

METHODS = ("closed form", "general", "redundancy", "numeric")

_MODES = {name: kernels.GeneralMode[name] for name in general_6r.MODES}

_AT_ONCE = ("closed form", "general", "redundancy")

_PLACES = ("q", "valid", "position_error", "rotation_error", "within_limits", "branch")
"""Fields of `IKSolutions` with a place for every answer, in the order of the compiled solvers."""

_EMPTY: dict[str, float] = {"q": np.nan, "position_error": np.nan, "rotation_error": np.nan, "branch": -1}
"""What a place without an answer holds; False in the others."""

_WHOLE = Target(np.eye(4))

_SAME = 1e-5
"""[rad or m] Answers of two methods that are no further apart are one."""

_TIGHT = 1e-9
"""[m or rad] With tolerances beyond this a target out of reach may still be near enough, which iteration finds out."""

_PROBES = 32
"""Poses at which the Jacobian is looked at."""

_LEAST_STRENGTH, _ORDINARY_STRENGTH = 1e-3, 0.03
"""Least singular value of the Jacobian (lengths in units of the arm), of the largest. Below the first an arm can hardly move in some
way, and answers form what is next to a curve; below the second no method is believed that there is no answer. Common arms: 0.05 to 0.1."""

_FURTHER = 8
"""Answers to look for by iteration where a method that lists all of them has doubts."""

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class _Asked:
    """The options of one call."""

    method: str | None
    mode: str
    count: int | None
    redundancy: ArrayLike | Mapping[str, ArrayLike] | None
    samples: int
    position_tolerance: float
    rotation_tolerance: float
    restarts: int
    threads: int

    @property
    def tolerances(self) -> tuple[float, float]:
        return self.position_tolerance, self.rotation_tolerance

    def check(self) -> None:
        """Raises ArrayError where a number is not of its kind."""
        require_tolerances(*self.tolerances)
        counts = {"restarts": self.restarts, "threads": self.threads, "samples": self.samples}
        require_counts(**counts, **({} if self.count is None else {"count": self.count}))

    def iterate(self, chain: Chain, target: ArrayLike | Target, *, seed: ArrayLike | None, count: int) -> IKSolutions:
        return solve_numeric(
            chain,
            target,
            seed=seed,
            count=count,
            position_tolerance=self.position_tolerance,
            rotation_tolerance=self.rotation_tolerance,
            restarts=self.restarts,
            threads=self.threads,
        )


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
        self._certain = True
        # whether no answer found means that there is none: not at singular poses of arms with a slide
        self._trusts_nothing = True
        self._branches = Branches((), ())
        self._form: kernels.ClosedForm | None = None
        self._closed_form = chain.native.answer_by_closed_form
        strength = _strength(chain) if general_6r.fits(chain) else 1.0
        stuck = strength < _LEAST_STRENGTH
        if self.family.complete and not stuck:
            self.method = "closed form"
            self._branches = name_branches(chain, self.family)
            self._form = self.family.native
            self._form.name_branches(self._branches.of_slot)
        elif general_6r.fits(chain):
            self.method = "general"
            self._certain = not stuck
            self._trusts_nothing = bool(chain.is_revolute.all()) and strength > _ORDINARY_STRENGTH
        elif redundancy_.fits(chain):
            self.method = "redundancy"

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
            return IKInfo(self.method, family.reason, "", 0.0, general_6r.MOST_SOLUTIONS, self._certain, tested, ())
        if self.method == "redundancy":
            made = redundancy_.prepare(self.chain)
            return IKInfo(self.method, made.reason, "", 0.0, made.places, False, "", ())
        return IKInfo("numeric", family.reason, "", 0.0, 0, False, "", ())

    # --- the call

    def solve(
        self,
        target: ArrayLike | Target,
        seed: ArrayLike | None = None,
        *,
        redundancy: ArrayLike | Mapping[str, ArrayLike] | None = None,
        samples: int = 16,
        method: str | None = None,
        count: int | None = None,
        mode: str = "checked",
        position_tolerance: float = 1e-9,
        rotation_tolerance: float = 1e-9,
        restarts: int = 512,
        threads: int = 1,
    ) -> IKSolutions:
        """Joint values (..., k, n) that bring the tip to a target (..., 4, 4); arguments as for `pieper.ik.solve.solve`."""
        chosen, found = method or self.method, None
        if count is None and redundancy is None and mode in _MODES:
            tolerances = position_tolerance, rotation_tolerance
            try:  # plain arrays of the right shape: one call of the compiled solver
                if chosen == "closed form" and self._form is not None:
                    found = self._closed_form(self._form, target, seed, *tolerances, threads)
                elif chosen in _AT_ONCE:
                    found = self._at_once(chosen, target, seed, mode, samples, *tolerances, threads)
            except (TypeError, ArrayError):
                pass
        if found is None:
            asked = _Asked(
                method, mode, count, redundancy, samples, position_tolerance, rotation_tolerance, restarts, threads
            )
            return self._solve_with_care(target, seed, asked)
        doubts, missed = found[8], found[9]
        names = self._branches.names if chosen == "closed form" else ()
        free = 1 if chosen == "redundancy" else 0
        if doubts == 0 and missed == 0 and self._certain:
            arrays = *found[:8], _nothing_missed, position_tolerance, rotation_tolerance, names, free
            return IKSolutions(self.chain, *arrays)
        T, seeds = np.array(target), None
        if seed is not None:
            seeds = np.ascontiguousarray(np.broadcast_to(np.array(seed), (*T.shape[:-2], self.chain.dof)))
        find_nearest = functools.partial(self._nearest_of, T, seeds, restarts, threads)
        arrays = *found[:8], find_nearest, position_tolerance, rotation_tolerance, names, free
        answers = IKSolutions(self.chain, *arrays)
        tight = self._trusts_nothing and max(position_tolerance, rotation_tolerance) <= _TIGHT
        if doubts == 0 and self._certain and tight and not free:
            return answers
        asked = _Asked(
            method, mode, count, redundancy, samples, position_tolerance, rotation_tolerance, restarts, threads
        )
        return self._finish(answers, T, seeds, T, chosen, asked)

    def _solve_with_care(self, target: ArrayLike | Target, seed: ArrayLike | None, asked: _Asked) -> IKSolutions:
        if asked.method is not None and asked.method not in METHODS:
            raise unknown_name("method", asked.method, METHODS, "inverse kinematics")
        if asked.mode not in _MODES:
            raise unknown_name("mode", asked.mode, general_6r.MODES, "the general solver")
        chosen = asked.method or self.method
        whole = not isinstance(target, Target) or (target.axis is None and all(target.weights))
        if asked.redundancy is not None and (chosen != "redundancy" or not whole):
            raise ArrayError(
                f"a value of the redundancy is for arms with seven joints and whole poses; {self.chain.name!r} has "
                f"{self.chain.dof}, solved by the method {chosen!r}{'' if whole else ', and this target is of some rows'}"
            )
        if not whole and asked.method is None:
            assert isinstance(target, Target)
            one_will_do = asked.count == 1 and seed is None
            if partial.covers(self.chain, target) and not one_will_do:
                return self._some_rows(target, seed, asked)
            chosen = "numeric"
        if chosen == "numeric":
            return self._numeric(target, seed, asked)
        if not whole:
            raise ArrayError(f"the method {chosen!r} takes whole poses; leave the method out for a target of some rows")
        asked.check()
        question = ask(self.chain, target.T_base_tip if isinstance(target, Target) else target, seed)
        T, seeds = question.T_base_tip, question.seed
        if chosen == "redundancy":
            answers = self._for_values(T, seeds, asked)
        else:
            found = self._compiled(chosen, T, seeds, asked.mode, *asked.tolerances, asked.threads)
            names = self._branches.names if chosen == "closed form" else ()
            arrays = *found[:8], _nothing_missed, *asked.tolerances, names
            answers = IKSolutions(self.chain, *arrays)
        wanted = replace(target, T_base_tip=T) if isinstance(target, Target) else T
        self._finish(answers, T, seeds, wanted, chosen, asked)
        _mark_malformed(answers, question.malformed)
        return answers if asked.count is None else _first(answers, asked.count)

    def _finish(
        self,
        answers: IKSolutions,
        T: FloatArray,
        seeds: FloatArray | None,
        target: FloatArray | Target,
        chosen: str,
        asked: _Asked,
    ) -> IKSolutions:
        """Solves again what is doubtful or missed, and sees to the nearest poses."""
        if chosen == "redundancy":
            again = np.asarray(answers.status != Status.reached) & (asked.redundancy is None)
        elif chosen == "closed form":
            again = self._singular_or_doubtful(answers, T, seeds, asked)
            if max(asked.tolerances) > _TIGHT:
                again |= answers.status == Status.unreachable
        else:
            answers.complete &= self._certain
            if not self._trusts_nothing:
                answers.complete &= answers.valid.any(axis=-1)
            again = ~answers.complete
            if max(asked.tolerances) > _TIGHT:
                again |= answers.status == Status.unreachable
        self._look_again(answers, T, seeds, asked, np.asarray(again), by_polynomial=chosen == "closed form")
        answers.find_nearest = functools.partial(self._nearest_of, target, seeds, asked.restarts, asked.threads)
        return answers

    def _singular_or_doubtful(
        self, answers: IKSolutions, T: FloatArray, seeds: FloatArray | None, asked: _Asked
    ) -> BoolArray:
        """The doubtful targets; for those at which a joint is free, adds the answer that grows out of the seed.

        There each branch is one point of a curve: another may be nearer to the seed, or alone inside the limits.
        """
        doubtful = np.array(~answers.complete)
        if not doubtful.any() or self._form is None:
            return doubtful
        unsure = self.chain.native.solve_closed_form(self._form, T[doubtful], *asked.tolerances, 1)[4]
        singular = doubtful.copy()
        singular[doubtful] = ~unsure
        doubtful = np.asarray(doubtful & ~singular)
        if seeds is None:
            singular = np.asarray(singular & (answers.status == Status.outside_limits))
        if singular.any():
            some = None if seeds is None else seeds[singular]
            near = asked.iterate(self.chain, T[singular], seed=some, count=1)
            more = [(near.q, near.position_error, near.rotation_error)]
            self._add(answers, singular, T, some, more, None)
        return doubtful

    # --- the methods

    def _at_once(
        self,
        method: str,
        T: Any,
        seeds: Any,
        mode: str,
        samples: int,
        position_tolerance: float,
        rotation_tolerance: float,
        threads: int,
    ) -> tuple[Any, ...]:
        """What `_compiled` gives, for seven joints too; TypeError where the arguments have to be looked at first."""
        if method != "redundancy":
            return self._compiled(method, T, seeds, mode, position_tolerance, rotation_tolerance, threads)
        if seeds is not None or type(T) is not np.ndarray:
            raise TypeError
        *arrays, missed = self._sampled(T, samples, position_tolerance, rotation_tolerance, threads)
        return *arrays, np.zeros(T.shape[:-2], dtype=bool), 0, missed

    def _compiled(
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

    def _sampled(
        self, T: FloatArray, samples: int, position_tolerance: float, rotation_tolerance: float, threads: int
    ) -> tuple[Any, ...]:
        """Seven joints, plain poses: the answers for some values of one joint, in the order of their use."""
        found = redundancy_.solve_redundant(
            self.chain,
            T,
            samples=samples,
            position_tolerance=position_tolerance,
            rotation_tolerance=rotation_tolerance,
            threads=threads,
        )
        errors = np.ascontiguousarray(found.position_error), np.ascontiguousarray(found.rotation_error)
        return self.chain.native.arrange(
            found.q, *errors, None, T, None, _WHOLE.rows, position_tolerance, rotation_tolerance, 0
        )

    def _for_values(self, T: FloatArray, seeds: FloatArray | None, asked: _Asked) -> IKSolutions:
        """Seven joints: every answer for some values of one of them, and with a seed the one that grows out of it."""
        found = redundancy_.solve_redundant(
            self.chain,
            T,
            values=asked.redundancy,
            samples=asked.samples,
            position_tolerance=asked.position_tolerance,
            rotation_tolerance=asked.rotation_tolerance,
            threads=asked.threads,
        )
        if found.valid.shape[:-1] != T.shape[:-2]:
            raise ArrayError(
                f"values of the redundancy must have shape (m,) or (..., m) with the leading axes {T.shape[:-2]} of the targets; "
                f"these make {found.valid.shape[:-1]}"
            )
        q, position, rotation = found.q, found.position_error, found.rotation_error
        if seeds is not None and asked.redundancy is None:
            near = asked.iterate(self.chain, T, seed=seeds, count=1)
            q = np.concatenate([near.q, q], axis=-2)
            position = np.concatenate([near.position_error, position], axis=-1)
            rotation = np.concatenate([near.rotation_error, rotation], axis=-1)
        answers = self._arranged(q, position, rotation, T, seeds, None, asked)
        if asked.redundancy is None:
            answers.free = 1
        else:
            answers.complete = np.asarray(~found.doubtful.any(axis=-1))
        return answers

    def _some_rows(self, target: Target, seed: ArrayLike | None, asked: _Asked) -> IKSolutions:
        """A position, or a position and one axis."""
        asked.check()
        question = ask(self.chain, target.T_base_tip, seed)
        T, seeds = question.T_base_tip, question.seed
        found = partial.solve_partial(
            self.chain,
            target,
            seed=None if seeds is None else np.clip(seeds, *self.chain.limits.T),
            samples=asked.samples,
            position_tolerance=asked.position_tolerance,
            rotation_tolerance=asked.rotation_tolerance,
            threads=asked.threads,
        )
        answers = self._arranged(found.q, found.position_error, found.rotation_error, T, seeds, target, asked)
        answers.free = found.free_dimension
        answers.complete = np.full(answers.status.shape, found.complete)
        again = answers.status != Status.reached
        if not found.complete:
            self._look_again(answers, T, seeds, asked, again, by_polynomial=False, target=target)
        answers.find_nearest = functools.partial(self._nearest_of, target, seeds, asked.restarts, asked.threads)
        return answers if asked.count is None else _first(answers, asked.count)

    def _numeric(self, target: ArrayLike | Target, seed: ArrayLike | None, asked: _Asked) -> IKSolutions:
        count = 1 if asked.count is None else asked.count
        rows = 6
        if isinstance(target, Target):
            turns = 2 if target.axis is not None else np.count_nonzero(target.weights[3:])
            rows = int(np.count_nonzero(target.weights[:3]) + turns)
        try:
            answers = asked.iterate(self.chain, target, seed=seed, count=count)
            answers.free = max(0, self.chain.dof - rows)
            return answers
        except ArrayError:
            if isinstance(target, Target):
                raise
            question = ask(self.chain, target, seed)
            if not question.malformed:
                raise
        answers = asked.iterate(self.chain, question.T_base_tip, seed=question.seed, count=count)
        answers.free = max(0, self.chain.dof - 6)
        _mark_malformed(answers, question.malformed)
        return answers

    def _arranged(
        self,
        q: FloatArray,
        position_error: FloatArray,
        rotation_error: FloatArray,
        T: FloatArray,
        seeds: FloatArray | None,
        target: Target | None,
        asked: _Asked,
    ) -> IKSolutions:
        """Answers in the order of their use, as many places as the target with the most of them needs."""
        arrays: Any = self.chain.native.arrange(
            np.ascontiguousarray(q),
            np.ascontiguousarray(position_error),
            np.ascontiguousarray(rotation_error),
            None,
            T,
            seeds,
            _WHOLE.rows if target is None else target.rows,
            *asked.tolerances,
            0,
        )
        rest = np.zeros(T.shape[:-2], dtype=bool), _nothing_missed, *asked.tolerances
        arrays = *arrays[:7], *rest
        answers = IKSolutions(self.chain, *arrays)
        answers.target = target
        return answers

    @cached_property
    def _general(self) -> kernels.NativeGeneral6R:
        return general_6r.prepare(self.chain).native

    # --- what follows

    def _look_again(
        self,
        answers: IKSolutions,
        T: FloatArray,
        seeds: FloatArray | None,
        asked: _Asked,
        again: BoolArray,
        *,
        by_polynomial: bool,
        target: Target | None = None,
    ) -> None:
        """Solves some targets by another method too: what is doubtful, and what is missed but may be near enough."""
        if not again.any():
            return
        more: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        some = None if seeds is None else seeds[again]
        certain = np.zeros(int(again.sum()), dtype=bool)
        if by_polynomial and general_6r.fits(self.chain):
            second = general_6r.solve_general_6r(self.chain, T[again], mode="complete")
            more.append((second.q, second.position_error, second.rotation_error))
            certain = np.asarray((second.flags & general_6r.Flag.doubtful) == 0)
        if not certain.all() or max(asked.tolerances) > _TIGHT:
            wanted = T[again] if target is None else replace(target, T_base_tip=T[again])
            further = asked.iterate(self.chain, wanted, seed=some, count=_FURTHER)
            more.append((further.q, further.position_error, further.rotation_error))
        self._add(answers, again, T, some, more, target)
        answers.complete[again] = certain

    def _add(
        self,
        answers: IKSolutions,
        rows: BoolArray,
        T: FloatArray,
        seeds: FloatArray | None,
        more: list[tuple[FloatArray, FloatArray, FloatArray]],
        target: Target | None,
    ) -> None:
        """Joins further answers to those that there are, each once."""
        places = answers.valid.shape[-1]
        q = np.concatenate([answers.q[rows], *(m[0] for m in more)], axis=1)
        position = np.concatenate([answers.position_error[rows], *(m[1] for m in more)], axis=1)
        rotation = np.concatenate([answers.rotation_error[rows], *(m[2] for m in more)], axis=1)
        branch = np.full(position.shape, -1, dtype=np.int8)
        branch[:, :places] = answers.branch[rows]
        turning = self.chain.is_revolute
        for k in range(places, q.shape[1]):
            apart = without_turns(turning, q[:, :k] - q[:, k : k + 1])
            with np.errstate(invalid="ignore"):
                known = (np.abs(apart).max(axis=-1, initial=0.0) < _SAME).any(axis=-1)
            position[known, k] = np.nan
        joined: Any = self.chain.native.arrange(
            q,
            position,
            rotation,
            branch,
            T[rows],
            seeds,
            _WHOLE.rows if target is None else target.rows,
            answers.position_tolerance,
            answers.rotation_tolerance,
            0,
        )
        needed = joined[1].shape[-1]
        if answers.free and needed > places:
            _widen(answers, needed)
            places = needed
        kept = min(places, needed)
        for name, values in zip(_PLACES, joined, strict=False):
            former = getattr(answers, name)
            some = former[rows]
            some[:, kept:] = _EMPTY.get(name, False)
            some[:, :kept] = values[:, :kept]
            former[rows] = some
        answers.status[rows] = joined[6]

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
            wanted = replace(target, T_base_tip=target.T_base_tip[missed])
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


def _strength(chain: Chain) -> float:
    """How well six joints move the tip in the way that they do worst: the least singular value of the Jacobian, of the largest."""
    q = np.random.default_rng(1968).uniform(-np.pi, np.pi, (_PROBES, chain.dof))
    J = chain.native.jacobian(q) / np.array([*[size_of(chain)] * 3, 1.0, 1.0, 1.0])[:, None]
    strengths = np.linalg.svd(J, compute_uv=False)
    return float(np.median(strengths[:, -1] / strengths[:, 0]))


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


def _widen(answers: IKSolutions, places: int) -> None:
    """More places for answers, empty ones."""
    for name in _PLACES:
        values = getattr(answers, name)
        axis = answers.valid.ndim - 1
        padding = [(0, 0)] * values.ndim
        padding[axis] = (0, places - values.shape[axis])
        setattr(answers, name, np.pad(values, padding, constant_values=_EMPTY.get(name, False)))


def _first(answers: IKSolutions, count: int) -> IKSolutions:
    """No more than the first `count` answers."""
    for name in _PLACES:
        values = getattr(answers, name)
        setattr(answers, name, values[..., :count, :] if name == "q" else values[..., :count])
    return answers
