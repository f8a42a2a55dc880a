"""Surfaces of the links of an arm: the boxes, cylinders, capsules and spheres of its description and its mesh files as MuJoCo reads them,
or a shape made from its chain.
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import PieperWarning
from pieper.model import shape
from pieper.model.description import Mesh
from pieper.model.shape import Triangles
from pieper.sim.offscreen import import_mujoco
from pieper.sim.stage import AXIS_COLORS, Body, Theme, mixed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.model.chain import Chain
    from pieper.model.description import Description, Visual

FORMATS = (".stl", ".obj")
LARGEST_MESH = 100_000_000  # bytes of a file

_SMOOTH = 40  # corners of a circle
_TOO_LARGE = 30.0  # a link this many times as long as its arm is in millimetres


def bodies_of_description(description: Description, chain: Chain, color: str) -> tuple[Body, ...] | None:
    """The surfaces that a description gives the links of a chain; None when it gives none, or when one cannot be read.

    A file that is missing, broken or in another format is named in a warning. Meshes that are a thousand times too large are taken to be
    in millimetres, which a warning says too.

    Parameters
    ----------
    description : Description
    chain : Chain
        Cut from the description; frames that are not links of it, such as a tool, have no surfaces.
    color : str
        For links whose material has no colour.
    """
    known = {link.name for link in description.links}
    length = shape.from_chain(chain).length
    bodies = []
    for frame in chain.frames:
        if frame.name not in known:
            continue
        first = chain.frame(frame.after).home
        T_first_link = np.linalg.inv(first) @ frame.home
        for visual in description.link(frame.name).visuals:
            surface = _surface(visual, frame.name, length)
            if surface is None:
                return None
            T = T_first_link @ visual.T_link_shape
            placed = Triangles(surface.vertices @ T[:3, :3].T + T[:3, 3], surface.faces)
            bodies.append(Body(frame.after, _color(visual) or color, placed))
    return tuple(bodies) or None


def bodies_of_shape(chain: Chain, color: str, theme: Theme) -> tuple[Body, ...]:
    """The shape made from the chain, one surface for each link and colour."""
    paint = {
        "base": theme.metal,
        "link": color,
        "housing": mixed(theme.metal, color, 0.12),
        "flange": "#c3c8ce",
        "mark": AXIS_COLORS[0],
        "tool": "#98a1ab",
    }
    pieces: dict[tuple[int, str], list[Triangles]] = {}
    for part in shape.from_chain(chain).parts:
        pieces.setdefault((part.link, paint[part.role]), []).append(shape.as_mesh(part, sections=_SMOOTH))
    return tuple(Body(link, paint, shape.merge(meshes)) for (link, paint), meshes in pieces.items())


def _color(visual: Visual) -> str | None:
    if visual.material is None or visual.material.rgba is None:
        return None
    return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02x}" for part in visual.material.rgba[:3])


def _surface(visual: Visual, link: str, length: float) -> Triangles | None:
    if not isinstance(visual.geometry, Mesh):
        return shape.as_mesh(visual.geometry, sections=_SMOOTH)
    mesh = visual.geometry
    if mesh.path is None:
        _warn(f"mesh {mesh.filename!r} of link {link!r} was not found")
        return None
    try:
        surface = read_mesh(mesh.path)
    except (OSError, ValueError) as cause:
        _warn(f"mesh {mesh.path} of link {link!r} cannot be read: {' '.join(str(cause).split())}")
        return None
    vertices = surface.vertices * mesh.scale
    size = float(np.ptp(vertices, axis=0).max())
    if size > _TOO_LARGE * length:
        warnings.warn(
            f"mesh {mesh.path} of link {link!r} is {size:.4g} m large on an arm of {length:.3g} m; taken to be in millimetres",
            PieperWarning,
            stacklevel=2,
        )
        vertices = 1e-3 * vertices
    faces = surface.faces if np.prod(mesh.scale) > 0.0 else surface.faces[:, ::-1]
    return Triangles(vertices, faces)


def _warn(reason: str) -> None:
    warnings.warn(f"{reason}; a shape made from the chain is drawn instead", PieperWarning, stacklevel=3)


@lru_cache(maxsize=64)
def read_mesh(path: str) -> Triangles:
    """The triangles of an STL or OBJ file, in its own units.

    Raises
    ------
    ValueError
        Another format, too large, or broken.
    OSError
        The file cannot be read.
    """
    file = Path(path)
    if file.suffix.lower() not in FORMATS:
        raise ValueError(f"{file.suffix or 'a file without suffix'} is not drawn here, only {', '.join(FORMATS)}")
    size = file.stat().st_size
    if size > LARGEST_MESH:
        raise ValueError(f"it has {size // 10**6} MB, more than {LARGEST_MESH // 10**6} MB")
    mujoco = import_mujoco()
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=f"mesh{file.suffix.lower()}", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh", contype=0, conaffinity=0)
    spec.assets = {f"mesh{file.suffix.lower()}": file.read_bytes()}
    model = spec.compile()
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.mesh_quat[0])  # the vertices are kept about the centre of mass, along the main axes
    vertices = model.mesh_vert.astype(np.float64) @ R.reshape(3, 3).T + model.mesh_pos[0]
    faces: NDArray[np.int64] = model.mesh_face.astype(np.int64)
    return Triangles(vertices, faces)
