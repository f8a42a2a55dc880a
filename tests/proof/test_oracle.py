"""The oracle itself: exact elimination against the fixture, against arms whose solutions are known, and against itself."""

from __future__ import annotations

import gzip
import json
import math
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("flint", reason="python-flint comes with the dependency group `oracle`; nox -s oracle has it")

from proof.oracle import __main__ as oracle
from proof.oracle import cases, elimination, rational, roots
from tests.robots import chain

FIXTURE = Path(__file__).parents[1] / "golden" / "ik_oracle.json.gz"


@cache
def fixture():
    with gzip.open(FIXTURE) as file:
        return json.load(file)


def decimals(solved):
    return sorted([cases.decimal(x) for x in q] for q in solved.solutions)


@pytest.mark.parametrize("number", [0, 40, 170, 250, 324, 342, 378, 450, 540, 600])
def test_cases_of_the_fixture_are_proved_again(number):
    """That list was made by other code, with another elimination."""
    case = fixture()["cases"][number]
    arm = rational.RationalArm.read(fixture()["arms"][case["arm"]])
    first, _ = roots.prove(arm, rational.from_rows(case["pose_exact"]), np.random.default_rng(number), confirm=False)
    assert first.status == "proved"
    assert oracle.same_decimals(decimals(first), [solution["q25"] for solution in case["solutions"]])


def test_all_six_joints_prove_the_same():
    rng = np.random.default_rng(1)
    one = cases.question("generic", rng)
    offsets = [Fraction(1, 3), Fraction(2, 5), Fraction(1, 7)]
    found = [decimals(roots.solve(one.arm, one.pose, joint, offsets)) for joint in range(6)]
    assert all(oracle.same_decimals(found[0], other) for other in found)
    assert len(found[0]) >= 1


def test_the_polynomial_has_degree_16_and_the_artefact_four_times():
    one = cases.question("generic", np.random.default_rng(2))
    left = elimination.eliminate(one.arm, one.pose, 2, [Fraction(1, 3), Fraction(2, 5), Fraction(1, 7)])
    assert left.rank == 8
    assert left.removed == 4
    assert left.polynomial.degree() == 16
    assert left.polynomial.gcd(left.polynomial.derivative()).degree() == 0  # square-free


def test_a_determinant_that_vanishes_is_noticed():
    arm = rational.built_in("ur5e")
    pose = arm.forward([Fraction(1, k) for k in range(2, 8)])
    with pytest.raises(elimination.Vanishes):
        elimination.eliminate(arm, pose, 0, [Fraction(1, 3), Fraction(2, 5), Fraction(1, 7)])


def test_truly_multiple_roots_prove_nothing():
    """A stretched wrist: solutions form a curve."""
    arm = rational.built_in("puma560")
    pose = arm.forward([Fraction(1, 2), Fraction(1, 3), Fraction(1, 5), Fraction(1, 4), Fraction(0), Fraction(2, 7)])
    first, second = roots.prove(arm, pose, np.random.default_rng(3))
    assert first is None or first.status == "multiple"
    assert second is None


@pytest.mark.parametrize("name", cases.REAL_ARMS)
def test_rational_arms_are_the_built_in_ones(name):
    arm = rational.built_in(name)
    tangents = [Fraction(1, 3), Fraction(-2, 5), Fraction(3, 7), Fraction(-1, 9), Fraction(5, 4), Fraction(2, 3)]
    exact = rational.as_float(arm.forward(tangents))
    q = [rational.angle(t) for t in tangents]
    from pieper.kinematics.fk import fk

    assert np.abs(exact - fk(chain(name, nominal=True), q)).max() < (1e-2 if arm.name.endswith("_like") else 1e-14)


def test_half_angle_tangents():
    for t in (Fraction(0), Fraction(3, 4), Fraction(-7, 2), None):
        c, s = rational.cosine_sine(t)
        assert c * c + s * s == 1
        assert math.isclose(float(c), math.cos(rational.angle(t)), abs_tol=1e-15)
        assert math.isclose(float(s), math.sin(rational.angle(t)), abs_tol=1e-15)
    assert rational.nearest_tangent(math.pi, 10) is None
    assert rational.nearest_tangent(-math.pi / 2, 10) == -1


def test_edges_come_in_pairs_that_differ_by_the_two_solutions_that_meet():
    inside, outside = cases.edge(np.random.default_rng(4))
    counts = [cases.answer(one, 5, arm="a", key="k")["count"] for one in (inside, outside)]
    assert counts[0] == counts[1] + 2


def test_fresh_cases_have_the_form_of_the_fixture_and_are_found(capsys):
    assert oracle.fresh(3, 11) == 0
    said = capsys.readouterr().out
    assert "3 fresh cases, seed 11" in said
    assert "0 failures" in said
    (_, case), *_ = oracle.proved(1, 12)
    known = set(fixture()["cases"][0])
    assert known - set(case) == set()
    assert set(case["solutions"][0]) == set(fixture()["cases"][0]["solutions"][0])


def test_a_solver_that_loses_a_solution_is_found_out(monkeypatch, capsys):
    from pieper.ik import general_6r

    complete = general_6r.solve_general_6r

    def forgetful(*arguments, **options):
        answers = complete(*arguments, **options)
        answers.valid[0] = False
        return answers

    monkeypatch.setattr(general_6r, "solve_general_6r", forgetful)
    assert oracle.fresh(1, 11) == 1
    assert "1 missing" in capsys.readouterr().out


def test_files_are_written_in_the_format_of_the_fixture(tmp_path):
    path = tmp_path / "cases.json.gz"
    assert oracle.write(path, 3, 13) == 0
    with gzip.open(path) as file:
        data = json.load(file)
    assert set(fixture()) - set(data) <= {"checks", "total_multiple"}
    for case in data["cases"]:
        arm = data["arms"][case["arm"]]
        T = np.array(arm["base"])
        for q, link in zip(case["solutions"][0]["q"] if case["solutions"] else [], arm["links"], strict=False):
            c, s = math.cos(q), math.sin(q)
            T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]) @ np.array(link)
        if case["solutions"]:
            assert np.abs(T - np.array(case["pose"])).max() < 1e-13
