"""The swivel angle: what it measures, every branch for a value of it, where it is lost."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.errors import ArrayError
from pieper.ik.redundancy import solve_redundant
from pieper.ik.swivel import find_swivel, solve_swivel, swivel_of
from pieper.kinematics.fk import fk
from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as reference
from tests.robots import chain

SAME = 1e-6  # rad: what rounding leaves of joints at random poses
EXACT = 1e-9
KINDS = ("stereographic", "conventional")


def arm_with_elbow_offset():
    """Spherical shoulder and wrist, axes at skew angles, and an elbow beside the line between them."""
    shoulder, elbow, wrist = np.array([0.1, 0.0, 0.3]), np.array([0.14, 0.03, 0.7]), np.array([0.05, 0.1, 1.1])
    axes = [(0, 0, 1), (0, 1, 0), (0.6, 0, 0.8), (0, 1, 0.1), (0, 0, 1), (0.3, 1, 0), (0, 0.2, 1)]
    points = [shoulder] * 3 + [elbow] + [wrist] * 3
    screws = []
    for w, p in zip(axes, points, strict=True):
        w = np.array(w, dtype=float) / np.linalg.norm(w)
        screws.append(np.concatenate([np.cross(p, w), w]))
    home = np.eye(4)
    home[:3, 3] = wrist + np.array([0.02, 0.03, 0.2])
    return Chain("offset elbow", screws, home, [[-np.pi, np.pi]] * 7, [f"joint_{i}" for i in range(1, 8)])


ARMS = {"kuka_iiwa14": lambda: chain("kuka_iiwa14"), "offset elbow": arm_with_elbow_offset}


def wrapped(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def points_at(swivel, q):
    """Elbow and wrist by the textbook product of exponentials."""
    T = np.eye(4)
    for i in range(7):
        if i == 3:
            E = T @ [*swivel.elbow, 1.0]
        T = T @ reference.exponential(swivel.chain.screws[i], q[i])
    return E[:3], (T @ [*swivel.wrist, 1.0])[:3]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ARMS)
def test_the_angle_is_that_of_its_definition(name, kind):
    arm = ARMS[name]()
    swivel = find_swivel(arm, kind=kind)
    for q in np.random.default_rng(0).uniform(-3.0, 3.0, (20, 7)):
        E, W = points_at(swivel, q)
        e = (W - swivel.shoulder) / np.linalg.norm(W - swivel.shoulder)
        k = swivel.e_r if kind == "conventional" else np.cross(np.cross(e - swivel.e_t, swivel.e_r), e)
        x = k - e * (e @ k)
        x = x / np.linalg.norm(x)
        psi = swivel_of(arm, q, swivel=swivel)
        C = swivel.shoulder + e * (e @ (E - swivel.shoulder))
        radius = np.linalg.norm(E - C)
        assert np.abs(C + radius * (np.cos(psi) * x + np.sin(psi) * np.cross(e, x)) - E).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ARMS)
def test_solving_for_the_angle_finds_the_joints(name, kind):
    arm = ARMS[name]()
    swivel = find_swivel(arm, kind=kind)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 7))
    T = fk(arm, q)
    psi = swivel_of(arm, q, swivel=swivel)
    answers = solve_redundant(arm, T, values={"swivel": psi[:, None]}, swivel=swivel)
    assert (
        np.abs(wrapped(answers.q - q[:, None])).max(axis=-1).min(axis=1, initial=9.0, where=answers.valid).max() < SAME
    )
    found = answers.q[answers.valid]
    again = np.repeat(psi, answers.valid.sum(axis=1))
    assert np.abs(wrapped(swivel_of(arm, found, swivel=swivel) - again)).max() < EXACT
    assert np.nanmax(answers.position_error) < EXACT
    assert np.nanmax(answers.rotation_error) < EXACT
    assert errors(arm, found[::60], np.repeat(T, answers.valid.sum(axis=1), axis=0)[::60]) < EXACT
    if name == "kuka_iiwa14":
        assert (answers.valid.sum(axis=1) == 8).all()


def errors(arm, q, T):
    return max(np.abs(reference.fk(arm, row) - wanted).max() for row, wanted in zip(q, T, strict=True))


def test_answers_are_all_there():
    # with joint 1 held at the value of an answer, the closed form of the other six finds that answer, and no third one of the same swivel
    arm = chain("kuka_iiwa14")
    T = fk(arm, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    answers = solve_redundant(arm, T, values={"swivel": 0.7})
    for value in np.unique(answers.q[:, 0].round(9)):
        others = solve_redundant(arm, T, values={"lbr_A1": value})
        same = others.q[others.valid]
        same = same[np.abs(wrapped(swivel_of(arm, same) - 0.7)) < 1e-7]
        assert len(same) == (np.abs(answers.q[:, 0] - value) < 1e-8).sum()


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize("joint", [1, 3, 5])
def test_near_singular_poses(joint, distance):
    arm = chain("kuka_iiwa14")
    q = np.array([0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    q[joint] = distance
    T = fk(arm, q)
    angle = swivel_of(arm, q)
    answers = solve_redundant(arm, T, values={"swivel": 0.3 if np.isnan(angle) else angle})
    assert answers.valid.all()
    assert np.abs(fk(arm, answers.q) - T).max() < EXACT


def test_a_straight_arm_has_no_angle():
    arm = chain("kuka_iiwa14")
    assert np.isnan(swivel_of(arm, [0.1, 0.5, 0.2, 0.0, 0.3, 0.9, 0.4]))


def test_out_of_reach_and_too_near():
    arm = chain("kuka_iiwa14")
    T = np.eye(4)
    T[:3, 3] = [2.0, 0.0, 0.4]
    assert not solve_redundant(arm, T, values={"swivel": [0.1, 0.2]}).valid.any()


def test_the_stereographic_reference_is_lost_on_half_a_line_only():
    arm = chain("kuka_iiwa14")
    stereographic, conventional = find_swivel(arm), find_swivel(arm, kind="conventional")
    up, down = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
    assert np.isfinite(stereographic.reference(up)).all()
    assert np.isnan(stereographic.reference(down)).all()
    assert np.isnan(conventional.reference(up)).all()
    assert np.isnan(conventional.reference(down)).all()
    # elsewhere unit vectors across the line
    e = np.random.default_rng(0).normal(size=(50, 3))
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    for swivel in (stereographic, conventional):
        x = swivel.reference(e)
        assert np.abs((x * e).sum(axis=1)).max() < 1e-12
        assert np.allclose(np.linalg.norm(x, axis=1), 1.0)


def test_shapes():
    arm = chain("kuka_iiwa14")
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 1, 2, 7))
    T = fk(arm, q)
    answers = solve_redundant(arm, T, values={"swivel": [0.1, 0.2, 0.3]})
    assert answers.q.shape == (3, 1, 2, 24, 7)
    assert answers.doubtful.shape == (3, 1, 2, 3)
    one = solve_redundant(arm, T[2, 0, 1], values={"swivel": 0.2})
    assert np.array_equal(one.q, answers.q[2, 0, 1, 8:16])
    assert (answers.value[..., 8:16] == 0.2).all()
    swivel = find_swivel(arm)
    raw, angles = solve_swivel(swivel, T, np.full((3, 1, 2), 0.2))
    assert raw.shape == (3, 1, 2, 8, 7)
    assert angles.shape == (3, 1, 2, 8)


def test_another_reference_direction():
    arm = chain("kuka_iiwa14")
    side = find_swivel(arm, e_t=[0.0, 0.0, -2.0], e_r=[0.0, 1.0, 0.5])
    assert np.allclose(side.e_r, [0.0, 1.0, 0.0])
    q = [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4]
    assert abs(swivel_of(arm, q, swivel=side) - swivel_of(arm, q)) > 0.1


def test_bad_input():
    for name in ("franka_panda", "kinova_gen3_7dof", "kuka_iiwa14_ros_industrial"):
        with pytest.raises(ArrayError, match=r"three axes of .* miss each other by"):
            find_swivel(chain(name))
    with pytest.raises(ArrayError, match="6 axes that turn, of 6"):
        find_swivel(chain("ur5e"))
    arm = chain("kuka_iiwa14")
    with pytest.raises(ArrayError, match="kind must be"):
        find_swivel(arm, kind="sideways")
    with pytest.raises(ArrayError, match="e_r must not be parallel to e_t"):
        find_swivel(arm, e_t=[0.0, 0.0, 1.0], e_r=[0.0, 0.0, 2.0])
    with pytest.raises(ArrayError, match="e_t must be a direction"):
        find_swivel(arm, e_t=[0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="q must have shape"):
        swivel_of(arm, [0.0])
    with pytest.raises(ArrayError, match="miss each other"):
        solve_redundant(chain("franka_panda"), np.eye(4), values={"swivel": 0.0})
    with pytest.raises(ArrayError, match="swivel is that of"):
        solve_redundant(arm_with_elbow_offset(), np.eye(4), values={"swivel": 0.0}, swivel=find_swivel(arm))
