"""``pieper info``."""

import numpy as np
import pytest

import pieper
from pieper.model import dh
from tests.robots import NAMES


@pytest.mark.parametrize("name", NAMES)
def test_json_is_the_arm(pieper_command, name: str) -> None:
    arm = pieper.load(name)
    answer = pieper_command("info", name, "--json").json
    assert [joint["name"] for joint in answer["joints"]] == list(arm.joint_names)
    limits = [[joint["lower"], joint["upper"]] for joint in answer["joints"]]
    np.testing.assert_array_equal(
        [[-np.inf if lower is None else lower, np.inf if upper is None else upper] for lower, upper in limits],
        arm.limits,
    )
    np.testing.assert_array_equal(answer["screws"], arm.chain.screws)
    np.testing.assert_array_equal(answer["home"], arm.chain.home)
    table = dh.from_record(answer["dh"])
    assert table.dof == arm.dof
    assert 0.1 < answer["reach"]["from_base"] < 5.0


@pytest.mark.parametrize("name", NAMES)
def test_text_fits_80_columns(pieper_command, name: str) -> None:
    out = pieper_command("info", name).out
    assert max(map(len, out.splitlines())) <= 80, max(out.splitlines(), key=len)
    assert all(joint in out for joint in pieper.load(name).joint_names)


def test_an_arm_without_joints(pieper_command, tmp_path) -> None:
    urdf = tmp_path / "still.urdf"
    urdf.write_text(
        '<robot name="s"><link name="a"/><link name="b"/><joint name="j" type="fixed">'
        '<parent link="a"/><child link="b"/><origin xyz="0 0 1"/></joint></robot>'
    )
    answer = pieper_command("info", urdf, "--json").json
    assert (answer["joints"], answer["reach"]) == ([], {"from_base": 1.0, "from_first_axis": None})
    assert "0 joints" in pieper_command("info", urdf).out
    assert pieper_command("fk", urdf, "--json").json["position"] == [0.0, 0.0, 1.0]


def test_structure_in_words(pieper_command) -> None:
    ur5e = pieper_command("info", "ur5e").out.replace("\n", " ")
    assert "structure  axes 2, 3 and 4 are parallel, and axes 5 and 6 meet: up to 8 answers" in ur5e
    assert "no three axes meet or are parallel" in pieper_command("info", "crx10ia").out
    assert pieper_command("info", "kr210", "--json").json["structure"]["has_closed_form"] is True
