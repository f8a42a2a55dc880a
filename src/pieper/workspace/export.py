"""Maps for other programs: CSV and HDF5 with every quantity, VTK for ParaView, PLY for the surface.

Written piece by piece, so that the memory does not grow with the map; a file is there whole, or not at all.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import replacing
from pieper.errors import ArrayError, MissingExtraError
from pieper.workspace.boundary import boundary
from pieper.workspace.measure import QUANTITIES

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from pieper.workspace.map import WorkspaceMap

FORMATS = (".csv", ".h5", ".vtk", ".ply")
"""What `export` writes, by the suffix."""

_AT_ONCE = 4_000_000
"""Voxels that are written together."""

_COLUMNS = ("reached", "dexterity", "solutions", "most_solutions", "manipulability", "singularity", "limit_margin")


def checked_file(file: str | os.PathLike[str]) -> Path:
    """The path, if its suffix is one of `FORMATS`; raises ArrayError else."""
    path = Path(file)
    if path.suffix.lower() not in FORMATS:
        raise ArrayError(f"a map is exported to a file that ends in {', '.join(FORMATS)}, got {str(file)!r}")
    return path


def export(found: WorkspaceMap, file: str | os.PathLike[str], *, level: float | None = None) -> Path:
    """Write a map in the format that the suffix names.

    ====== =======================================================================================================
    .csv   a row for each reachable voxel: its centre [m] and every quantity
    .h5    a dataset for each quantity over all voxels, and the question as attributes
    .vtk   a regular grid with every quantity in its cells (legacy format, binary), as ParaView reads it
    .ply   the surface on which the dexterity passes `level`, see `pieper.workspace.boundary`
    ====== =======================================================================================================

    Parameters
    ----------
    found : WorkspaceMap
        Whole.
    file : path
        A file of that name is replaced.
    level : float, optional
        Of the surface.

    Returns
    -------
    Path

    Raises
    ------
    ArrayError
        Another suffix, or a map that is not finished.
    MissingExtraError
        h5py, or scikit-image for a surface, is not installed.
    OSError
        The file cannot be written; what was there before is still there.
    """
    path = checked_file(file)
    found.require_complete("an export")
    write: dict[str, Callable[[Path], None]] = {
        ".csv": lambda to: _write_csv(found, to),
        ".h5": lambda to: _write_hdf5(found, to),
        ".vtk": lambda to: _write_vtk(found, to),
        ".ply": lambda to: _write_ply(found, to, level),
    }
    with replacing(path) as unfinished:
        write[path.suffix.lower()](unfinished)
    return path


def _write_csv(found: WorkspaceMap, file: Path) -> None:
    with file.open("w", encoding="utf-8", newline="") as out:
        out.write("x,y,z," + ",".join(_COLUMNS) + "\n")
        for _, centres, columns in found.pieces(*_COLUMNS):
            here = columns[0] > 0
            rows = zip(centres[here].round(9).tolist(), *(column[here].tolist() for column in columns), strict=True)
            out.writelines(",".join(repr(value) for value in (*centre, *values)) + "\n" for centre, *values in rows)


def _write_hdf5(found: WorkspaceMap, file: Path) -> None:
    try:
        import h5py
    except ImportError as cause:
        raise MissingExtraError("h5py", "maps", "an HDF5 file") from cause
    grid = found.grid
    with h5py.File(file, "w") as out:
        out.attrs["format"] = "pieper workspace map"
        out.attrs["record"] = json.dumps(dict(found.record))
        out.attrs["origin"], out.attrs["voxel"], out.attrs["samples"] = grid.origin, grid.voxel, found.samples
        chunks = tuple(min(grid.chunk, n) for n in grid.shape)
        made = {
            name: out.create_dataset(name, grid.shape, dtype=kind, chunks=chunks, compression="gzip", fletcher32=True)
            for name, (kind, _) in QUANTITIES.items()
        }
        for region in grid.pieces():
            for name, data in made.items():
                data[region] = found.array(name, region)


def _write_vtk(found: WorkspaceMap, file: Path) -> None:
    """Legacy format 3.0: cells of a rectilinear grid with even steps, big-endian, x running fastest."""
    grid = found.grid
    corner = grid.lower.round(9)
    with file.open("wb") as out:
        heading = f"# vtk DataFile Version 3.0\nworkspace of {found.record['arm']}\nBINARY\nDATASET STRUCTURED_POINTS\n"
        points = " ".join(str(n + 1) for n in grid.shape)
        place = " ".join(repr(float(x)) for x in corner)
        size = f"{grid.voxel!r} {grid.voxel!r} {grid.voxel!r}"
        words = f"{heading}DIMENSIONS {points}\nORIGIN {place}\nSPACING {size}\nCELL_DATA {grid.voxels}\n"
        out.write(words.encode("ascii", "replace"))
        for name in _COLUMNS:
            out.write(f"SCALARS {name} float 1\nLOOKUP_TABLE default\n".encode())
            nx, ny, nz = grid.shape
            thick = max(1, min(grid.chunk, _AT_ONCE // (nx * ny)))
            for start in range(0, nz, thick):
                slab = (slice(0, nx), slice(0, ny), slice(start, min(start + thick, nz)))
                out.write(found.array(name, slab).astype(">f4").tobytes(order="F"))
            out.write(b"\n")


def _write_ply(found: WorkspaceMap, file: Path, level: float | None) -> None:
    made = boundary(found, level=level)
    corners = np.zeros(len(made.vertices), dtype=[("p", "<f4", 3), ("dexterity", "<f4")])
    corners["p"], corners["dexterity"] = made.vertices, made.value
    faces = np.zeros(len(made.faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, made.faces
    heading: list[Any] = [
        "ply", "format binary_little_endian 1.0", f"comment workspace of {found.record['arm']} [m]",
        f"element vertex {len(corners)}", *(f"property float {name}" for name in ("x", "y", "z", "dexterity")),
        f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    with file.open("wb") as out:
        out.write(("\n".join(heading) + "\n").encode("ascii", "replace"))
        out.write(corners.tobytes())
        out.write(faces.tobytes())
