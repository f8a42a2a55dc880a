"""``pieper calibrate-arm``: a table, a calibrated arm that every verb reads, and complaints in words."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.cli.arguments import load
from pieper.kinematics.measurements import write_measurements
from tests.kinematics.test_calibration import built, joints

ARM = pieper.load("ur5e").chain
REAL = pieper.load(built(ARM, 4, 0.003))
Q = joints(ARM, 60)


@pytest.fixture
def measured(tmp_path):
    file = tmp_path / "measured.csv"
    noise = np.random.default_rng(0).normal(0.0, 5e-5, (60, 3))
    noise[40] += 0.02
    write_measurements(file, ARM, Q, REAL.fk(Q)[:, :3, 3] + noise)
    return file


@pytest.mark.parametrize("suffix", ["json", "urdf"])
def test_the_calibrated_arm_is_read_again(pieper_command, measured, tmp_path, suffix):
    out = tmp_path / f"calibrated.{suffix}"
    result = pieper_command("calibrate-arm", "ur5e", measured, "--out", out, "--position-sigma", 5e-5, "--add", 2)
    assert result.code == 0, result.err
    other = joints(ARM, 30, 5)
    error = np.linalg.norm((load(str(out)).fk(other) - REAL.fk(other))[:, :3, 3], axis=1)
    assert np.median(error) < 1e-4
    for words in (
        "wrist_3_joint        moved along z",
        "59 used, 1 left out: row 41",
        "27 of 30 parameters",
        "chi-square",
        "positions do not show the orientation of the tip",
        "measure next",
        f"wrote {out}",
    ):
        assert words in result.out


def test_json_and_held_out_rows(pieper_command, measured):
    said = pieper_command("calibrate-arm", "ur5e", measured, "--hold-out", 0.25, "--json").json
    assert said["rank"] == 27
    assert len(said["held_out"]["position_error"]) == 15
    assert np.median(said["held_out"]["position_error"]) < 0.1 * np.median(said["held_out"]["position_before"])
    assert {p["kind"] for p in said["parameters"]} == {"screws", "home"}
    offsets = pieper_command("calibrate-arm", "ur5e", measured, "--free", "offsets", "--json").json
    assert [p["kind"] for p in offsets["parameters"]] == ["offsets"] * 6


def test_degrees(pieper_command, tmp_path):
    file = tmp_path / "measured.csv"
    write_measurements(file, ARM, np.degrees(Q), REAL.fk(Q))
    said = pieper_command("calibrate-arm", "ur5e", file, "--deg", "--json").json
    assert said["position_rms"] < 1e-9


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--out", "arm.txt"], "--out must end in .json or .urdf"),
        (["--hold-out", "1"], "--hold-out must be a share from 0 up to 1, got 1"),
        (["--hold-out", "0.95"], "numbers for 30 parameters"),
        (["--free", "gears"], "gears"),
        (["--add", "-1"], "--add must be a number of poses, got -1"),
        (["--position-sigma", "0"], "position_sigma must be above zero"),
    ],
)
def test_complaints(pieper_command, measured, options, complaint):
    result = pieper_command("calibrate-arm", "ur5e", measured, *options)
    assert result.code == 2
    assert complaint in result.err


def test_a_file_that_is_not_there(pieper_command, tmp_path):
    result = pieper_command("calibrate-arm", "ur5e", tmp_path / "none.csv")
    assert result.code == 2
    assert "none.csv: No such file" in result.err


def test_the_measurements_are_not_written_over(pieper_command, measured):
    out = measured.with_suffix(".json")
    out.symlink_to(measured)
    before = measured.read_bytes()
    assert pieper_command("calibrate-arm", "ur5e", measured, "--out", out).code == 2
    assert measured.read_bytes() == before
