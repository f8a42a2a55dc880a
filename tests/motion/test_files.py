"""Trajectories in files: what is written is read back to the last bit, and a malformed file is refused in words."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.motion import files
from pieper.motion.trajectory import Trajectory

FINITE = st.floats(-1e3, 1e3)


@st.composite
def trajectories(draw):
    m, n = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    t = np.cumsum(draw(st.lists(st.floats(1e-3, 10.0), min_size=m, max_size=m)))
    block = st.lists(st.lists(FINITE, min_size=n, max_size=n), min_size=m, max_size=m)
    known = draw(st.integers(0, 2))
    names = draw(st.sampled_from([(), ("joint_1_s", "l,eft", 'say "x"', "Gelenk ä")[:n], ("time", "t", "2", "q")[:n]]))
    return Trajectory(t, draw(block), *(draw(block) if known > k else None for k in (0, 1)), joint_names=names)


def assert_equal(found, wanted):
    assert found.joint_names == wanted.joint_names
    for key in ("t", "q", "dq", "ddq"):
        one, other = getattr(found, key), getattr(wanted, key)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("suffix", files.FORMATS)
@given(trajectory=trajectories())
def test_what_is_written_is_read_back(tmp_path_factory, suffix, trajectory):
    file = tmp_path_factory.mktemp("files") / f"move{suffix}"
    files.write(trajectory, file)
    assert_equal(files.read(file), trajectory)
    files.write(trajectory, str(file))  # over itself
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_a_file_as_a_spreadsheet_writes_it(tmp_path):
    file = tmp_path / "MOVE.CSV"
    file.write_bytes(
        "\ufeffTime,elbow.velocity,elbow,wrist,wrist.velocity\r\n0,1,2,3,4\r\n\r\n1,5,6,7,8\r\n,,,,\r\n".encode()
    )
    found = files.read(file)
    assert found.joint_names == ("elbow", "wrist")
    np.testing.assert_array_equal(found.q, [[2.0, 3.0], [6.0, 7.0]])
    np.testing.assert_array_equal(found.dq, [[1.0, 4.0], [5.0, 8.0]])


MALFORMED = {
    "empty.csv": ("", "empty.csv: is empty; its first line must be: t, then the names of the joints"),
    "names.csv": ("t,a\n", "names.csv: has no points, only names"),
    "no_time.csv": ("a,b\n1,2\n", "line 1: the first column must be the time, t \\[s\\], got 'a'"),
    "time_only.csv": ("t\n1\n", "there must be a column for each joint behind the time, got t"),
    "twice.csv": ("t,a,a\n1,2,3\n", "column 'a' is there twice"),
    "short.csv": ("t,a,b\n1,2,3\n2,3\n", "short.csv, line 3: must have 3 numbers, as many as there are names, got 2"),
    "word.csv": ("t,a\n1,two\n", "word.csv, line 2: must be numbers: could not convert string to float: 'two'"),
    "nan.csv": ("t,a\n1,nan\n", "nan.csv: q must be finite, got nan"),
    "back.csv": ("t,a\n1,1\n0,1\n", "back.csv: t must be strictly increasing"),
    "half.csv": ("t,a,b,a.velocity\n1,2,3,4\n", "for every joint or for none; see 'b.velocity'"),
    "odd.csv": ("t,a,c.velocity\n1,2,3\n", "for every joint or for none; see 'c.velocity'"),
    "quote.csv": ('t,a\n1,"2\n', "quote.csv: is not CSV"),
    "latin.csv": (b"t,Gelenk_\xe4\n0,1\n", "latin.csv: is not CSV"),
    "bad.json": ("{", "bad.json: is not JSON"),
    "deep.json": ("[" * 100_000, "deep.json: is not JSON"),
    "list.json": ("[1]", "must be an object with the keys t and q, got list"),
    "no_q.json": ('{"t": [0], "dq": [[1]]}', "no_q.json: lacks q; it has: t, dq"),
    "text.json": ('{"t": "now", "q": [[1]]}', "text.json: t must be"),
    "names.json": ('{"t": [0], "q": [[1]], "joint_names": "a"}', "joint_names must be a list of names, got 'a'"),
    "nan.json": ('{"t": [0], "q": [[NaN]]}', "nan.json: q must be finite"),
    "zip.npz": ("PK", "zip.npz: is not an NPZ file"),
    "move.txt": ("", "must end in .csv, .json, .npz, got"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused_in_words(tmp_path, name):
    content, message = MALFORMED[name]
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ArrayError, match=message):
        files.read(file)


def test_an_npz_file_cannot_bring_code(tmp_path):
    np.savez(tmp_path / "evil.npz", t=np.array([print], dtype=object), q=np.zeros((1, 1)), allow_pickle=True)
    with pytest.raises(ArrayError, match=r"evil.npz: is not an NPZ file of plain arrays"):
        files.read(tmp_path / "evil.npz")


def test_a_file_that_is_too_large_is_refused(tmp_path, monkeypatch):
    files.write(Trajectory([0.0, 1.0], np.zeros((2, 500))), tmp_path / "large.npz")
    monkeypatch.setattr(files, "LARGEST_FILE", 5000)
    with pytest.raises(ArrayError, match="must not be larger than 0 MB, got 0 MB unpacked"):
        files.read(tmp_path / "large.npz")
    (tmp_path / "large.json").write_text(json.dumps({"t": [0] * 5000}))
    with pytest.raises(ArrayError, match="must not be larger than 0 MB"):
        files.read(tmp_path / "large.json")


@pytest.mark.parametrize("names", [("1", "2"), ("a", "a.velocity"), (" a", "b")])
def test_names_that_csv_cannot_hold_are_refused(tmp_path, names):
    move = Trajectory([0.0], [[1.0, 2.0]], joint_names=names)
    with pytest.raises(
        ArrayError, match=r"could not be told from other columns in a CSV file; write a \.json or \.npz file"
    ):
        files.write(move, tmp_path / "move.csv")
    assert not list(tmp_path.iterdir())
    files.write(move, tmp_path / "move.json")
    assert files.read(tmp_path / "move.json").joint_names == names


def test_where_nothing_can_be_written(tmp_path):
    move = Trajectory([0.0], [[1.0]])
    with pytest.raises(FileNotFoundError, match="no such folder"):
        files.write(move, tmp_path / "nowhere" / "move.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(IsADirectoryError, match="is a folder, not a file"):
        files.write(move, tmp_path / "folder.csv")
    with pytest.raises(ArrayError, match="a trajectory file must end in"):
        files.write(move, Path("move"))
