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
