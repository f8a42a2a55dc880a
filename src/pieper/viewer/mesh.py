"""What an arm looks like: the meshes and simple shapes of its description, or a shape made from its joints.

The surfaces of each moving body are merged by colour and placed in one frame of that body, so that one pose moves them all.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import MissingExtraError, PieperError, PieperWarning
from pieper.model import description as model
from pieper.model import shape
from pieper.spatial import rotation
from pieper.viewer.surface import Color, Surface, creased, merged, thinned, welded

if TYPE_CHECKING:
    from collections.abc import Iterator

    import trimesh

    from pieper.arm import Arm
    from pieper.model.chain import Chain, FloatArray
    from pieper.model.description import Description, Geometry, Visual

LARGEST_FILE = 200e6
"""Mesh files above this are refused [bytes]."""

MOST_TRIANGLES = 40_000
"""Meshes with more triangles are thinned out to this many; a browser draws a whole arm of them."""

MOST_TRIANGLES_READ = 5_000_000
"""Meshes with more triangles are refused: thinning them out would take minutes."""

ROLE_COLORS: dict[str, Color] = {
    "base": (74, 80, 90),
    "link": (233, 128, 44),
    "housing": (74, 80, 90),
    "flange": (150, 156, 166),
    "mark": (200, 60, 50),
    "tool": (150, 156, 166),
}
"""Colours of the shape that is made from the joints."""

_SECTIONS = 32  # corners of a circle
_MILLIMETRE = 1e-3
_TOO_LARGE = 5.0  # times the way along the joints: nothing of an arm is


class MeshError(PieperError):
    """A mesh file that cannot be drawn; the message names it."""


@dataclass(frozen=True, eq=False)
class Body:
    """What moves as one.

    Attributes
    ----------
    after : int
        Number of axes that move it.
    frame : str
        The frame of the chain that the surfaces are given in.
    surfaces : tuple of Surface
        One per colour.
    """

    after: int
    frame: str
    surfaces: tuple[Surface, ...]


def bodies(arm: Arm, *, meshes: bool | None = None) -> tuple[Body, ...]:
    """What to draw for each moving body of an arm, from its base to its tip.

    Parameters
    ----------
    arm : Arm
    meshes : bool, optional
        False: the shape made from the joints, even if the description has something to draw. By itself what the description
        draws is taken, and the shape instead of whatever cannot be read, with a warning that names the file.

    Returns
    -------
    tuple of Body
        One for each number of axes, those without anything to draw left out.
    """
    frames = _frames(arm.chain)
    drawn: dict[int, list[Surface]] = {}
    failed: set[int] = set()
    if meshes is not False and arm.description is not None:
        drawn, failed = _described(arm, frames)
    if not drawn or failed:
        shaped = _shaped(arm.chain)
        drawn |= {after: shaped.get(after, []) for after in (failed if drawn else shaped)}
    return tuple(Body(after, frames[after][0], _by_color(drawn[after])) for after in sorted(drawn) if drawn[after])


def _frames(chain: Chain) -> dict[int, tuple[str, FloatArray]]:
    """For each number of axes the first frame that so many move: its name and home pose."""
    found: dict[int, tuple[str, FloatArray]] = {}
    for frame in chain.frames:
        found.setdefault(frame.after, (frame.name, frame.home))
    return found


def _by_color(surfaces: list[Surface]) -> tuple[Surface, ...]:
    colors = dict.fromkeys(surface.color for surface in surfaces)
    return tuple(merged(s for s in surfaces if s.color == color) for color in colors)


# --------------------------------------------------------------------------------------------------------------------
# what the description draws


def _described(arm: Arm, frames: dict[int, tuple[str, FloatArray]]) -> tuple[dict[int, list[Surface]], set[int]]:
    """Surfaces by number of axes, and the bodies of which a mesh could not be had."""
    assert arm.description is not None
    reach = _size(arm.chain)
    drawn: dict[int, list[Surface]] = {}
    failed: dict[int, list[str]] = {}
    for after, T_base_link, visual in _visuals(arm.description, arm.chain):
        T_frame_shape = np.linalg.inv(frames[after][1]) @ T_base_link @ visual.T_link_shape
        try:
            surfaces = _surfaces(visual.geometry, _color(visual), reach)
        except MeshError as error:
            failed.setdefault(after, []).append(str(error))
            continue
        drawn.setdefault(after, []).extend(surface.moved(T_frame_shape) for surface in surfaces)
    if failed:
        faults = [fault for faults in failed.values() for fault in faults]
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        warnings.warn(f"{faults[0]}{more}; a shape made from the joints is drawn instead", PieperWarning, stacklevel=3)
    return {after: surfaces for after, surfaces in drawn.items() if after not in failed}, set(failed)


def _visuals(description: Description, chain: Chain) -> Iterator[tuple[int, FloatArray, Visual]]:
    """Everything that is drawn, with the number of axes that move it and the pose of its link at home.

    Links beside the chain, such as fingers, stand where their joints at 0, or nearest to it, put them.
    """
    at: dict[str, tuple[int, FloatArray]] = {}
    known = {link.name for link in description.links}
    for frame in chain.frames:
        if frame.name in known:
            at.setdefault(frame.name, (frame.after, frame.home))
    waiting = list(at)
    while waiting:
        name = waiting.pop()
        after, T = at[name]
        for joint in description.joints_below(name):
            if joint.child not in at:
                at[joint.child] = (after, T @ _rest(joint))
                waiting.append(joint.child)
        above = description.joint_above(name)
        if above is not None and above.parent not in at:
            at[above.parent] = (after, T @ np.linalg.inv(_rest(above)))
            waiting.append(above.parent)
    for link in description.links:
        if link.name in at:
            after, T = at[link.name]
            for visual in link.visuals:
                yield after, T, visual


def _rest(joint: model.Joint) -> FloatArray:
    """Pose of the child of a joint in its parent, at the value nearest 0."""
    value = float(np.clip(0.0, joint.lower, joint.upper)) if joint.type in ("revolute", "prismatic") else 0.0
    T = np.array(joint.T_parent_joint)
    if joint.type == "prismatic":
        T[:3, 3] += T[:3, :3] @ joint.axis * value
    elif value:
        T[:3, :3] = T[:3, :3] @ rotation.from_axis_angle(joint.axis, value)
    return T


def _color(visual: Visual) -> Color | None:
    if visual.material is None or visual.material.rgba is None:
        return None
    red, green, blue = (round(255.0 * min(max(part, 0.0), 1.0)) for part in visual.material.rgba[:3])
    return red, green, blue


def _surfaces(geometry: Geometry, color: Color | None, reach: float) -> tuple[Surface, ...]:
    if isinstance(geometry, model.Mesh):
        return _from_file(geometry, color, reach)
    return (_of_solid(geometry, color),)


def _of_solid(solid: shape.Solid | shape.Part, color: Color | None) -> Surface:
    triangles = shape.as_mesh(solid, sections=_SECTIONS)
    return creased(Surface(triangles.vertices.astype(np.float32), triangles.faces.astype(np.uint32), color))


# --------------------------------------------------------------------------------------------------------------------
# mesh files


def _from_file(mesh: model.Mesh, color: Color | None, reach: float) -> tuple[Surface, ...]:
    if mesh.path is None:
        raise MeshError(f"mesh {mesh.filename}: there is no such file")
    try:
        stamp = Path(mesh.path).stat()
    except OSError as error:
        raise MeshError(f"mesh {mesh.path}: {error.strerror}") from error
    if stamp.st_size > LARGEST_FILE:
        raise MeshError(
            f"mesh {mesh.path}: {stamp.st_size / 1e6:.0f} MB are more than the {LARGEST_FILE / 1e6:.0f} MB that are read"
        )
    surfaces = _read(mesh.path, stamp.st_mtime_ns, stamp.st_size)
    scale = mesh.scale.astype(np.float64)
    extent = max(float(np.abs(surface.vertices * scale).max(initial=0.0)) for surface in surfaces)
    factor = 1.0
    if extent > _TOO_LARGE * reach:
        factor = _MILLIMETRE
        size = f"mesh {mesh.path}: {extent:.4g} m is too large for an arm of {reach:.3g} m"
        if extent * factor > _TOO_LARGE * reach:
            raise MeshError(f"{size}, even in millimetres")
        warnings.warn(f"{size}; taken to be in millimetres", PieperWarning, stacklevel=4)
    flip = float(np.prod(scale)) < 0.0  # a mirrored surface would be seen from inside
    return tuple(
        Surface(
            (surface.vertices * (scale * factor)).astype(np.float32),
            surface.faces[:, ::-1] if flip else surface.faces,
            color or surface.color,
        )
        for surface in surfaces
    )


def _size(chain: Chain) -> float:
    """About how long the arm is [m]: the way along its joints."""
    origins = np.array([frame.home[:3, 3] for frame in chain.frames])
    return max(float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum()), 1e-3)


@lru_cache(maxsize=256)
def _read(path: str, changed: int, size: int) -> tuple[Surface, ...]:
    """The surfaces of a mesh file, one per colour; `changed` and `size` tell its versions apart."""
    try:
        import trimesh
    except ModuleNotFoundError:
        raise MissingExtraError("trimesh", "viewer", f"reading the mesh {path}") from None
    try:
        scene = trimesh.load_scene(path)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:
        raise MeshError(f"mesh {path}: cannot be read ({type(error).__name__}: {error})") from error
    count = sum(len(part.faces) for part in parts)
    if count > MOST_TRIANGLES_READ:
        raise MeshError(f"mesh {path}: {count} triangles are more than the {MOST_TRIANGLES_READ} that are drawn from")
    surfaces = tuple(_as_surface(part) for part in parts if len(part.faces))
    if not surfaces:
        raise MeshError(f"mesh {path}: has no triangles")
    if not all(np.isfinite(surface.vertices).all() for surface in surfaces):
        raise MeshError(f"mesh {path}: has vertices that are not finite")
    if count > MOST_TRIANGLES:
        warnings.warn(
            f"mesh {path}: {count} triangles are thinned out to {MOST_TRIANGLES}", PieperWarning, stacklevel=5
        )
    return tuple(
        creased(
            thinned(welded(surface), MOST_TRIANGLES * len(surface.faces) // count if count > MOST_TRIANGLES else count)
        )
        for surface in _by_color(list(surfaces))
    )


def _as_surface(part: trimesh.Trimesh) -> Surface:
    import trimesh

    color: Color | None = None
    visual = part.visual
    if visual is not None and visual.defined:
        if isinstance(visual, trimesh.visual.TextureVisuals):  # a texture is drawn in its mean colour
            shade = getattr(visual.material, "main_color", (200, 205, 212))
        else:
            shade = visual.main_color
        red, green, blue = (int(value) for value in np.asarray(shade)[:3])
        color = red, green, blue
    return Surface(part.vertices.astype(np.float32), part.faces.astype(np.uint32), color)


# --------------------------------------------------------------------------------------------------------------------
# a shape made from the joints


def _shaped(chain: Chain) -> dict[int, list[Surface]]:
    """Parts that the chain itself is drawn with, by number of axes."""
    shaped: dict[int, list[Surface]] = {}
    for part in shape.from_chain(chain).parts:
        shaped.setdefault(part.link, []).append(_of_solid(part, ROLE_COLORS[part.role]))
    return shaped
