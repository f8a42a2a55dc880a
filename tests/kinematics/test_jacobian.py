"""Jacobians against Pinocchio, the reference rows, mpmath derivatives and each other."""

from __future__ import annotations

from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import (
    hessian,
    jacobian,
    jacobian_body,
    jacobian_rate,
    jacobian_space,
    manipulability,
)
from pieper.model.chain import Chain
from pieper.spatial import twist
from tests.kinematics.test_fk import FROM_URDF, random_chains, some_joints
from tests.robots import NAMES, chain

GOLDEN = Path(__file__).parents[1] / "golden"
SAME_JACOBIAN = 1e-12  # [m/rad]: rounding of a dozen products of numbers of a few metres
REFERENCE = 1e-10  # stated with the rows
DERIVATIVE = 1e-9  # central difference of step 1e-5: (1e-5)^2 truncation and 1e-16/1e-5 rounding, times a few metres


def test_reference_rows():
    rows = yaml.safe_load((GOLDEN / "jacobian.yaml").read_text())
    assert len(rows) >= 10
    for row in rows:
        J = pieper.load(row["robot"]).jacobian(row["q"])
        assert np.abs(J - row["J"]).max() < REFERENCE
        assert np.abs(np.linalg.svd(J, compute_uv=False) - row["singular_values"]).max() < REFERENCE


@pytest.mark.parametrize("nominal", [False, True])
@pytest.mark.parametrize("name", FROM_URDF)
def test_equals_pinocchio(name, nominal, instruction_set):
    pinocchio_model = pytest.importorskip("tests.reference.pinocchio_model", exc_type=ImportError)
    import pinocchio as pin

    truth, arm = pinocchio_model.PinocchioArm(name, nominal=nominal), chain(name, nominal)
    q = some_joints(arm, 33)
    for kind, frame in (
        (jacobian, pin.LOCAL_WORLD_ALIGNED),
        (jacobian_space, pin.WORLD),
        (jacobian_body, pin.LOCAL),
    ):
        expected = np.array([truth.jacobian(row, frame) for row in q])
        assert np.abs(kind(arm, q) - expected).max() < SAME_JACOBIAN
        assert max(np.abs(kind(arm, row) - J).max() for row, J in zip(q, expected, strict=True)) < SAME_JACOBIAN
    dq = np.random.default_rng(5).uniform(-1, 1, q.shape)
    rates = np.array([truth.jacobian_rate(a, b) for a, b in zip(q, dq, strict=True)])
    assert np.abs(jacobian_rate(arm, q, dq) - rates).max() < SAME_JACOBIAN * 10  # sums over the joints


@settings(max_examples=100, deadline=None)
@given(arm=random_chains(), seed=st.integers(0, 1000))
def test_any_chain_equals_the_derivative_of_its_pose(arm, seed):
    q = np.random.default_rng(seed).uniform(-3, 3, (arm.dof,))
    space, body, geometric = jacobian_space(arm, q), jacobian_body(arm, q), jacobian(arm, q)
    T = fk(arm, q)
    h = 1e-5
    for i in range(arm.dof):
        step = np.eye(arm.dof)[i] * h
        forward, back = fk(arm, q + step), fk(arm, q - step)
        scale = 1.0 + np.abs(T).max() + np.abs(arm.screws).max()
        assert np.abs(twist.log(forward @ np.linalg.inv(back)) / (2 * h) - space[:, i]).max() < DERIVATIVE * scale**2
        assert np.abs((forward - back)[:3, 3] / (2 * h) - geometric[:3, i]).max() < DERIVATIVE * scale**2
    assert (
        np.abs(twist.adjoint(T) @ body - space).max(initial=0) < SAME_JACOBIAN * (1 + np.abs(space).max(initial=0)) * 10
    )
    assert np.array_equal(geometric[3:], space[3:]) or np.abs(geometric[3:] - space[3:]).max() < SAME_JACOBIAN


@pytest.mark.parametrize("name", NAMES)
def test_hessian_is_the_derivative_and_rate_is_its_sum(name):
    arm = chain(name)
    q, dq = some_joints(arm, 1)[0], np.random.default_rng(1).uniform(-1, 1, arm.dof)
    H, h = hessian(arm, q), 1e-5
    for i in range(arm.dof):
        step = np.eye(arm.dof)[i] * h
        change = (jacobian(arm, q + step) - jacobian(arm, q - step)) / (2 * h)
        assert np.abs(H[i] - change).max() < DERIVATIVE * 10
    assert np.abs(jacobian_rate(arm, q, dq) - np.einsum("iab,i->ab", H, dq)).max() < SAME_JACOBIAN


