"""``pieper workspace`` and ``pieper place``: what they print and write, and what they say of bad input."""

from __future__ import annotations

import sys

import matplotlib.image
import pytest

pytest.importorskip("zarr", reason="zarr is not installed: the extra 'maps'")

SMALL = ("--voxel", 0.3, "--orientations", 8)


def test_a_map_is_made_kept_drawn_exported_and_shown(pieper_command, tmp_path):
    out, figure, table = tmp_path / "map.zarr", tmp_path / "map.png", tmp_path / "map.csv"
    result = pieper_command("workspace", "ur5e", *SMALL, "--out", out, "--figure", figure, "--export", table)
    assert result.code == 0, result.err
    for words in ("voxels of 300 mm, 8 orientations", "reachable", "dexterous", "up to 8 of a pose", f"wrote {out}"):
        assert words in result.out
    picture = matplotlib.image.imread(figure)
    assert picture[..., :3].std() > 0.1
    assert len(table.read_text().splitlines()) > 20
    again = pieper_command("workspace", "ur5e", *SMALL, "--out", out, "--resume", "--json")
    assert again.json["poses_per_second"] is None  # all was there
    assert again.json["most_solutions"] == 8
    page = tmp_path / "page.html"
    assert pieper_command("view", "ur5e", "--map", out, "--show", "manipulability", "--export", page).code == 0
    assert page.stat().st_size > 100_000
    other = pieper_command("view", "ur5", "--map", out, "--export", page)
    assert other.code == 2
    assert "is a map of 'ur5e'" in other.err


def test_a_slice_and_a_tool(pieper_command, tmp_path):
    layer = ("--slice", "y=0", "--counts-only", "--figure", tmp_path / "map.svg")
    result = pieper_command("workspace", "ur5e", *SMALL, *layer, "--json")
    assert result.code == 0, result.err
    assert result.json["shape"][1] == 1
    longer = pieper_command("workspace", "ur5e", *SMALL, "--slice", "y=0", "--tool", 0, 0, 0.3, "--json")
    assert longer.json["reachable"] > result.json["reachable"]


def test_obstacles_leave_less(pieper_command, tmp_path):
    pytest.importorskip("coal", reason="coal is not installed: the extra 'plan'")
    world = tmp_path / "table.yaml"
    world.write_text("obstacles:\n  - {name: table, box: [2.0, 2.0, 0.1], position: [0, 1.3, 0.3]}\n")
    options = ("--voxel", 0.3, "--orientations", 2, "--box", 0, 0.3, 0.2, 0.6, 0.1, 0.7, "--counts-only", "--json")
    alone = pieper_command("workspace", "ur5e", *options, "--collision").json
    among = pieper_command("workspace", "ur5e", *options, "--world", world).json
    assert among["collision"] is True
    assert among["mean_dexterity"] < alone["mean_dexterity"] or among["reachable"] < alone["reachable"]
    missing = pieper_command("workspace", "ur5e", *options, "--world", tmp_path / "none.yaml")
    assert missing.code == 2
    assert "none.yaml" in missing.err
    same = pieper_command("workspace", "ur5e", *options, "--world", world, "--export", world)
    assert same.code == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--voxel", 0], "voxel must be a positive length [m], got 0.0"),
        (["--orientations", 0], "orientations must be a whole number of at least 1, got 0"),
        (["--box", 5, 6, 5, 6, 5, 6], "the box is outside the reach of 'ur5e'"),
        (["--slice", "y"], "--slice takes an axis and a coordinate, as in y=0"),
        (["--slice", "w=1"], "--slice takes an axis and a coordinate, as in y=0"),
        (["--resume"], "--resume goes on with a map that is kept: name it with --out"),
        (["--workers", 0], "workers must be a whole number of at least 1, got 0"),
        (["--workers", 2, "--dask", "tcp://127.0.0.1:1"], "either --workers, on this machine, or --dask"),
        (["--show", "beauty"], "no quantity 'beauty'"),
        (["--export", "map.doc"], "ends in .csv, .h5, .vtk, .ply, got 'map.doc'"),
        (["--figure", "map.doc"], ".png"),
        (["--out", "/proc/map.zarr"], "/proc/map.zarr: No such file or directory"),
        (["--out", "/nowhere/at/all.zarr"], "no such folder: /nowhere/at"),
        (["--voxel", 0.002], "voxels are too many for memory"),
    ],
)
def test_bad_input_has_its_message(pieper_command, options, said):
    result = pieper_command("workspace", "ur5e", *options)
    assert result.code == 2
    assert said in result.err


@pytest.mark.parametrize(
    ("package", "options", "extra"),
    [
        ("zarr", ["--out", "map.zarr"], "maps"),
        ("skimage.measure", ["--export", "map.ply"], "maps"),
        ("h5py", ["--export", "map.h5"], "maps"),
        ("distributed", ["--dask", "tcp://127.0.0.1:1"], "cluster"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(pieper_command, tmp_path, monkeypatch, package, options, extra):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)
    result = pieper_command("workspace", "ur5e", *SMALL, *options)
    assert result.code == 3
    assert f"pip install 'pieper[{extra}]'" in result.err
    assert not list(tmp_path.iterdir())


def test_a_base_is_found_for_a_task(pieper_command, tmp_path):
    task, scores, figure = tmp_path / "task.csv", tmp_path / "scores.csv", tmp_path / "place.png"
    task.write_text("x,y,z,roll,pitch,yaw\n0.5,0.3,0.2,3.14159,0,0\n0.9,0.0,0.4,3.14159,0,1.57\n")
    options = ("--step", 0.3, "--yaws", 2)
    result = pieper_command("place", "ur3e", "ur5e", task, *options, "--out", scores, "--figure", figure)
    assert result.code == 0, result.err
    assert "reaches all 2 poses" in result.out
    assert "ur3e" in scores.read_text()
    assert matplotlib.image.imread(figure)[..., :3].std() > 0.1
    record = pieper_command("place", "ur3e", "ur5e", task, *options, "--json").json
    scored = [(each["reached"], each["margin"]) for each in record["arms"]]
    assert record["best"] == scored.index(max(scored))
    far = pieper_command("place", "ur3e", task, "--x", 5, 5, "--y", 5, 5)
    assert far.code == 1
    assert "reaches 0 of 2 poses: none tried reaches all" in far.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["ur5e"], "name one arm or several, and then a file of poses"),
        (["ur5e", "mh12"], "the last word is the file of poses and ends in .csv, got 'mh12'"),
        (["ur5e", "nothing.csv"], "nothing.csv: No such file or directory"),
    ],
)
def test_bad_words_of_place(pieper_command, words, said):
    result = pieper_command("place", *words)
    assert result.code == 2
    assert said in result.err
