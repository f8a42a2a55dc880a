"""``pieper reach`` and ``pieper ik``: the answer, its errors, and the exit code."""

import re

import numpy as np
import pytest

import pieper
from pieper.spatial import rotation
from tests.robots import NAMES

REACHED = 1e-9  # [m, rad] the solver's own tolerance
AS_PRINTED = 1e-12  # [m] a pose computed again from joint values that went through text in full


def reachable(name: str) -> np.ndarray:
    """A pose that the arm surely reaches: that of the middle of its limits, a little to one side."""
    arm = pieper.load(name)
    limits = np.where(np.isfinite(arm.limits), arm.limits, [-np.pi, np.pi])
    return arm.fk(limits.mean(axis=1) + 0.1 * np.arange(1, arm.dof + 1) / arm.dof)


def test_the_report_target(pieper_command) -> None:
    result = pieper_command("reach", "mh12", 0.3, 0.3, 0.3, "--json")
    assert result.code == 0
    answer = result.json
    assert answer["reached"] is True
    assert answer["status"] == "reached"
    assert answer["nearest"] is None
    assert answer["position_error"] <= REACHED
    T = pieper.load("mh12").fk(answer["q"])
    np.testing.assert_allclose(T[:3, 3], [0.3, 0.3, 0.3], atol=REACHED)
    np.testing.assert_allclose(answer["position"], T[:3, 3], atol=AS_PRINTED)
    np.testing.assert_allclose(rotation.from_quaternion(answer["quaternion_xyzw"]), T[:3, :3], atol=AS_PRINTED)
    assert min(answer["margin"]) > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_reaches_a_pose_of_its_own(pieper_command, name: str) -> None:
    T = reachable(name)
    quaternion = rotation.as_quaternion(T[:3, :3])
    result = pieper_command("reach", name, *T[:3, 3], "--quat", *quaternion, "--json")
    assert result.code == 0
    np.testing.assert_allclose(pieper.load(name).fk(result.json["q"]), T, atol=10 * REACHED)


@pytest.mark.parametrize("name", NAMES)
def test_text_fits_80_columns_and_one_screen(pieper_command, name: str) -> None:
    T = reachable(name)
    result = pieper_command("reach", name, *T[:3, 3], "--rpy", *rotation.as_rpy(T[:3, :3]))
    lines = result.out.splitlines()
    assert max(map(len, lines)) <= 80, max(lines, key=len)
    assert len(lines) <= 24
    assert result.code == 0
    assert lines[-1].startswith("reached")


def test_ways_to_ask_for_an_orientation(pieper_command) -> None:
    target = ("ur5e", -0.4, 0.2, 0.3)
    rpy = pieper_command("reach", *target, "--rpy", -3.0, 0.1, -0.2, "--json").json
    degrees = pieper_command("reach", *target, "--rpy", *np.degrees([-3.0, 0.1, -0.2]), "--deg", "--json").json
    quaternion = rotation.as_quaternion(rotation.from_rpy([-3.0, 0.1, -0.2]))
    quat = pieper_command("reach", *target, "--quat", *quaternion, "--json").json
    for answer in (rpy, degrees, quat):
        R = rotation.from_quaternion(answer["quaternion_xyzw"])
        np.testing.assert_allclose(R, rotation.from_rpy([-3.0, 0.1, -0.2]), atol=10 * REACHED)
    for axis in ([0.0, 0.0, -2.0], [0.0, 2.0, 0.0], [0.0, -1.0, 0.0], [1.0, 1.0, 1.0]):
        answer = pieper_command("reach", *target, "--axis", *axis, "--json").json
        R = rotation.from_quaternion(answer["quaternion_xyzw"])
        np.testing.assert_allclose(R[:, 2], axis / np.linalg.norm(axis), atol=10 * REACHED)
        assert answer["target"]["axis"] == axis


def test_out_of_reach_is_code_1_with_the_distance(pieper_command) -> None:
    result = pieper_command("reach", "mh12", 3, 0, 0.45, "--json")
    assert result.code == 1
    answer = result.json
    assert answer["reached"] is False
    assert answer["status"] == "unreachable"
    assert answer["nearest"]["out_of_reach"] == pytest.approx(answer["position_error"])
    tip = pieper.load("mh12").fk(answer["q"])[:3, 3]
    assert np.linalg.norm(tip - [3, 0, 0.45]) == pytest.approx(answer["position_error"], abs=AS_PRINTED)
    shown = pieper_command("reach", "mh12", 3, 0, 0.45)
    assert shown.code == 1
    assert "not reached  out of reach by " in shown.out
    assert pieper_command("ik", "mh12", 3, 0, 0.45).code == 1


