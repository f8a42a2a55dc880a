"""Arms and poses that are made up, of several kinds, and what is proved about them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq_mat

from proof.oracle import rational
from proof.oracle.rational import QUARTER_TURNS, RationalArm, Tangent
from proof.oracle.roots import Solved, apart, prove, sensitivity

KINDS = ("generic", "near_degenerate", "real_arm", "boundary", "unreachable")
REAL_ARMS = (
    *("abb_crb15000", "abb_irb120", "abb_irb2400", "abb_irb6640", "fanuc_crx10ia", "fanuc_crx10ia_l"),
    *("kinova_gen3_6dof", "kuka_kr210_l150", "kuka_kr210_robond", "puma560", "ufactory_xarm6", "ur3e", "ur5", "ur5e"),
    *("ur10e", "ur20", "yaskawa_mh12"),
)
DIGITS = 25
ILL_SINGULAR, ILL_MOVED, ILL_APART = 1e-5, 1e-10, 1e-4
BOUNDARY = Fraction(1, 10**6)  # m, either way of the edge


@dataclass(frozen=True)
class Question:
    """A pose of an arm, before anything is known about it."""

    arm: RationalArm
    kind: str
    pose_kind: str
    pose: fmpq_mat
    made_from: tuple[Tangent, ...] | None = None


# Arms


def generic_arm(rng: np.random.Generator) -> RationalArm:
    """Any twists and lengths."""
    table = [(_tangent(rng), _millimetres(rng, 500), _millimetres(rng, 500)) for _ in range(6)]
    return rational.from_dh("generic", "generic", table)


def near_degenerate_arm(rng: np.random.Generator) -> RationalArm:
    """An arm of a kind that has a closed form, with some of its numbers off by 1e-9 to 1e-2."""
    quarter, straight = Fraction(1), Fraction(0)
    signs = [int(x) for x in rng.choice([-1, 1], 6)]
    length = [_millimetres(rng, 500) for _ in range(6)]
    tables = {
        "spherical wrist": [
            (signs[0] * quarter, length[0] / 4, length[1]),
            (straight, length[2], Fraction(0)),
            (signs[1] * quarter, length[3] / 4, Fraction(0)),
            (signs[2] * quarter, Fraction(0), length[4]),
            (signs[3] * quarter, Fraction(0), Fraction(0)),
            (straight, Fraction(0), length[5] / 2),
        ],
        "three parallel": [
            (signs[0] * quarter, Fraction(0), length[0]),
            (straight, length[1], Fraction(0)),
            (straight, length[2], Fraction(0)),
            (signs[1] * quarter, Fraction(0), length[3] / 3),
            (signs[2] * quarter, Fraction(0), length[4] / 3),
            (straight, Fraction(0), length[5] / 3),
        ],
        "two crossings": [
            (signs[0] * quarter, Fraction(0), length[0]),
            (straight, length[1], Fraction(0)),
            (signs[1] * quarter, Fraction(0), length[2]),
            (signs[2] * quarter, Fraction(0), length[3]),
            (signs[3] * quarter, length[4] / 5, Fraction(0)),
            (straight, Fraction(0), length[5]),
        ],
    }
    name = str(rng.choice(list(tables)))
    size = 10 ** int(rng.integers(2, 10))
    off = [
        [Fraction(int(rng.integers(-9, 10)), 4 * size) * int(rng.random() < 0.6) for _ in range(3)] for _ in range(6)
    ]
    table = [(t + x, a + y, d + z) for (t, a, d), (x, y, z) in zip(tables[name], off, strict=True)]
    return rational.from_dh(f"near {name}, 1/{size}", "near_degenerate", table)


def real_arm(rng: np.random.Generator) -> RationalArm:
    return rational.built_in(str(rng.choice(REAL_ARMS)))


def _tangent(rng: np.random.Generator) -> Fraction:
    return rational.nearest_tangent(rng.uniform(-3.0, 3.0), 60) or Fraction(1, 7)


def _millimetres(rng: np.random.Generator, most: int) -> Fraction:
    return Fraction(int(rng.integers(-most, most + 1)) or 1, 1000)


# Poses


def joints(rng: np.random.Generator, pose_kind: str) -> tuple[Tangent, ...]:
    """Six half-angle tangents: all random, some or all quarter turns."""
    free = [rational.nearest_tangent(rng.uniform(-math.pi, math.pi), 40) for _ in range(6)]
    quarters = [QUARTER_TURNS[int(k)] for k in rng.integers(0, 4, 6)]
    share = {"random_joints": 0.0, "mixed_grid": 0.5, "grid": 1.0}[pose_kind]
    return tuple(b if rng.random() < share else a for a, b in zip(free, quarters, strict=True))


def question(kind: str, rng: np.random.Generator) -> Question:
    """One of a kind. Boundary poses come in pairs: see `edge`."""
    if kind == "unreachable":
        arm = (generic_arm, near_degenerate_arm, real_arm)[int(rng.integers(3))](rng)
        T = arm.forward(joints(rng, "random_joints"))
        if rng.random() < 0.5:
            return Question(arm, kind, "far", rational.moved([Fraction(int(x), 2) for x in _direction(rng)]) * T)
        lower = rational.moved([Fraction(0), Fraction(0), Fraction(-int(rng.integers(1, 9)), 4)])
        turned = rational.about(int(rng.integers(2)), _tangent(rng))
        return Question(arm, kind, "random_pose", lower * T * turned)
    arm = {"generic": generic_arm, "near_degenerate": near_degenerate_arm, "real_arm": real_arm}[kind](rng)
    pose_kind = "random_joints" if kind == "generic" else str(rng.choice(["random_joints", "mixed_grid"]))
    made_from = joints(rng, pose_kind)
    return Question(arm, kind, pose_kind, arm.forward(made_from), made_from)


def _direction(rng: np.random.Generator) -> np.ndarray:
    return rng.choice([-9, -8, -7, 7, 8, 9], 3)


def edge(rng: np.random.Generator) -> tuple[Question, Question]:
    """Two poses 1e-6 m on either side of one where two solutions meet, inside and outside.

    At a singular configuration with joint motion n, lost direction u and curvature ``u . (dJ/dn) n`` of the tip's path, two
    solutions meet as the tip passes in the direction of u. The place is found in double precision; the poses are exact.
    """
    while True:
        arm = (generic_arm, real_arm)[int(rng.integers(2))](rng)
        q = _singular(arm, rng)
        if q is None:
            continue
        tangents = tuple(rational.nearest_tangent(x, 10**9) for x in q)
        at = np.array([rational.angle(t) for t in tangents])
        U, s, Vt = np.linalg.svd(_jacobian(arm, at))
        u, n, h = U[:, -1], Vt[-1], 1e-4
        bend = u @ (_jacobian(arm, at + h * n) - _jacobian(arm, at - h * n)) @ n / (2 * h)
        if abs(bend) < 0.02 or s[-2] < 0.02 or s[-1] > 1e-7 or np.linalg.norm(u[:3]) < 0.3:
            continue
        outwards = -np.sign(bend) * u[:3] / np.linalg.norm(u[:3])
        step = [BOUNDARY * Fraction(float(x)).limit_denominator(1000) for x in outwards]
        T = arm.forward(tangents)
        return (
            Question(arm, "boundary", "boundary_inside", rational.moved([-x for x in step]) * T),
            Question(arm, "boundary", "boundary_outside", rational.moved(step) * T),
        )


def _singular(arm: RationalArm, rng: np.random.Generator) -> np.ndarray | None:
    """A configuration where the determinant of the Jacobian vanishes, by bisection along one joint; None without one."""
    q = rng.uniform(-3.0, 3.0, 6)
    joint = int(rng.integers(1, 5))

    def determinant(value: float) -> float:
        at = q.copy()
        at[joint] = value
        return float(np.linalg.det(_jacobian(arm, at)))

    grid = np.linspace(-3.0, 3.0, 25)
    values = [determinant(x) for x in grid]
    crossings = [i for i in range(24) if values[i] * values[i + 1] < 0]
    if not crossings:
        return None
    i = int(rng.choice(crossings))
    low, high = grid[i], grid[i + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if determinant(middle) * determinant(low) > 0 else (low, middle)
    q[joint] = low
    return q


def _jacobian(arm: RationalArm, q: np.ndarray) -> np.ndarray:
    T, axes = rational.as_float(arm.base), []
    for value, link in zip(q, arm.links, strict=True):
        axes.append((T[:3, 2], T[:3, 3]))
        c, s = math.cos(value), math.sin(value)
        T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]) @ rational.as_float(link)
    return np.column_stack([[*np.cross(z, T[:3, 3] - p), *z] for z, p in axes])


def questions(count: int, seed: int, kinds: tuple[str, ...] = KINDS) -> Iterator[Question]:
    """So many of all kinds in turn."""
    rng = np.random.default_rng(seed)
    left = count
    while left > 0:
        for kind in kinds:
            some = edge(rng) if kind == "boundary" else (question(kind, rng),)
            for one in some[:left]:
                yield one
                left -= 1


# Answers


def case(one: Question, solved: Solved, confirmed: Solved | None, *, arm: str, key: str) -> dict:
    """As it is stored; see tests/golden/README.md."""
    solutions = solved.solutions
    separation = min((float(apart(p, q)) for i, p in enumerate(solutions) for q in solutions[:i]), default=None)
    rows = []
    for q in solutions:
        least, moved = sensitivity(one.arm, one.pose, q)
        text = [decimal(x) for x in q]
        rows.append(
            {
                "q25": text,
                "q": [float(x) for x in text],
                "sigma_min": least,
                "bound": 1e-16 / max(least, 1e-300),
                "moved": moved if math.isfinite(moved) else None,
            }
        )
    ill = (
        any(
            row["sigma_min"] < ILL_SINGULAR or (row["moved"] or math.inf) > ILL_MOVED
            for row in rows
            if row["moved"] != 0.0
        )
        or (separation is not None and separation < ILL_APART)
        or solved.nearest_complex_root < ILL_APART
    )
    data = {
        "class": "near_fold" if one.kind == "boundary" else one.kind,
        "arm": arm,
        "pose_kind": one.pose_kind,
        "pose_exact": rational.rows(one.pose),
        "pose": rational.as_float(one.pose).tolist(),
        **({"generated_from_tanhalf": [_text(t) for t in one.made_from]} if one.made_from else {}),
        "count": len(solutions),
        "remaining": _choice(solved),
        "confirmed_with": None if confirmed is None else _choice(confirmed),
        "degree": int(solved.elimination.polynomial.degree()),
        "real_roots": len(solved.roots),
        "extraneous_real_roots": solved.extraneous,
        "twin_roots": sum(len(root.solutions) > 1 for root in solved.roots),
        "nearest_complex_root": solved.nearest_complex_root if math.isfinite(solved.nearest_complex_root) else None,
        "min_separation": separation,
        "ill_conditioned": bool(ill),
        "solutions": rows,
        "id": key,
    }
    if one.made_from:
        wanted = [rational.angle(t) for t in one.made_from]
        gaps = [float(apart(wanted, q)) for q in solutions]
        if min(gaps, default=1.0) > 1e-12:
            raise ArithmeticError(f"{key}: the joints that made the pose are not among its proved solutions")
        data["generator"] = int(np.argmin(gaps))
    return data


def answer(one: Question, seed: int, *, arm: str, key: str) -> dict | None:
    """What is proved about a pose, or None where nothing is (truly multiple roots, continuous families)."""
    first, second = prove(one.arm, one.pose, np.random.default_rng(seed))
    if first is None or first.status != "proved" or (first.extraneous and second is None):
        return None  # that a root belongs to no solution is believed where a second elimination says the same
    return case(one, first, second, arm=arm, key=key)


def _choice(solved: Solved) -> dict:
    joint = solved.elimination.joint
    return {"walk": "forward", "start": (joint - 2) % 6, "position": 0, "joint": joint}


def _text(t: Tangent) -> str:
    return "inf" if t is None else str(t)


def decimal(x: object) -> str:
    """With 25 decimals, rounded to nearest."""
    from mpmath import mp

    scaled = int(mp.nint(x * mp.mpf(10) ** DIGITS))
    sign, digits = ("-" if scaled < 0 else ""), str(abs(scaled)).rjust(DIGITS + 1, "0")
    return f"{sign}{digits[:-DIGITS]}.{digits[-DIGITS:]}"
