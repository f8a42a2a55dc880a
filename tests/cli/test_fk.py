"""``pieper fk``."""

import numpy as np
import pytest

import pieper

Q = [-0.169987, -0.064662, 0.900415, 0.0, 0.395191, 0.1]
TYPED = 1e-15  # the same function is called; only the way through text is between


def test_json_is_the_pose(pieper_command) -> None:
    arm = pieper.load("mh12")
    answer = pieper_command("fk", "mh12", *Q, "--json").json
    T = arm.fk(Q)
    assert answer["arm"] == "yaskawa_mh12"
    assert (answer["base"], answer["tip"]) == ("base_link", "tool0")
    assert answer["joint_names"] == list(arm.joint_names)
    np.testing.assert_array_equal(answer["matrix"], T)
    np.testing.assert_array_equal(answer["position"], T[:3, 3])
    from pieper.spatial import rotation

    np.testing.assert_allclose(rotation.from_quaternion(answer["quaternion_xyzw"]), T[:3, :3], atol=TYPED)
    np.testing.assert_allclose(rotation.from_rpy(answer["rpy"]), T[:3, :3], atol=TYPED)


def test_degrees_are_for_joints_that_turn(pieper_command, tmp_path) -> None:
    radians = pieper_command("fk", "mh12", *Q, "--json").json
    degrees = pieper_command("fk", "mh12", "--deg", *np.degrees(Q), "--json").json
    np.testing.assert_allclose(degrees["q"], radians["q"], rtol=TYPED)

    urdf = tmp_path / "scara.urdf"
    urdf.write_text(
        '<robot name="s"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
        '<joint name="lift" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    answer = pieper_command("fk", urdf, "--deg", 90, 0.5, "--json").json
    np.testing.assert_allclose(answer["q"], [np.pi / 2, 0.5], rtol=TYPED)
    assert answer["position"] == [0.0, 0.0, 0.5]


def test_up_to_a_link(pieper_command) -> None:
    answer = pieper_command("fk", "mh12", *Q, "--up-to", "link_3_u", "--json").json
    assert answer["tip"] == "link_3_u"
    np.testing.assert_array_equal(answer["matrix"], pieper.load("mh12").fk(Q, up_to="link_3_u"))


def test_another_base_and_tip(pieper_command) -> None:
    answer = pieper_command("fk", "mh12", 0.1, 0.2, "--base", "link_1_s", "--tip", "link_3_u", "--json").json
    np.testing.assert_array_equal(answer["matrix"], pieper.load("mh12", base="link_1_s", tip="link_3_u").fk([0.1, 0.2]))


@pytest.mark.parametrize("arguments", [(), ("--deg",)])
def test_text_has_position_and_units(pieper_command, arguments) -> None:
    out = pieper_command("fk", "mh12", 0, 0, 0, 0, 0, 0, *arguments).out
    assert "0.895000" in out
    assert "1.264000" in out
    assert max(map(len, out.splitlines())) <= 80
