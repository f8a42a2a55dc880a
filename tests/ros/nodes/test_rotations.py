"""Rotations as services, against the golden table and against SciPy."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pieper.ros import messages
from pieper.ros.fake import FakeNetwork
from pieper.ros.nodes.rotations import Rotations

RODRIGUES = "pieper_interfaces/srv/QuatToRodrigues"
ZYX = "pieper_interfaces/srv/QuatToZYX"
TABLE = Path(__file__).parents[2] / "golden" / "rotations.csv"
ROWS = list(csv.DictReader(TABLE.read_text(encoding="utf-8").splitlines()))

ROUNDING = 4e-15  # a handful of double roundings on numbers up to pi
NEAR_LOCK = (
    1e-7  # outer angles near the gimbal lock: rounding divided by the distance from the lock (1e-6 rad at least)
)


class Asked:
    """The node and a user of its services."""

    def __init__(self):
        self.network = FakeNetwork()
        self.node = self.network.bus("rotations")
        self.user = self.network.bus("user")
        Rotations(self.node)
        self.clients = {t: self.user.client(n, t) for n, t in (("quat2rodrigues", RODRIGUES), ("quat2zyx", ZYX))}

    def __call__(self, type_name, q):
        answers = []
        self.clients[type_name].send(answers.append, q=dict(zip("xyzw", map(float, q), strict=True)))
        self.network.settle()
        (answer,) = answers
        names = "xyz" if type_name == RODRIGUES else "zyx"
        return np.array([getattr(answer, name).data for name in names])


@pytest.fixture(scope="module")
def ask():
    asked = Asked()
    yield asked
    assert not asked.node.errors


def values(row, *names):
    return np.array([float(row[name]) for name in names])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["case"])
def test_D5_quat2rodrigues_of_the_golden_table(ask, row):
    got = ask(RODRIGUES, values(row, "qx", "qy", "qz", "qw"))
    wanted = values(row, "rotvec_x", "rotvec_y", "rotvec_z")
    half_turn = row["gibbs_x"] == "inf"  # there either sign of the axis is right
    error = np.abs(got - wanted).max()
    assert (min(error, np.abs(got + wanted).max()) if half_turn else error) <= ROUNDING


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["case"])
def test_D4_quat2zyx_of_the_golden_table(ask, row):
    q = values(row, "qx", "qy", "qz", "qw")
    z, y, x = ask(ZYX, q)
    wanted = values(row, "z_yaw", "y_pitch", "x_roll")
    assert abs(y - wanted[1]) <= NEAR_LOCK
    if row["gimbal_lock"] == "0" and abs(abs(y) - np.pi / 2) > 1e-3:
        apart = np.abs((np.array([z, x]) - wanted[[0, 2]] + np.pi) % (2 * np.pi) - np.pi)
        assert apart.max() <= 1e-12  # what is 1e-3 rad away from the lock loses three digits
    R = Rotation.from_euler("ZYX", [z, y, x]).as_matrix()
    assert np.abs(R - Rotation.from_quat(q).as_matrix()).max() <= ROUNDING
    assert abs(y) <= np.pi / 2


QUATERNION = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3)


@settings(max_examples=60, deadline=None)
@given(QUATERNION, st.floats(1e-100, 1e100))
def test_D6_both_signs_and_every_length_give_one_answer(ask, q, length):
    q = np.array(q)
    for type_name in (RODRIGUES, ZYX):
        answer = ask(type_name, q)
        np.testing.assert_array_equal(ask(type_name, -q), answer)
        R = Rotation.from_rotvec(answer) if type_name == RODRIGUES else Rotation.from_euler("ZYX", answer)
        assert np.abs(R.as_matrix() - Rotation.from_quat(q).as_matrix()).max() <= ROUNDING
        longer = ask(type_name, length * q)
        R = Rotation.from_rotvec(longer) if type_name == RODRIGUES else Rotation.from_euler("ZYX", longer)
        assert np.abs(R.as_matrix() - Rotation.from_quat(q).as_matrix()).max() <= ROUNDING
    assert np.linalg.norm(ask(RODRIGUES, q)) <= np.pi * (1 + 1e-15)


@pytest.mark.parametrize("type_name", [RODRIGUES, ZYX])
@pytest.mark.parametrize(
    ("q", "reason"),
    [((0, 0, 0, 0), "must not be zero"), ((np.nan, 0, 0, 1), "must be finite"), ((0, np.inf, 0, 1), "must be finite")],
)
def test_D6_what_is_no_rotation_is_refused(type_name, q, reason):
    ask = Asked()
    assert np.isnan(ask(type_name, q)).all()
    service = "quat2rodrigues" if type_name == RODRIGUES else "quat2zyx"
    assert ask.node.lines[-1].startswith(f"{service}: refused: quaternion xyzw {reason}")
    assert np.isfinite(ask(type_name, (0, 0, 0, 1))).all()  # and it goes on


def test_R2_R3_fields_are_those_of_the_services():
    assert messages.fields_of(f"{ZYX}_Request") == messages.fields_of(f"{RODRIGUES}_Request") == ("q",)
    assert messages.fields_of(f"{ZYX}_Response") == ("z", "y", "x")
    assert messages.fields_of(f"{RODRIGUES}_Response") == ("x", "y", "z")


def test_R3_the_angle_is_not_lost(ask):
    quarter = ask(RODRIGUES, (0, 0, np.sqrt(0.5), np.sqrt(0.5)))
    np.testing.assert_allclose(quarter, [0, 0, np.pi / 2], atol=ROUNDING)
    np.testing.assert_array_equal(ask(RODRIGUES, (0, 0, 0, 1)), 0.0)
    np.testing.assert_allclose(ask(RODRIGUES, (1e-9, 0, 0, -1)), [-2e-9, 0, 0], rtol=1e-15)
    np.testing.assert_allclose(ask(RODRIGUES, (0, -1, 0, 0)), [0, np.pi, 0], atol=ROUNDING)


def test_on_every_network(network):
    Rotations(network.join("rotations"))
    user, answers = network.join("user"), []
    client = user.client("quat2zyx", ZYX)
    assert network.until(lambda: client.ready)
    client.send(answers.append, q={"z": 1.0, "w": 1.0})
    assert network.until(lambda: bool(answers))
    assert answers[0].z.data == pytest.approx(np.pi / 2, abs=ROUNDING)
