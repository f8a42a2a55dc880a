"""Arms in a viser scene: one that is drawn solid with its frames and axes, and many translucent ghosts of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import as_joints
from pieper.spatial import rotation
from pieper.viewer.mesh import bodies
from pieper.viewer.surface import shrunk

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray
    from viser import ViserServer

    from pieper.arm import Arm
    from pieper.model.chain import FloatArray
    from pieper.viewer.surface import Color

OWN_COLOR: Color = (200, 205, 212)
"""Of surfaces for which the description names no colour."""

AXIS_COLOR: Color = (0, 150, 190)


_NO_LENGTH = 1e-4  # [m]
_THINNER = 0.02
"""Ghosts are thinner by this part of the size of a frame, so that what a ghost shares with the arm is inside it."""


class ArmView:
    """One arm in a scene. Bodies move by one pose each; frames and axes hang on them and cost nothing.

    Parameters
    ----------
    server : ViserServer
        Or anything with a ``scene`` and ``atomic()``.
    name : str
        Of the node in the scene, for example ``"arm"``.
    arm : Arm
    color : tuple of 3 int, optional
        0..255, of the whole arm; by itself the colours of the description.
    opacity : float
        From 0 to 1.
    meshes : bool, optional
        See `pieper.viewer.mesh.bodies`.
    T_world_base : (4, 4) array, optional
        Where the arm stands.

    Attributes
    ----------
    arm : Arm
    q : (n,) array
        Joint values that are shown [rad or m], at first those nearest 0 within the limits.

    Examples
    --------
    >>> import pieper
    >>> from pieper.viewer.server import Server
    >>> server = Server(port=0)
    >>> view = ArmView(server, "arm", pieper.load("mh12"))
    >>> view.update([0.1, 0.2, 0.0, 0.0, 0.0, 0.0])
    >>> view.show_frames(True)
    >>> server.stop()
    """

    def __init__(
        self,
        server: ViserServer,
        name: str,
        arm: Arm,
        *,
        color: Color | None = None,
        opacity: float = 1.0,
        meshes: bool | None = None,
        T_world_base: ArrayLike | None = None,
    ) -> None:
        self.arm = arm
        self._server = server
        self._own_color = color
        self._opacity = opacity
        scene = server.scene
        self._root = scene.add_frame(f"/{name.strip('/')}", show_axes=False)
        drawn = bodies(arm, meshes=meshes)
        counts = sorted({frame.after for frame in arm.chain.frames})
        first = {after: next(f for f in arm.chain.frames if f.after == after) for after in counts}
        self._moving = _Poses(arm, [first[after].name for after in counts])
        self._bodies = [scene.add_frame(f"{self._root.name}/{after}", show_axes=False) for after in counts]
        self._home = {after: np.linalg.inv(first[after].home) for after in counts}
        self._meshes: list[tuple[Any, Color]] = []
        for body in drawn:
            for number, surface in enumerate(body.surfaces):
                own = surface.color or OWN_COLOR
                handle = scene.add_mesh_simple(
                    f"{self._root.name}/{body.after}/{number}",
                    surface.vertices,
                    surface.faces,
                    color=color or own,
                    opacity=_shown_opacity(opacity),
                    flat_shading=False,
                    side="double",
                )
                self._meshes.append((handle, own))
        self._frames: list[Any] = []
        self._axes: list[Any] = []
        self.q = np.clip(np.zeros(arm.dof), *arm.limits.T)
        if T_world_base is not None:
            self.place(T_world_base)
        self.update(self.q)

    # --- where it is

    def update(self, q: ArrayLike) -> None:
        """Show the arm at joint values `q` (n,) [rad or m].

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite; what is shown stays as it was.
        """
        values = as_joints(self.arm.chain, q)
        if values.ndim != 1:
            raise ArrayError(f"q must have shape ({self.arm.dof},), got {values.shape}")
        position, wxyz = self._moving.at(values)
        with self._server.atomic():
            for node, p, r in zip(self._bodies, position, wxyz, strict=True):
                node.position = p
                node.wxyz = r
        self.q = np.array(values)
        self.q.setflags(write=False)

    def place(self, T_world_base: ArrayLike) -> None:
        """Put the arm at the pose `T_world_base`, (4, 4)."""
        position, wxyz = _split(np.asarray(T_world_base, dtype=np.float64))
        with self._server.atomic():
            self._root.position, self._root.wxyz = position, wxyz

    # --- what it looks like

    @property
    def visible(self) -> bool:
        """Whether the arm is drawn."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, value: bool) -> None:
        self._root.visible = value

    @property
    def color(self) -> Color | None:
        """0..255, of the whole arm; None for the colours of the description."""
        return self._own_color

    @color.setter
    def color(self, value: Color | None) -> None:
        self._own_color = value
        with self._server.atomic():
            for mesh, own in self._meshes:
                mesh.color = value or own

    @property
    def opacity(self) -> float:
        """From 0 to 1."""
        return self._opacity

    @opacity.setter
    def opacity(self, value: float) -> None:
        self._opacity = value
        with self._server.atomic():
            for mesh, _ in self._meshes:
                mesh.opacity = _shown_opacity(value)

    def show_frames(self, shown: bool, *, names: bool = True) -> None:
        """Draw the frames of the chain, x red, y green, z blue, with their names."""
        if shown and not self._frames:
            size = frame_size(self.arm)
            for number, frame in enumerate(self.arm.chain.frames):
                position, wxyz = _split(self._home[frame.after] @ frame.home)
                node = self._server.scene.add_frame(
                    f"{self._root.name}/{frame.after}/frame_{number}",
                    axes_length=size,
                    axes_radius=0.04 * size,
                    origin_radius=0.08 * size,
                    position=position,
                    wxyz=wxyz,
                )
                label = self._server.scene.add_label(f"{node.name}/name", frame.name, font_screen_scale=0.8)
                self._frames += [node, label]
        with self._server.atomic():
            for node in self._frames[::2]:
                node.visible = shown
            for label in self._frames[1::2]:
                label.visible = shown and names

    def show_axes(self, shown: bool) -> None:
        """Draw the screws of the joints, each an arrow along its axis with the name of its joint."""
        if shown and not self._axes:
            self._axes = [node for axis in range(len(self.arm.chain.screws)) for node in self._add_axis(axis)]
        with self._server.atomic():
            for node in self._axes:
                node.visible = shown

    def _add_axis(self, axis: int) -> list[Any]:
        """The arrow of one axis, on the body that carries it."""
        chain = self.arm.chain
        v, w = chain.screws[axis, :3], chain.screws[axis, 3:]
        moved = next((frame for frame in chain.frames if frame.after > axis), None)
        near = chain.home[:3, 3] if moved is None else moved.home[:3, 3]
        turns = bool(w.any())
        direction = w if turns else v
        point = np.cross(w, v) + w * float(w @ near) if turns else near
        after = max(count for count in self._home if count <= axis)
        T = self._home[after]
        half = 1.6 * frame_size(self.arm)
        ends = np.stack([point - half * direction, point + half * direction]) @ T[:3, :3].T + T[:3, 3]
        name = f"{self._root.name}/{after}/axis_{axis + 1}"
        joints = np.flatnonzero(chain.coupling[axis])
        text = " + ".join(chain.joint_names[joint] for joint in joints) or "fixed"
        arrow = self._server.scene.add_arrows(
            name,
            ends[None].astype(np.float32),
            AXIS_COLOR,
            shaft_radius=0.03 * half,
            head_radius=0.09 * half,
            head_length=0.2 * half,
        )
        label = self._server.scene.add_label(
            f"{name}/name", f"{axis + 1} {text}{'' if turns else ' (slides)'}", position=ends[1], font_screen_scale=0.8
        )
        return [arrow, label]

    def remove(self) -> None:
        """Take the arm out of the scene."""
        self._root.remove()


