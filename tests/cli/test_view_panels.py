"""The tabs that options of ``pieper view`` bring: ``--solve``, ``--compare``, ``--trajectory``, ``--iterate``."""

from __future__ import annotations

import pytest

import pieper
from pieper.cli.view import _iterations
from pieper.motion import files
from pieper.motion.trajectory import Trajectory

pytest.importorskip("viser", reason="the viewer's extra is not installed")


def test_every_tab_at_once(pieper_command, tmp_path):
    move = tmp_path / "move.csv"
    files.write(Trajectory([0.0, 1.0], [[0.0] * 6, [0.3] * 6]), move)
    page = tmp_path / "page.html"
    options = [
        "--compare",
        "kr210_l150",
        "--trajectory",
        move,
        "--iterate",
        1.5,
        0.5,
        1.5,
        "--k1",
        0.1,
        "--k1",
        0.5,
    ]
    result = pieper_command("view", "kr210", "--solve", *options, "--export", page)
    assert result.code == 0, result.err
    assert page.stat().st_size > 100_000


def test_row_e7_an_iteration_for_each_gain():
    """Rows E6 and E7: 61 steps within 10.1 mm of the straight line, and 4 that stray by 327 mm."""
    arm = pieper.load("ur5e")
    start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
    tracks = _iterations(arm, start, (0.5, -0.6, 0.2), [0.1, 1.0], hold=True)
    assert [track.name for track in tracks] == ["gain 0.1", "gain 1"]
    assert [len(track.errors) - 1 for track in tracks] == [61, 4]
    assert [track.straightness for track in tracks] == [pytest.approx(0.0101, rel=5e-3), pytest.approx(0.327, rel=5e-3)]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--compare", "panda"], "no joint name in common and 6 and 7 joints"),
        (["--compare", "kr210:repor"], "no DH table 'repor' in the records of 'kr210'; did you mean 'report'?"),
        (["--iterate", "nan", "0", "0"], "target must be finite, got nan"),
        (["--iterate", "0.5", "0", "0", "--k1", "-1"], "k1 must be a positive number, got -1.0"),
        (["--trajectory", "nothing.csv"], "nothing.csv"),
    ],
)
def test_what_makes_no_sense_is_told(pieper_command, tmp_path, options, said):
    result = pieper_command("view", "ur5e", *options, "--export", tmp_path / "page.html")
    assert result.code == 2
    assert said in result.err
    assert not list(tmp_path.iterdir())


def test_a_dh_table_on_record_is_an_arm(pieper_command):
    by_rows, by_urdf = (
        pieper_command("fk", name, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, "--json") for name in ("kr210:report", "kr210")
    )
    assert by_rows.code == by_urdf.code == 0
    for one, two in zip(by_rows.json["position"], by_urdf.json["position"], strict=True):
        assert one == pytest.approx(two, abs=1e-12)
