"""Pictures and films of arms without a screen: arms, ghosts, frames with names, joint axes, and the way of the tip.

A `Picture` is told what to show; `Picture.image` draws it at any time of the trajectories in it, `Picture.save` writes a PNG file, and
`pieper.sim.film.save` a film. MuJoCo draws, on a graphics card or in software; nothing is simulated.

Frames are drawn as in most books: x red, y green, z blue. They show through the arm, fainter where they are behind something.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.arm import Arm
from pieper.atomic_file import replacing
from pieper.errors import ArrayError, unknown_name
from pieper.kinematics.joints import as_joints
from pieper.model import shape
from pieper.model.chain import Chain
from pieper.model.description import Mesh
from pieper.motion.trajectory import Trajectory
from pieper.sim.drawing import drawing
from pieper.sim.meshes import bodies_of_description, bodies_of_shape, read_mesh
from pieper.sim.offscreen import LARGEST_SIDE, import_pillow
from pieper.sim.stage import (
    ARM_COLORS,
    THEMES,
    VIEWS,
    Body,
    ShownArm,
    ShownFrame,
    ShownLine,
    Stage,
    rgb,
)
from pieper.spatial._checks import stack

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator

    from numpy.typing import ArrayLike

    from pieper.model.description import Geometry

Image = NDArray[np.uint8]


class Picture:
    """Arms and frames to be drawn.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.
    theme : str
        ``"light"`` or ``"dark"``.
    view : str or (float, float)
        One of `VIEWS`, or azimuth and elevation of the eye [rad]. The camera is as near as the arms allow, over all their motions.
    grid : bool
        Whether there is a floor, with a grid whose width is told in a corner.
    smooth : bool
        Draw at twice the size and shrink: smooth edges, for up to four times the time.

    Raises
    ------
    ArrayError
        A size that is not two whole numbers of 16 pixels or more.
    UnknownNameError
        No theme or view of that name.

    Examples
    --------
    >>> import pieper
    >>> picture = Picture(size=(320, 240))
    >>> picture.add_arm(pieper.load("mh12"), [0.0, 0.3, -0.2, 0.0, 0.8, 0.0], frames=["base_link", "tool0"])
    >>> [frame.label for frame in picture.frames()]
    ['base_link', 'tool0']
    >>> picture.image().shape  # doctest: +SKIP
    (240, 320, 3)
    """

    def __init__(
        self,
        *,
        size: tuple[int, int] = (960, 720),
        theme: str = "light",
        view: str | tuple[float, float] = "corner",
        grid: bool = True,
        smooth: bool = True,
    ) -> None:
        if theme not in THEMES:
            raise unknown_name("theme", theme, THEMES)
        self.stage = Stage(_checked_size(size), THEMES[theme], _checked_view(view), grid, smooth)

    # --- what to show

    def add_arm(
        self,
        arm: Arm | Chain,
        q: ArrayLike | Trajectory,
        *,
        color: str | None = None,
        opacity: float = 1.0,
        frames: bool | Iterable[str | int] = False,
        labels: bool = True,
        axes: bool = False,
        trace: bool = False,
        meshes: bool = True,
    ) -> None:
        """Show an arm.

        Parameters
        ----------
        arm : Arm or Chain
        q : (n,) array or Trajectory
            Joint values [rad or m], or a motion; its columns are put in the order of the arm by name.
        color : str, optional
            ``"#rrggbb"``; one of `ARM_COLORS` unless given.
        opacity : float
            From 0 to 1. Below 1 the arm is a ghost.
        frames : bool or iterable of str or int
            Frames to draw: all, or by link name or joint count, see `Chain.frame`.
        labels : bool
            Whether frames and axes have names beside them.
        axes : bool
            Draw the joint axes.
        trace : bool
            Draw the way of the tip, over the whole motion.
        meshes : bool
            Use the meshes of the description where all their files are at hand; otherwise, and where a file cannot be read, which a
            warning says, the shape is made from the chain.

        Raises
        ------
        ArrayError
            Joint values that do not fit the arm, an opacity out of 0 to 1, or a colour that is none.
        UnknownNameError
            A frame that the arm does not have.
        """
        chain = arm.chain if isinstance(arm, Arm) else arm
        description = arm.description if isinstance(arm, Arm) else None
        motion = q.in_order(chain.joint_names) if isinstance(q, Trajectory) else _resting(chain, q)
        if not 0.0 < opacity <= 1.0:
            raise ArrayError(f"opacity must be above 0 and at most 1, got {opacity}")
        paint = ARM_COLORS[len(self.stage.arms) % len(ARM_COLORS)] if color is None else color
        rgb(paint)
        if isinstance(frames, bool):
            names: tuple[str | int, ...] = tuple(f.name for f in chain.frames) if frames else ()
        else:
            names = tuple(chain.frame(which).name for which in frames)
        bodies = bodies_of_description(description, chain, paint) if meshes and description is not None else None
        if bodies is None:
            bodies = bodies_of_shape(chain, paint, self.stage.theme)
        self.stage.arms.append(ShownArm(chain, motion, paint, opacity, names, axes, trace, labels, bodies))

    def add_solids(
        self, solids: Iterable[tuple[Geometry, ArrayLike]], *, color: str = "#9aa3ad", opacity: float = 1.0
    ) -> None:
        """Show solids that stay where they are, such as the obstacles of a world.

        Parameters
        ----------
        solids : iterable of (Box, Cylinder, Capsule, Sphere or Mesh; (4, 4) array)
            Each with its pose in the base frame [m, -].
        color : str
            ``"#rrggbb"``.
        opacity : float
            From 0 to 1.

        Raises
        ------
        ArrayError
            A pose that is none, or an opacity that is not above 0 and at most 1.
        """
        if not 0.0 < opacity <= 1.0:
            raise ArrayError(f"opacity must be above 0 and at most 1, got {opacity}")
        rgb(color)
        surfaces = []
        for solid, T in solids:
            if isinstance(solid, Mesh):
                found = read_mesh(solid.path or solid.filename)
                surface = shape.Triangles(found.vertices * solid.scale, found.faces)
            else:
                surface = shape.as_mesh(solid, sections=48)
            pose = stack(T, (4, 4), "T")
            surfaces.append(shape.Triangles(surface.vertices @ pose[:3, :3].T + pose[:3, 3], surface.faces))
        if surfaces:
            nothing = Chain("solids", np.zeros((0, 6)), np.eye(4), np.zeros((0, 2)), ())
            bodies = (Body(0, color, shape.merge(surfaces)),)
            motion = Trajectory(np.zeros(1), np.zeros((1, 0)))
            self.stage.arms.append(ShownArm(nothing, motion, color, opacity, (), False, False, False, bodies))

    def add_frame(self, T_base_frame: ArrayLike, *, label: str = "") -> None:
        """Show a frame that stays where it is, (4, 4).

        Raises
        ------
        ArrayError
            It is no pose, or more than one.
        """
        T = stack(T_base_frame, (4, 4), "T_base_frame")
        if T.ndim != 2:
            raise ArrayError(f"T_base_frame must have shape (4, 4), got {T.shape}; add several frames one by one")
        self.stage.still_frames.append(ShownFrame(label, T))

    def add_line(self, points: ArrayLike, *, color: str = "#d6336c") -> None:
        """Show a line through points, (k, 3) [m].

        Raises
        ------
        ArrayError
            There are fewer than two points, or points of another shape.
        """
        line = stack(points, (3,), "points")
        if line.ndim != 2 or len(line) < 2:
            raise ArrayError(f"points must have shape (k, 3) with two points or more, got {line.shape}")
        rgb(color)
        self.stage.lines.append(ShownLine(line, color))

    # --- what is shown

    @property
    def duration(self) -> float:
        """The end of the longest motion, in seconds from its beginning; 0 when nothing moves."""
        return max((arm.motion.duration for arm in self.stage.arms), default=0.0)

    def frames(self, t: float = 0.0) -> list[ShownFrame]:
        """Every frame in the picture with its label, at a time [s] of the motions."""
        return self.stage.frames(t)

    def image(self, t: float = 0.0) -> Image:
        """The picture at a time [s] of the motions: (height, width, 3), red, green and blue from 0 to 255.

        Raises
        ------
        MissingExtraError, MissingLibraryError
            Nothing to draw with; the message says what to install.
        """
        with drawing(self.stage) as draw:
            return draw(float(t))

    def images(self, times: Iterable[float]) -> Iterator[Image]:
        """Pictures at several times [s], quicker than one by one."""
        with drawing(self.stage) as draw:
            for t in times:
                yield draw(float(t))

    def png(self, t: float = 0.0) -> bytes:
        """The picture as the contents of a PNG file."""
        target = io.BytesIO()
        import_pillow().fromarray(self.image(t)).save(target, format="PNG", optimize=True)
        return target.getvalue()

    def save(self, path: str | os.PathLike[str], *, t: float = 0.0) -> None:
        """Write a PNG file; one of that name is replaced once the new one is complete.

        Raises
        ------
        ArrayError
            A name that does not end in ``.png``.
        OSError
            The file cannot be written.
        """
        if Path(path).suffix.lower() != ".png":
            raise ArrayError(f"a picture must end in .png, got {str(path)!r}; for a motion see pieper.sim.film.save")
        with replacing(path) as unfinished:
            unfinished.write_bytes(self.png(t))


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    numbers = np.asarray(size)
    if (
        numbers.shape != (2,)
        or numbers.dtype.kind not in "iu"
        or not ((numbers >= 16) & (numbers <= LARGEST_SIDE)).all()
    ):
        raise ArrayError(f"size must be two whole numbers of pixels from 16 to {LARGEST_SIDE}, got {size!r}")
    return int(numbers[0]), int(numbers[1])


def _checked_view(view: str | tuple[float, float]) -> tuple[float, float]:
    if isinstance(view, str):
        if view not in VIEWS:
            raise unknown_name("view", view, VIEWS)
        azimuth, elevation = np.radians(VIEWS[view])
        return float(azimuth), float(elevation)
    angles = stack(view, (2,), "view")
    if angles.ndim != 1 or abs(angles[1]) > 0.5 * np.pi:
        raise ArrayError(f"view must be azimuth and elevation [rad], the latter from -pi/2 to pi/2, got {view!r}")
    return float(angles[0]), float(angles[1])


def _resting(chain: Chain, q: ArrayLike) -> Trajectory:
    values = as_joints(chain, q)
    if values.ndim != 1:
        raise ArrayError(f"q must have shape ({chain.dof},), got {values.shape}; add several arms one by one")
    return Trajectory(np.zeros(1), values[None], joint_names=chain.joint_names)