@pytest.mark.parametrize("name", NAMES)
def test_manipulability_is_the_product_of_the_singular_values(name, instruction_set):
    arm = chain(name)
    q = some_joints(arm, 50)
    products = np.prod(np.linalg.svd(jacobian(arm, q), compute_uv=False), axis=-1)
    assert np.abs(manipulability(arm, q) - products).max() < SAME_JACOBIAN * (1 + products.max())


def test_manipulability_keeps_its_digits_next_to_a_singularity():
    """Half of the digits are lost when J J^T is formed; the exact value here is found with 50 digits."""
    arm = chain("ur5e", True)
    with mp.workdps(50):
        for bend in (1e-3, 1e-6, 1e-9, 1e-12):
            q = np.array([0.3, -1.0, 0.8, -0.4, bend, 0.2])
            exact = float(mp.fabs(mp.det(mp.matrix(jacobian(arm, q).tolist()))))
            assert manipulability(arm, q) == pytest.approx(exact, rel=1e-3, abs=1e-16)


def test_coupled_columns_add_up():
    arm = Chain(
        name="scissors",
        screws=[[0, 0, 0, 0, 0, 1], [0, -1, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0]],
        home=np.eye(4) + np.eye(4, k=3) * 3.0,
        limits=[[-1, 1], [-1, 1]],
        joint_names=("drive", "slide"),
        coupling=[[1, 0], [-2, 0], [0.5, 1]],
    )
    q, h = np.array([0.4, 0.2]), 1e-6
    for i in range(2):
        step = np.eye(2)[i] * h
        change = (fk(arm, q + step) - fk(arm, q - step))[:3, 3] / (2 * h)
        assert np.abs(jacobian(arm, q)[:3, i] - change).max() < DERIVATIVE
        derivative = (jacobian(arm, q + step) - jacobian(arm, q - step)) / (2 * h)
        assert np.abs(hessian(arm, q)[i] - derivative).max() < DERIVATIVE
    assert manipulability(arm, q) == pytest.approx(np.prod(np.linalg.svd(jacobian(arm, q), compute_uv=False)))


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,), (9,)])
def test_leading_axes(shape):
    arm = pieper.load("panda")
    q = np.random.default_rng(1).uniform(-1, 1, (*shape, 7))
    assert arm.jacobian(q).shape == (*shape, 6, 7)
    assert arm.jacobian_space(q).shape == (*shape, 6, 7)
    assert arm.jacobian_body(q).shape == (*shape, 6, 7)
    assert arm.hessian(q).shape == (*shape, 7, 6, 7)
    assert arm.jacobian_rate(q, np.ones(7)).shape == (*shape, 6, 7)
    assert np.shape(arm.manipulability(q)) == shape
    for index in np.ndindex(shape):
        assert np.abs(arm.jacobian(q)[index] - arm.jacobian(q[index])).max() < SAME_JACOBIAN


def test_large_batches_pass_the_cache_unharmed(instruction_set):
    arm = pieper.load("panda")
    q = some_joints(arm.chain, 30_011)
    J = arm.jacobian(q)
    few = np.concatenate([arm.jacobian(part) for part in np.array_split(q, 40)])
    assert np.array_equal(J, few)
    assert np.array_equal(arm.jacobian(q, threads=2), J)


def test_bad_input_is_named():
    arm = pieper.load("ur5e")
    for call in (arm.jacobian, arm.jacobian_space, arm.jacobian_body, arm.hessian, arm.manipulability):
        with pytest.raises(ArrayError, match=r"q must have shape \(\.\.\., 6\), got \(5,\)"):
            call([0.0] * 5)
        with pytest.raises(ArrayError, match=r"q must be finite, got q\[1\] = nan"):
            call([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="dq must have shape"):
        arm.jacobian_rate([0.0] * 6, [0.0] * 7)
    with pytest.raises(ArrayError, match=r"q and dq must broadcast, got \(2, 6\) and \(3, 6\)"):
        arm.jacobian_rate(np.zeros((2, 6)), np.zeros((3, 6)))
    with pytest.raises(ArrayError, match=r"out must be a float64 array of shape \(6, 6\)"):
        arm.jacobian([0.0] * 6, out=np.zeros((6, 7)))
