"""``pieper convert``: what it writes is the same arm."""

import json

import numpy as np
import pytest

import pieper
from pieper.cli import record
from pieper.model import dh

SAME = 1e-12  # [m, -] a description that was written and read again
ARMS = ("mh12", "ur5e", "youbot", "panda", "so101")


def poses(arm: pieper.Arm) -> np.ndarray:
    return arm.fk(np.random.default_rng(3).uniform(-2.0, 2.0, (20, arm.dof)))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("to", ["dh", "mdh", "hayati", "screws"])
def test_json_is_read_again(pieper_command, tmp_path, name: str, to: str) -> None:
    file = tmp_path / "arm.json"
    assert pieper_command("convert", name, "--to", to, "--json", "--out", file).code == 0
    arm, again = pieper.load(name), pieper.load(record.from_file(str(file)))
    np.testing.assert_allclose(poses(again), poses(arm), atol=SAME)
    assert again.joint_names == arm.joint_names


@pytest.mark.parametrize("name", ARMS)
def test_urdf_is_read_again(pieper_command, tmp_path, name: str) -> None:
    text = pieper_command("convert", name, "--to", "urdf").out
    np.testing.assert_allclose(poses(pieper.load(text)), poses(pieper.load(name)), atol=SAME)
    file = tmp_path / "arm.urdf"
    assert pieper_command("convert", name, "--to", "urdf", "--out", file).out == ""
    assert file.read_text() == text


def test_dh_is_text_or_a_record(pieper_command) -> None:
    shown = pieper_command("convert", "mh12", "--to", "dh").out
    assert "joint_5_b" in shown
    assert "alpha [deg]" in shown
    assert dh.from_record(pieper_command("convert", "mh12", "--to", "mdh", "--json").json).convention == "modified"


def test_part_of_an_arm(pieper_command) -> None:
    part = pieper_command("convert", "mh12", "--to", "screws", "--json", "--tip", "link_3_u").json
    assert part["joint_names"] == ["joint_1_s", "joint_2_l", "joint_3_u"]
    assert part["tip"] == "link_3_u"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "is not JSON"),
        ("[" * 100000, "is not JSON"),
        ("[1, 2]", "holds neither DH rows"),
        ('{"rows": 3}', "is malformed"),
        ('{"convention": "standard", "rows": [{"a": "long"}]}', "long"),
        ('{"screws": [[0, 0, 0, 0, 0, 1]], "home": 1, "joint_names": ["a"]}', "home must have shape (4, 4)"),
        ('{"screws": [[0, 0, 0, 0, 0, 1]], "home": 1, "joint_names": ["a"], "limits": 5}', "is malformed"),
        ('{"screws": [[0, 0, 0, 0, 0, 1]], "home": 1, "joint_names": 7}', "is malformed"),
    ],
)
def test_bad_files_are_refused_in_words(pieper_command, tmp_path, text: str, complaint: str) -> None:
    file = tmp_path / "arm.json"
    file.write_text(text)
    result = pieper_command("fk", file, 0.0)
    assert result.code == 2
    assert complaint in result.err


def test_a_file_that_cannot_be_written(pieper_command, tmp_path) -> None:
    result = pieper_command("convert", "mh12", "--to", "urdf", "--out", tmp_path / "none" / "arm.urdf")
    assert result.code == 2
    assert "none: no such folder" in result.err


def test_limits_survive(pieper_command, tmp_path) -> None:
    file = tmp_path / "arm.json"
    for to in ("dh", "screws"):
        pieper_command("convert", "gen3", "--to", to, "--json", "--out", file)
        joints = pieper_command("info", file, "--json").json["joints"]
        assert joints == pieper_command("info", "gen3", "--json").json["joints"]
        assert None in [joint["lower"] for joint in json.loads(json.dumps(joints))]


def test_formulas(pieper_command, tmp_path) -> None:
    from pieper.model import symbolic

    arm = pieper.load("youbot")
    file = tmp_path / "T.yaml"
    assert pieper_command("convert", "youbot", "--to", "sympy", "--out", file).code == 0
    q = np.array([0.1, -0.2, 0.3, -0.4, 0.5])
    np.testing.assert_allclose(symbolic.load(file, joint_names=arm.joint_names)(q), arm.fk(q), atol=SAME)
    assert "\\cos" in pieper_command("convert", "youbot", "--to", "latex").out
    assert "cos(" in pieper_command("convert", "youbot", "--to", "c").out
    namespace: dict = {}
    exec(pieper_command("convert", "youbot", "--to", "python").out, namespace)
    np.testing.assert_allclose(np.array(namespace["forward_kinematics"](q)).reshape(4, 4), arm.fk(q), atol=SAME)
    assert pieper_command("convert", "youbot", "--to", "c", "--json").json["format"] == "c"
