"""The best base pose is the one that an exhaustive look at single poses finds."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError
from pieper.spatial.rotation import from_quaternion, from_rpy
from pieper.workspace.place import base_poses, grid_of_bases, place, read_poses, write_scores
from tests.robots import chain

ROUNDING = 1e-12


def task() -> np.ndarray:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, :3] = from_rpy([[np.pi, 0.0, 0.0], [np.pi, 0.3, 0.0], [0.5 * np.pi, 0.0, 1.0]])
    T[:, :3, 3] = [[0.6, 0.1, 0.3], [0.2, 0.7, 0.4], [1.0, 0.5, 0.5]]
    return T


def test_any_number_of_workers_gives_the_same_bits() -> None:
    bases = grid_of_bases([-0.5, 1.0], [-0.5, 1.0], [0.0, 0.0], step=0.05, yaws=2)  # more than one batch
    seen: list[tuple[int, int]] = []
    alone, shared = (place(chain("ur5e"), task(), bases, workers=n) for n in (1, 2))
    for name in ("reached", "margin", "manipulability"):
        assert getattr(alone, name).tobytes() == getattr(shared, name).tobytes()
    place(chain("ur5e"), task(), bases, progress=lambda done, of: seen.append((done, of)))
    assert len(seen) > 1
    assert seen[-1] == (len(bases), len(bases))
    with pytest.raises(ArrayError, match="workers must be a whole number of at least 1, got 0"):
        place(chain("ur5e"), task(), bases, workers=0)


@pytest.mark.parametrize("name", ["ur5e", "abb_irb120", "franka_panda"])
def test_scores_are_those_of_single_poses(name: str) -> None:
    bases = grid_of_bases([0.2, 1.0], [0.0, 0.8], [0.0, 0.0], step=0.4, yaws=2)
    tried = place(chain(name), task(), bases)
    arm = pieper.load(chain(name))
    options = {}
    if arm.dof == 7:
        from pieper.ik import redundancy

        options["redundancy"] = redundancy.prepare(arm.chain).samples(16)
    for i, T_world_base in enumerate(base_poses(bases)):
        margins = []
        for T in task():
            answers = arm.ik(np.linalg.inv(T_world_base) @ T, **options)
            inside = answers.within_limits
            if inside.any():
                margins.append(float(answers.limit_margin[inside].max()))
        assert tried.reached[i] == len(margins)
        assert np.isnan(tried.margin[i]) if not margins else tried.margin[i] == pytest.approx(min(margins), abs=1e-9)
    order = tried.order
    assert (np.diff(tried.reached[order]) <= 0).all()
    assert tried.reached[tried.best] == tried.reached.max()
    ties = tried.reached == tried.reached.max()
    assert tried.margin[tried.best] == pytest.approx(np.nanmax(tried.margin[ties]), abs=1e-8)
    assert np.allclose(tried.T_world_base[:3, 3], bases[tried.best, :3], atol=ROUNDING)


def test_positions_alone_are_reached_by_an_arm_with_five_joints() -> None:
    bases = grid_of_bases([0.0, 0.4], [0.0, 0.0], [0.0, 0.0], step=0.2, yaws=1)
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, 3] = [[0.3, 0.1, 0.2], [0.4, -0.1, 0.2]]
    assert place(chain("kuka_youbot"), T, bases, position_only=True).score[0] == 2
    assert place(chain("kuka_youbot"), T, bases).score[0] == 0


def test_files_of_poses_are_read(tmp_path: Path) -> None:
    file = tmp_path / "task.csv"
    file.write_text("x,y,z,roll,pitch,yaw\n0.1,0.2,0.3,0.4,0.5,0.6\n\n")
    T, alone = read_poses(file)
    assert not alone
    assert np.allclose(T[0, :3, :3], from_rpy([0.4, 0.5, 0.6]), atol=ROUNDING)
    file.write_text("x,y,z,qx,qy,qz,qw\n0.1,0.2,0.3,0,0,0.6,0.8\n")
    assert np.allclose(read_poses(file)[0][0, :3, :3], from_quaternion([0.0, 0.0, 0.6, 0.8]), atol=ROUNDING)
    file.write_text("x,y,z\n0.1,0.2,0.3\n")
    assert read_poses(file)[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: expected the columns x,y,z,qx,qy,qz,qw; .* got nothing"),
        ("a,b\n1,2\n", "line 1: expected the columns .* got a,b"),
        ("x,y,z\n", "holds no poses"),
        ("x,y,z\n1,2\n", r"line 2: expected 3 values \(x,y,z\), got 2"),
        ("x,y,z\n1,2,high\n", "line 2: z must be a finite number, got 'high'"),
        ("x,y,z\n1,2,nan\n", "line 2: z must be a finite number, got 'nan'"),
        ("x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,2\n", "pose 1: qx,qy,qz,qw must have length 1, got 2"),
    ],
)
def test_a_malformed_file_of_poses_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "task.csv"
    file.write_text(text)
    with pytest.raises(ArrayError, match=message):
        read_poses(file)


def test_bad_bases_are_refused() -> None:
    with pytest.raises(ArrayError, match="step must be a positive length"):
        grid_of_bases([0, 1], [0, 1], [0, 0], step=0.0)
    with pytest.raises(ArrayError, match="yaws must be a whole number of at least 1"):
        grid_of_bases([0, 1], [0, 1], [0, 0], yaws=0)
    with pytest.raises(ArrayError, match="x must go from a finite value to one that is not less"):
        grid_of_bases([1, 0], [0, 1], [0, 0])
    with pytest.raises(ArrayError, match="base poses are too many"):
        grid_of_bases([0, 100], [0, 100], [0, 100], step=0.1)
    with pytest.raises(ArrayError, match=r"bases must be finite with shape \(k, 4\)"):
        place(chain("ur5e"), task(), np.zeros((0, 4)))
    with pytest.raises(ArrayError, match="at least one pose"):
        place(chain("ur5e"), np.zeros((0, 4, 4)), np.zeros((1, 4)))


def test_scores_are_written_best_first(tmp_path: Path) -> None:
    tried = place(chain("ur5e"), task(), grid_of_bases([0.0, 0.6], [0.0, 0.6], [0.0, 0.0], step=0.3, yaws=1))
    with write_scores([tried], tmp_path / "scores.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [int(row["reached"]) for row in rows] == sorted(tried.reached.tolist(), reverse=True)
    assert float(rows[0]["x"]) == tried.bases[tried.best, 0]
    with pytest.raises(ArrayError, match=r"ends in \.csv"):
        write_scores([tried], tmp_path / "scores.txt")