def test_a_seed_chooses_the_answer(pieper_command) -> None:
    arm = pieper.load("ur5e")
    q = np.array([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    T = arm.fk(q)
    target = ("ur5e", *T[:3, 3], "--quat", *rotation.as_quaternion(T[:3, :3]))
    seed = ",".join(str(value) for value in q + 0.05)
    answer = pieper_command("reach", *target, "--from", seed, "--json").json
    np.testing.assert_allclose(
        answer["q"], q, atol=1e-6
    )  # well conditioned: 1e-9 of pose is far less than 1e-6 of joint
    seed = " ".join(str(value) for value in np.degrees(q - 0.05))
    answer = pieper_command("reach", *target, "--from", seed, "--deg", "--json").json
    np.testing.assert_allclose(answer["q"], q, atol=1e-6)
    answers = pieper_command("ik", *target, "--from", seed, "--deg", "--json").json["answers"]
    np.testing.assert_allclose(answers[0]["q"], q, atol=1e-6)


def test_ik_lists_answers_that_differ(pieper_command) -> None:
    target = ("ur5e", 0.4, 0.2, 0.3, "--rpy", 180, 0, 0, "--deg")
    answer = pieper_command("ik", *target, "--json").json
    assert len(answer["answers"]) == 8
    assert answer["complete"] is True
    assert len({record["branch"] for record in answer["answers"]}) == 8
    arm = pieper.load("ur5e")
    for one in answer["answers"]:
        T = arm.fk(one["q"])
        np.testing.assert_allclose(T[:3, 3], [0.4, 0.2, 0.3], atol=10 * REACHED)
        assert one["within_limits"]
    q = np.array([one["q"] for one in answer["answers"]])
    apart = np.abs(q[:, None] - q[None]).max(axis=-1) + 10.0 * np.eye(8)
    assert apart.min() > 1e-3
    shown = pieper_command("ik", *target)
    assert max(map(len, shown.out.splitlines())) <= 80
    assert f"{np.degrees(q[0, 0]):.4f}" in shown.out
    assert len(pieper_command("ik", *target, "--count", 2, "--json").json["answers"]) == 2


def test_steps_are_shown_on_request_only(pieper_command, monkeypatch: pytest.MonkeyPatch) -> None:
    from pieper.cli import reach

    monkeypatch.setattr(reach, "_FRAME_SECONDS", 0.0)
    assert "step" not in pieper_command("reach", "mh12", 0.3, 0.3, 0.3).out.replace("steps from", "")
    lines = pieper_command("reach", "mh12", 0.3, 0.3, 0.3, "--animate").out.splitlines()
    left = [float(line.split()[2]) for line in lines if line.startswith("step")]
    assert left[-1] < 1e-3 < left[0]
    assert left == sorted(left, reverse=True)
    assert pieper_command("reach", "mh12", 3, 3, 3, "--animate").code == 1


@pytest.mark.parametrize(
    "arguments", [("mh12", 0.3, 0.3, 0.3), ("ur5e", 2, 0, 0), ("youbot", 0.3, 0, 0.1, "--axis", 0, 0, -1)]
)
def test_on_a_terminal_the_same_answer_comes_after_the_steps(
    pieper_command, monkeypatch: pytest.MonkeyPatch, arguments
) -> None:
    from pieper.cli import reach

    monkeypatch.setattr(reach, "_FRAME_SECONDS", 0.0)
    piped = pieper_command("reach", *arguments)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    shown = pieper_command("reach", *arguments)
    assert shown.code == piped.code
    assert "step  1  " in shown.out
    assert "\x1b[3" in shown.out
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.out).replace("\r", "")
    assert plain.endswith(piped.out.split("\n", 2)[2])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["reach", "mh12", 0.3, 0.3], "Missing argument 'Z'"),
        (["reach", "mh12", 0.3, 0.3, "nan"], "finite"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--rpy", 1, 2], "--rpy"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--rpy", 0, 0, 0, "--axis", 0, 0, 1], "--rpy and --axis"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--quat", 0, 0, 0, 0], "quaternion"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--axis", 0, 0, 0], "length 0"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--axis", 0, "inf", 0], "finite"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--from", "1,2"], "6 joints"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--from", "a,b"], "--from must be numbers"),
        (["reach", "mh12", 0.3, 0.3, 0.3, "--from", "nan,0,0,0,0,0"], "finite"),
        (["ik", "mh12", 0.3, 0.3, 0.3, "--count", 0], "--count"),
    ],
)
def test_bad_targets_are_code_2(pieper_command, arguments, complaint: str) -> None:
    result = pieper_command(*arguments)
    assert result.code == 2
    assert result.out == ""
    assert complaint in result.err
    assert result.err.count("\n") == 1


def test_ik_takes_a_value_of_the_redundancy(pieper_command) -> None:
    target = ("panda", 0.4, 0.2, 0.4, "--rpy", 180, 0, 0, "--deg", "--json")
    held = pieper_command("ik", *target, "--redundancy", 40).json
    assert held["answers"]
    assert all(abs(np.degrees(answer["q"][6]) - 40.0) < 1e-9 for answer in held["answers"])
    named = pieper_command("ik", *target, "--redundancy", "panda_joint1=10").json
    assert all(abs(np.degrees(answer["q"][0]) - 10.0) < 1e-9 for answer in named["answers"])
    refused = pieper_command("ik", *target[:-1], "--redundancy", "much")
    assert refused.code == 2
    assert "--redundancy must be a number" in refused.err
