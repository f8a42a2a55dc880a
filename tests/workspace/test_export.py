"""What is exported is what other programs read; surfaces enclose what the map says."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from pieper.errors import ArrayError, MapError, UnknownNameError
from pieper.workspace.boundary import boundary
from pieper.workspace.export import export
from pieper.workspace.grid import Grid
from pieper.workspace.map import WorkspaceMap
from pieper.workspace.measure import QUANTITIES
from pieper.workspace.run import run
from pieper.workspace.survey import survey
from tests.robots import chain
from tests.workspace.arms import elbow_arm, planar

h5py = pytest.importorskip("h5py", reason="h5py is not installed: the extra 'maps'")
pytest.importorskip("skimage", reason="scikit-image is not installed: the extra 'maps'")
meshio = pytest.importorskip("meshio", reason="meshio, which reads VTK files, is not installed")
trimesh = pytest.importorskip("trimesh", reason="the viewer's extra is not installed")

FLOAT32 = 1e-6
VOXELS = 0.05  # by how much a volume of a ball of 12 voxels' radius may differ from that in voxels, relative


@pytest.fixture(scope="module")
def found() -> WorkspaceMap:
    return run(survey(chain("ur5e"), voxel=0.2, orientations=30, chunk=4))


def test_csv_has_a_row_for_each_reachable_voxel(found: WorkspaceMap, tmp_path: Path) -> None:
    with export(found, tmp_path / "map.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == int((found.array("reached") > 0).sum())
    axes = [found.grid.axis(name) for name in "xyz"]
    for row in rows:
        where = tuple(int(np.argmin(np.abs(axis - float(row[name])))) for axis, name in zip(axes, "xyz", strict=True))
        for name in ("dexterity", *QUANTITIES):
            assert float(row[name]) == float(found.array(name)[where])


def test_hdf5_has_every_quantity_and_the_question(found: WorkspaceMap, tmp_path: Path) -> None:
    with h5py.File(export(found, tmp_path / "map.h5")) as file:
        for name in QUANTITIES:
            assert file[name][:].tobytes() == found.array(name).tobytes()
        assert json.loads(file.attrs["record"]) == json.loads(json.dumps(dict(found.record)))


def test_vtk_is_read_by_another_program(found: WorkspaceMap, tmp_path: Path) -> None:
    read = meshio.read(export(found, tmp_path / "map.vtk"))
    corners = read.points[read.cells[0].data]
    middle = corners.mean(axis=1)
    for name in ("dexterity", "manipulability"):
        values = read.cell_data[name][0].ravel()
        where = tuple(np.rint((middle - np.array(found.grid.origin)) / found.grid.voxel).astype(int).T)
        assert np.allclose(values, found.array(name)[where], rtol=FLOAT32, atol=FLOAT32, equal_nan=True)


def test_ply_is_a_closed_surface_about_a_ball() -> None:
    """An elbow arm with links alike reaches a ball, of which the wrist leaves a ball that is dexterous."""
    found = run(survey(elbow_arm(0.5, 0.5, 0.2), voxel=0.12, orientations=30))
    reach, free = boundary(found), boundary(found, level=0.98)
    for made, radius in ((reach, 1.2), (free, 0.8)):
        ball = 4.0 / 3.0 * np.pi * radius**3
        assert abs(made.volume / ball - 1.0) < 3.0 * VOXELS
        assert made.area > 0.0
    assert abs(reach.volume / found.summary().reachable - 1.0) < 3.0 * VOXELS
    assert free.volume < reach.volume


def test_ply_is_read_by_another_program(found: WorkspaceMap, tmp_path: Path) -> None:
    mesh = trimesh.load(export(found, tmp_path / "surface.ply"))
    made = boundary(found)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(made.volume, rel=FLOAT32)
    assert mesh.area == pytest.approx(made.area, rel=FLOAT32)
    assert mesh.volume > 0.0  # normals outwards


def test_a_map_is_read_in_pieces_that_cover_it_once() -> None:
    grid = Grid((0.0, 0.0, 0.0), 0.1, (13, 7, 11), chunk=3)
    for most in (1, 30, 100, 400, 10_000):
        seen = np.zeros(grid.shape, dtype=int)
        for region in grid.pieces(most=most):
            seen[region] += 1
            assert seen[region].size <= max(most, 27)
        assert (seen == 1).all()


def test_points_can_be_thinned(found: WorkspaceMap) -> None:
    every, _ = found.points("dexterity")
    some, values = found.points("dexterity", most=found.grid.voxels // 8 + 1)
    assert 0 < len(some) < len(every) / 4
    assert len(values) == len(some)


def test_what_cannot_be_exported_is_told(found: WorkspaceMap, tmp_path: Path) -> None:
    with pytest.raises(ArrayError, match=r"ends in \.csv, \.h5, \.vtk, \.ply, got 'map\.xyz'"):
        export(found, "map.xyz")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        export(found, tmp_path / "nowhere" / "map.csv")
    with pytest.raises(ArrayError, match=r"level must be a share between 0 and 1, got 1\.5"):
        boundary(found, level=1.5)
    with pytest.raises(MapError, match=r"no voxel reaches a share of 0\.999"):
        boundary(
            run(survey(chain("ur5e"), voxel=0.1, orientations=30, box=[[0.9, 0.0, 0.0], [1.0, 0.1, 0.1]])), level=0.999
        )
    with pytest.raises(ArrayError, match="a surface needs a map of more than one layer"):
        boundary(run(survey(planar(1.0, 0.6), voxel=0.2)))
    with pytest.raises(UnknownNameError, match=r"no quantity 'dexterty'.*did you mean 'dexterity'"):
        found.array("dexterty")
    half = run(survey(chain("ur5e"), voxel=0.2, orientations=5, chunk=4), stop=lambda: True)
    with pytest.raises(ArrayError, match="an export needs the whole map, and 27 of 27 chunks are not computed yet"):
        export(half, tmp_path / "half.csv")
    assert not list(tmp_path.iterdir())


def test_a_map_reads_layers_points_and_a_summary(found: WorkspaceMap) -> None:
    share = found.array("dexterity")
    middle = found.grid.layer("y", 0.0)
    assert np.array_equal(found.layer("dexterity", "y", 0.0), share[:, middle, :])
    centres, values = found.points("dexterity", at_least=0.5)
    assert len(centres) == int((share >= 0.5).sum())
    assert values.min() >= 0.5
    told = found.summary()
    assert told.reachable == pytest.approx((share > 0).sum() * 0.2**3)
    assert told.dexterous == pytest.approx((share == 1.0).sum() * 0.2**3)
    assert told.mean_dexterity == pytest.approx(share[share > 0].mean())
    assert told.most_solutions == 8
    with pytest.raises(ArrayError, match="no layer at y = 5 m: the map goes from y = "):
        found.layer("dexterity", "y", 5.0)