class GhostsView:
    """Many translucent copies of one arm, each body of which is one mesh drawn several times.

    Parameters
    ----------
    server, name, arm, meshes
        As for `ArmView`.
    color : tuple of 3 int
        Of the ghosts that have none of their own.
    opacity : float
        From 0 to 1.

    Examples
    --------
    >>> import pieper
    >>> from pieper.viewer.server import Server
    >>> server, arm = Server(port=0), pieper.load("ur5e")
    >>> ghosts = GhostsView(server, "solutions", arm)
    >>> ghosts.update(arm.ik(arm.fk([0.1, -1.2, 1.4, -1.7, -1.5, 0.3])).q)
    >>> ghosts.count
    8
    >>> server.stop()
    """

    def __init__(
        self,
        server: ViserServer,
        name: str,
        arm: Arm,
        *,
        color: Color = (90, 160, 230),
        opacity: float = 0.25,
        meshes: bool | None = None,
        T_world_base: ArrayLike | None = None,
    ) -> None:
        self.arm = arm
        self.count = 0
        self._server = server
        self._color = color
        self._root = server.scene.add_frame(f"/{name.strip('/')}", show_axes=False)
        if T_world_base is not None:
            self._root.position, self._root.wxyz = _split(np.asarray(T_world_base, dtype=np.float64))
        self._parts: list[tuple[int, Any]] = []
        drawn = [body for body in bodies(arm, meshes=meshes) if body.after > 0]  # what stands still needs no ghost
        self._moving = _Poses(arm, [body.frame for body in drawn])
        thinner = _THINNER * frame_size(arm)
        for index, body in enumerate(drawn):
            for number, solid in enumerate(body.surfaces):
                surface = shrunk(solid, thinner)
                handle = server.scene.add_batched_meshes_simple(
                    f"{self._root.name}/{body.after}_{number}",
                    surface.vertices,
                    surface.faces,
                    batched_wxyzs=np.empty((0, 4), np.float32),
                    batched_positions=np.empty((0, 3), np.float32),
                    batched_colors=np.empty((0, 3), np.uint8),
                    opacity=opacity,
                    lod="off",
                    cast_shadow=False,
                    receive_shadow=False,
                )
                self._parts.append((index, handle))

    def update(self, qs: ArrayLike, *, colors: Sequence[Color] | None = None) -> None:
        """Show one ghost for each row of `qs` (k, n) [rad or m]; rows with NaN are left out.

        Parameters
        ----------
        qs : (k, n) array
        colors : k tuples of 3 int, optional
            0..255.
        """
        rows = np.asarray(qs, dtype=np.float64).reshape(-1, self.arm.dof)
        usable = np.isfinite(rows).all(axis=1)
        position, wxyz = self._moving.at(as_joints(self.arm.chain, rows[usable]))
        self.count = int(usable.sum())
        shades: NDArray[np.uint8] = np.empty((self.count, 3), np.uint8)
        shades[:] = self._color if colors is None else np.asarray(colors, np.uint8).reshape(-1, 3)[usable]
        position, wxyz = position.astype(np.float32), wxyz.astype(np.float32)
        with self._server.atomic():
            for index, handle in self._parts:
                handle.batched_positions = position[:, index]
                handle.batched_wxyzs = wxyz[:, index]
                handle.batched_colors = shades

    @property
    def visible(self) -> bool:
        """Whether the ghosts are drawn."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, value: bool) -> None:
        self._root.visible = value

    def remove(self) -> None:
        """Take the ghosts out of the scene."""
        self._root.remove()


def frame_size(arm: Arm) -> float:
    """How long the axes of a frame are drawn [m]: about a tenth of the arm."""
    origins = np.array([frame.home[:3, 3] for frame in arm.chain.frames])
    length = float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
    return 0.08 * length if math.isfinite(length) and length > _NO_LENGTH else 0.1


class _Poses:
    """Poses of some frames, as viser wants them."""

    def __init__(self, arm: Arm, names: Sequence[str]) -> None:
        frames = [arm.chain.frame(name) for name in names]
        self._native = arm.chain.native
        self._after = [frame.after for frame in frames]
        self._homes = np.array([frame.home for frame in frames]).reshape(-1, 4, 4)

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (..., k, 3) and quaternions wxyz (..., k, 4)."""
        return _split(self._native.link_poses(q, self._after, self._homes))


def _split(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    return T[..., :3, 3], np.roll(rotation.as_quaternion(T[..., :3, :3]), 1, axis=-1)


def _shown_opacity(opacity: float) -> float | None:
    return None if opacity >= 1.0 else max(0.0, opacity)  # an opaque mesh is drawn in the ordinary way
