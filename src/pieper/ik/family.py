"""Which closed form an arm has, read from its screw axes.

Joint axes are taken as lines in space, so frame origins, tools and bases do not matter. Two relations count: axes that are
parallel (or anti-parallel: the sign of a joint does not matter either) and axes that meet in a point. Each is measured,
an angle in radians or a distance in metres, and compared with a tolerance at three levels:

- ``exact``: up to 1e-9, what rounding of the description's own arithmetic leaves;
- ``rounded``: up to 1e-5, what is left by numbers such as 1.5708 for a right angle;
- ``approximate``: up to 2 cm or 0.02 rad, an arm that nearly has a closed form.

Above the exact level the closed form is that of an ideal arm nearby, whose answers are polished on the arm itself; the
arm's own numbers are never changed. Distances are relative to the size of the arm.

References
----------
Pieper, The kinematics of manipulators under computer control, Ph.D. thesis, Stanford (1968).
Elias, Wen, IK-Geo: unified robot inverse kinematics using subproblem decomposition, Mechanism and Machine Theory 209 (2025).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper._native import kernels
from pieper.errors import ArrayError
from pieper.kinematics.joints import without_turns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

LEVELS = {"exact": 1e-9, "rounded": 1e-5, "approximate": 2e-2}
"""How far a relation between axes may be off: in radians, and in units of the size of the arm."""

_CAPTURE = {"exact": 1e-6, "rounded": 1e-2, "approximate": 0.3}
"""Answers of the ideal arm that are off by no more are polished."""

_CAPTURE_OF_ROOTS = 1e-2
"""The same where a quartic was solved, whose roots are not found to the last digit."""

_WIDENED = 4.0
"""Beside a fold answers of an arm and of its ideal are apart by the root of the deviation; Newton starts that far out."""

_NOTHING = 1e-13
"""Deviations up to this are what rounding of the screws leaves: the arm is its own ideal."""

_LEAST_SKEW = 1e-3
"""Axes 5 and 6 as far apart as this, in units of the size of the arm, are solved as skew."""

_CLEARLY_APART = 0.02
"""[rad] Axes at a smaller angle than this are not taken to cross one another."""

_LEAST_JOINTS, _MOST_JOINTS = 2, 6

_NATIVE = {
    "spherical wrist": "spherical_wrist",
    "three parallel axes": "three_parallel",
    "planar": "planar",
    "gantry": "gantry",
}

_RANDOM_POSES, _GRID_POSES = 200, 64


class SelfTest(NamedTuple):
    """What a closed form did on its own arm when it was chosen."""

    recall: float
    """Share of random joint values that were among the answers for their pose; poses called doubtful are left out."""
    grid: float
    """Share of poses with joints at multiples of 90 degrees that had an answer; likewise."""
    doubtful: float
    """Share of the random poses that were called doubtful: next to 0 at the exact level."""
    worst_error: float
    """The largest error of an answer [m or rad]."""

    @property
    def passed(self) -> bool:
        """True when nothing was lost."""
        return self.recall == 1.0 and self.grid == 1.0


@dataclass(frozen=True, eq=False)
class Family:
    """A closed form that fits an arm, or the reason why there is none.

    Attributes
    ----------
    name : str
        ``"spherical wrist"``, ``"three parallel axes"``, ``"planar"`` (SCARA among them), ``"gantry"``, or ``"none"``.
    reason : str
        What was found, in words.
    level : str
        ``"exact"``, ``"rounded"`` or ``"approximate"``; ``""`` where there is no closed form.
    deviation : float
        The largest amount by which a relation is off [rad, or m in units of the size of the arm].
    max_solutions : int
        Answers that one pose can have at most, singular poses apart.
    reversed : bool
        True when the arm is solved from tip to base.
    first_three : str
        How the first three axes lie, seen from the end that is solved first; ``""`` for three parallel axes.
    quartic : bool
        True when one stage is an equation of degree four, not square roots alone.
    screws : (n, 6) array
        Screws of the ideal arm, in the order of the arm.
    scale : float
        The size that distances are relative to [m].
    self_test : SelfTest or None
        The measurement made when the family was chosen.
    """

    name: str
    reason: str
    level: str = ""
    deviation: float = 0.0
    max_solutions: int = 0
    reversed: bool = False
    first_three: str = ""
    quartic: bool = False
    screws: FloatArray | None = None
    home: FloatArray | None = None
    scale: float = 1.0
    self_test: SelfTest | None = None

    @property
    def has_closed_form(self) -> bool:
        """True when the arm can be solved by `pieper.ik.closed_form.solve_closed_form`."""
        return self.screws is not None

    @property
    def complete(self) -> bool:
        """True when every answer is found, but for poses called doubtful: not at the approximate level."""
        return self.has_closed_form and self.level != "approximate"

    @cached_property
    def native(self) -> kernels.ClosedForm:
        """The constants that the compiled solver takes; made once.

        Raises
        ------
        ArrayError
            The arm has no closed form.
        """
        if self.screws is None or self.home is None:
            raise ArrayError(
                f"the arm has no closed form: {self.reason}; use pieper.ik.solve.solve, which takes another method"
            )
        kind = getattr(
            kernels.ClosedFormFamily, _NATIVE[self.name] + ("_skew" if self.quartic and not self.first_three else "")
        )
        arrangement = getattr(kernels.FirstThree, self.first_three or "parallel_23")
        widened = 0.0 if self.deviation <= _NOTHING else _WIDENED * self.deviation
        capture = max(_CAPTURE[self.level], _CAPTURE_OF_ROOTS if self.quartic else 0.0)
        return kernels.ClosedForm(
            kind, arrangement, self.reversed, self.screws, self.home, self.scale, capture, widened
        )

    def __str__(self) -> str:
        return self.reason


@dataclass
class _Lines:
    """Axes as lines: unit directions and points on them."""

    direction: FloatArray
    point: FloatArray
    slides: NDArray[np.bool_]

    @classmethod
    def of(cls, screws: FloatArray) -> _Lines:
        v, w = screws[:, :3], screws[:, 3:]
        slides = np.asarray(~w.any(axis=1), dtype=bool)
        return cls(np.where(slides[:, None], v, w), np.cross(w, v), slides)

    def backwards(self) -> _Lines:
        return _Lines(-self.direction[::-1], self.point[::-1].copy(), self.slides[::-1].copy())

    def copy(self) -> _Lines:
        return _Lines(self.direction.copy(), self.point.copy(), self.slides.copy())

    def screws(self) -> FloatArray:
        turning = np.hstack([np.cross(self.point, self.direction), self.direction])
        sliding = np.hstack([self.direction, np.zeros_like(self.direction)])
        return np.where(self.slides[:, None], sliding, turning)

    @property
    def pattern(self) -> str:
        """R for an axis that turns, P for one that slides, in order."""
        return "".join("P" if slides else "R" for slides in self.slides)

    def sine(self, i: int, j: int) -> float:
        """Sine of the angle between two axes, 0 for parallel and for anti-parallel ones."""
        return float(np.linalg.norm(np.cross(self.direction[i], self.direction[j])))

    def distance(self, i: int, j: int) -> float:
        """Length of the common normal of two axes [m]."""
        apart = self.point[j] - self.point[i]
        normal = np.cross(self.direction[i], self.direction[j])
        size = float(np.linalg.norm(normal))
        if size < _CLEARLY_APART:
            return float(np.linalg.norm(np.cross(apart, self.direction[i])))
        return abs(float(apart @ normal)) / size

    def nearest(self, axes: list[int]) -> FloatArray:
        """The point with the least sum of squared distances from some axes."""
        across = [np.eye(3) - np.outer(self.direction[i], self.direction[i]) for i in axes]
        right = np.sum([a @ self.point[i] for a, i in zip(across, axes, strict=True)], axis=0)
        return np.asarray(np.linalg.lstsq(np.sum(across, axis=0), right, rcond=1e-12)[0])

    def away(self, i: int, point: FloatArray) -> float:
        """Distance of a point from an axis [m]."""
        return float(np.linalg.norm(np.cross(point - self.point[i], self.direction[i])))

    # The two ways of making a relation exact.

    def make_parallel(self, axes: list[int]) -> None:
        signs = [1.0 if self.direction[i] @ self.direction[axes[0]] > 0 else -1.0 for i in axes]
        mean = np.sum([s * self.direction[i] for s, i in zip(signs, axes, strict=True)], axis=0)
        mean = mean / np.linalg.norm(mean)
        for s, i in zip(signs, axes, strict=True):
            self.direction[i] = s * mean

    def make_concurrent(self, axes: list[int]) -> None:
        point = self.nearest(axes)
        for i in axes:
            self.point[i] = point


class _Found(NamedTuple):
    """Relations that hold within `deviation`, and the arm that has them exactly."""

    name: str
    words: str
    first_three: str
    lines: _Lines
    deviation: float
    max_solutions: int
    quartic: bool = False


def size_of(chain: Chain) -> float:
    """The length that distances between axes are compared with: the longest common normal of neighbours, or a tenth of the
    way along the arm if that is more [m].
    """
    lines = _Lines.of(chain.screws[chain.is_revolute])
    if not len(lines.direction):
        return 1.0
    longest, reach, at = 0.0, 0.0, lines.point[0]
    for i, (d, p) in enumerate(zip(lines.direction, lines.point, strict=True)):
        if i:
            longest = max(longest, lines.distance(i - 1, i))
        foot = p + d * float(d @ (at - p))
        reach, at = reach + float(np.linalg.norm(foot - at)), foot
    reach += float(np.linalg.norm(chain.home[:3, 3] - at))
    return max(longest, reach / 10.0, 1e-6)


def find_family(chain: Chain, *, approximate: bool = False) -> Family:
    """The closed form that an arm has.

    Parameters
    ----------
    chain : Chain
        Any chain.
    approximate : bool
        Whether to accept a closed form of an arm that is only similar, which finds some answers and not all.

    Returns
    -------
    Family
        `Family.has_closed_form` is False, and `Family.reason` says why, where there is none.

    Notes
    -----
    A candidate has to solve its own arm before it is returned: 200 random poses, whose joint values must be among the
    answers, and 64 with joints at multiples of 90 degrees, which must have an answer.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> print(find_family(catalog.describe("ur5e").chain()))
    axes 2, 3 and 4 are parallel, and axes 5 and 6 meet: up to 8 answers (exact)
    >>> find_family(catalog.describe("fanuc_crx10ia").chain()).has_closed_form
    False
    """
    why = _not_for_closed_forms(chain)
    if why:
        return Family("none", why)
    scale = size_of(chain)
    best: Family | None = None
    failed = ""
    for found, backwards in _relations(chain, scale):
        level = next((name for name, limit in LEVELS.items() if found.deviation <= limit), "")
        if not level or (level == "approximate" and not approximate):
            continue
        order = list(LEVELS)
        if best is not None and order.index(best.level) <= order.index(level):
            continue
        ideal = found.lines.backwards() if backwards else found.lines
        read = ", read from the tip" if backwards else ""
        family = Family(
            name=found.name,
            reason=f"{found.words}{read}: up to {found.max_solutions} answers ({_words(level, found.deviation)})",
            level=level,
            deviation=found.deviation,
            max_solutions=found.max_solutions,
            reversed=backwards,
            first_three=found.first_three,
            quartic=found.quartic,
            screws=ideal.screws(),
            home=np.asarray(chain.home),
            scale=scale,
        )
        test = run_self_test(chain, family)
        if test.passed or level == "approximate":
            best = replace(family, self_test=test)
        else:
            failed = (
                f"; {found.words}{read} would fit, but found only {100 * test.recall:.4g} % of its own random poses"
                f" and {100 * test.grid:.4g} % of those at right angles"
            )
    if best is not None:
        return best
    if chain.is_revolute.all() and chain.dof > 4:
        why = "no three axes meet or are parallel where a closed form needs it"
    else:
        pattern = _Lines.of(chain.screws).pattern
        why = f"axes that turn and slide as {pattern} have a closed form only in few arrangements, and this is none of them"
    return Family("none", why + failed, scale=scale)


def run_self_test(chain: Chain, family: Family) -> SelfTest:
    """Solves poses of the arm itself: 200 random ones and 64 with joints at multiples of 90 degrees."""
    rng = np.random.default_rng(1968)
    q = rng.uniform(-np.pi, np.pi, (_RANDOM_POSES, chain.dof))
    grid = rng.integers(-1, 3, (_GRID_POSES, chain.dof)) * (np.pi / 2)
    T = chain.native.fk(np.concatenate([q, grid]))
    answers, valid, position, rotation, doubtful = chain.native.solve_closed_form(family.native, T, 1e-9, 1e-9, 1)
    apart = np.abs(without_turns(True, answers[:_RANDOM_POSES] - q[:, None])).max(axis=-1)
    found = np.any(valid[:_RANDOM_POSES] & (apart < 1e-5), axis=-1) | doubtful[:_RANDOM_POSES]
    reached = valid[_RANDOM_POSES:].any(axis=-1) | doubtful[_RANDOM_POSES:]
    worst = max(position[valid].max(initial=0.0), rotation[valid].max(initial=0.0))
    return SelfTest(float(found.mean()), float(reached.mean()), float(doubtful[:_RANDOM_POSES].mean()), float(worst))


def _words(level: str, deviation: float) -> str:
    return level if level == "exact" else f"{level}: off by {deviation:.1e} rad or of the size of the arm"


def _not_for_closed_forms(chain: Chain) -> str:
    if chain.is_coupled:
        return "mimic joints couple several axes to one joint"
    if chain.dof > _MOST_JOINTS:
        return f"{chain.dof} joints; closed forms are for up to {_MOST_JOINTS}, so lock some joints first"
    if chain.dof < _LEAST_JOINTS:
        return f"too few joints: {chain.dof}"
    return ""


def _relations(chain: Chain, scale: float) -> Iterator[tuple[_Found, bool]]:
    """Everything that could be solved in closed form, cheapest first, with how far the relations are off."""
    forwards = _Lines.of(chain.screws)
    for lines, backwards in ((forwards, False), (forwards.backwards(), True)):
        for kind in _KINDS.get(lines.pattern, ()):
            for found in kind(lines, scale):
                yield found, backwards


def _spherical_wrists(lines: _Lines, scale: float) -> Iterator[_Found]:
    """Axes 4, 5, 6 meet, and two of the first three are parallel or meet."""
    if lines.sine(3, 4) < _CLEARLY_APART or lines.sine(4, 5) < _CLEARLY_APART:
        return
    centre = lines.nearest([3, 4, 5])
    wrist = max(lines.away(i, centre) for i in (3, 4, 5)) / scale
    if wrist > LEVELS["approximate"]:
        return
    pairs = {
        "parallel_23": (1, 2, (0, 1)),
        "parallel_12": (0, 1, (1, 2)),
        "intersecting_12": (0, 1, (0, 1)),
        "intersecting_23": (1, 2, (1, 2)),
    }
    for first_three, (i, j, cross) in pairs.items():
        parallel = first_three.startswith("parallel")
        off = lines.sine(i, j) if parallel else lines.distance(i, j) / scale
        if off > LEVELS["approximate"] or lines.sine(*cross) < _CLEARLY_APART:
            continue
        ideal = lines.copy()
        ideal.make_concurrent([3, 4, 5])
        if parallel:
            ideal.make_parallel([i, j])
        else:
            ideal.make_concurrent([i, j])
        verb = "are parallel" if parallel else "meet"
        words = f"axes 4, 5 and 6 meet (spherical wrist), and axes {i + 1} and {j + 1} {verb}"
        yield _Found("spherical wrist", words, first_three, ideal, max(wrist, off), 8)
    if lines.sine(0, 1) < _CLEARLY_APART or lines.distance(0, 1) < _LEAST_SKEW * scale:
        return
    ideal = lines.copy()
    ideal.make_concurrent([3, 4, 5])
    words = "axes 4, 5 and 6 meet (spherical wrist)"
    yield _Found("spherical wrist", words, "general", ideal, wrist, 8, True)


def _sliding_third(lines: _Lines, scale: float) -> Iterator[_Found]:
    """Axes 4, 5, 6 meet, joint 3 slides, axes 1 and 2 meet: the Stanford arm."""
    if min(lines.sine(3, 4), lines.sine(4, 5), lines.sine(0, 1)) < _CLEARLY_APART:
        return
    centre = lines.nearest([3, 4, 5])
    off = max([lines.away(i, centre) / scale for i in (3, 4, 5)] + [lines.distance(0, 1) / scale])
    ideal = lines.copy()
    ideal.make_concurrent([3, 4, 5])
    ideal.make_concurrent([0, 1])
    words = "axes 4, 5 and 6 meet (spherical wrist), joint 3 slides, and axes 1 and 2 meet"
    yield _Found("spherical wrist", words, "sliding_3", ideal, off, 8)


def _planar(lines: _Lines, scale: float) -> Iterator[_Found]:
    """All axes are parallel: two or three that turn, and at most one that slides."""
    turning = [int(i) for i in np.flatnonzero(~lines.slides)]
    every = list(range(len(lines.direction)))
    off = max(lines.sine(every[0], i) for i in every[1:])
    gaps = [lines.distance(i, j) for i, j in itertools.pairwise(turning)]
    if off > LEVELS["approximate"] or min(gaps) < _LEAST_SKEW * scale:
        return
    ideal = lines.copy()
    ideal.make_parallel(every)
    words = f"all {len(every)} axes are parallel" + (", one of them slides" if lines.slides.any() else "")
    yield _Found("planar", words, "", ideal, off, len(turning) - 1)


def _gantry(lines: _Lines, scale: float) -> Iterator[_Found]:
    """Three slides, then up to three axes that turn."""
    n = len(lines.direction)
    if abs(float(np.linalg.det(lines.direction[:3]))) < _CLEARLY_APART:
        return
    if min([lines.sine(i, i + 1) for i in range(3, n - 1)], default=1.0) < _CLEARLY_APART:
        return
    most = 2 if n == 6 else 1
    yield _Found("gantry", f"joints 1, 2 and 3 slide, {n - 3} axes turn", "", lines.copy(), 0.0, most)


def _three_parallel(lines: _Lines, scale: float) -> Iterator[_Found]:
    """Axes 2, 3, 4 are parallel; with six joints, axes 5 and 6 meet."""
    off = max(lines.sine(1, 2), lines.sine(2, 3), lines.sine(1, 3))
    if off > LEVELS["approximate"] or lines.sine(0, 1) < _CLEARLY_APART or lines.sine(3, 4) < _CLEARLY_APART:
        return
    ideal = lines.copy()
    ideal.make_parallel([1, 2, 3])
    if len(lines.direction) == 5:
        yield _Found("three parallel axes", "five joints, of which axes 2, 3 and 4 are parallel", "", ideal, off, 4)
        return
    if lines.sine(4, 5) < _CLEARLY_APART:
        return
    skew = ideal.copy()
    meet = lines.distance(4, 5) / scale
    ideal.make_concurrent([4, 5])
    words = "axes 2, 3 and 4 are parallel, and axes 5 and 6 meet"
    yield _Found("three parallel axes", words, "", ideal, max(off, meet), 8)
    if meet > _LEAST_SKEW:
        yield _Found("three parallel axes", "axes 2, 3 and 4 are parallel", "", skew, off, 8, True)


_KINDS: dict[str, tuple[Callable[[_Lines, float], Iterator[_Found]], ...]] = {
    "RRRRRR": (_spherical_wrists, _three_parallel),
    "RRRRR": (_three_parallel,),
    "RRPRRR": (_sliding_third,),
    **dict.fromkeys(("RR", "RRR", "RRP", "RPR", "PRR", "PRRR", "RPRR", "RRPR", "RRRP"), (_planar,)),
    **dict.fromkeys(("PPP", "PPPR", "PPPRR", "PPPRRR"), (_gantry,)),
}
