"""What stands around an arm: fixed boards and boxes, things that can be picked, and cameras.

Everything is placed in the world, which is the base frame of the arm. A thing with a mass moves by itself; one without is fixed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError, unknown_name
from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.sim.mujoco_arm import primitive, quaternion
from pieper.sim.offscreen import import_mujoco
from pieper.sim.stage import rgb
from pieper.spatial._checks import stack

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

FloatArray = NDArray[np.float64]
Solid: TypeAlias = Box | Cylinder | Capsule | Sphere

WOOD, STEEL, PLASTIC, CLAY = "#c69c6d", "#8d99a6", "#3b6ea5", "#c8463c"

_TORSION = 0.01  # [m] friction against spinning, as a length times the friction
_ROLLING = 2e-3  # [m]
_STIFF = (0.004, 1.0)  # time constant [s] and damping ratio of contacts


@dataclass(frozen=True, eq=False)
class SceneObject:
    """Something in the world of an arm.

    Attributes
    ----------
    name : str
    solid : Box, Cylinder, Capsule or Sphere
        About its own frame.
    T_world_object : (4, 4) array
        Where it is at the beginning [m, -].
    mass : float or None
        [kg]; None for something fixed.
    color : str
        ``"#rrggbb"``.
    friction : float
        Coefficient of sliding friction of whatever touches it; that of a thing that moves prevails [-].
    picture : (rows, columns, 3) uint8 array or None
        Red, green, blue printed over the upper side of a box: the first row towards +y, the first column towards -x.

    Raises
    ------
    ArrayError
        A size, a mass or a friction that no body has, or a pose that is none.

    Examples
    --------
    >>> can = SceneObject("can", Cylinder(0.03, 0.12), at(0.5, 0.0, 0.06), mass=0.3)
    >>> can.moves, float(can.T_world_object[2, 3])
    (True, 0.06)
    """

    name: str
    solid: Solid
    T_world_object: FloatArray
    mass: float | None = None
    color: str = WOOD
    friction: float = 1.0
    picture: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        T = pose(self.T_world_object, f"T_world_object of {self.name!r}")
        object.__setattr__(self, "T_world_object", T)
        sizes = np.asarray(
            [*self.solid.size] if isinstance(self.solid, Box) else [*vars(self.solid).values()], dtype=float
        )
        if not (np.isfinite(sizes) & (sizes > 0.0)).all():
            raise ArrayError(f"the sizes of {self.name!r} must be above 0 and finite, got {sizes.tolist()}")
        if self.mass is not None and not (np.isfinite(self.mass) and self.mass > 0.0):
            raise ArrayError(
                f"the mass of {self.name!r} must be above 0 kg and finite, or None for something fixed; got {self.mass}"
            )
        if not (np.isfinite(self.friction) and self.friction >= 0.0):
            raise ArrayError(f"the friction of {self.name!r} must be 0 or more and finite, got {self.friction}")
        rgb(self.color)
        if self.picture is not None:
            printed = np.array(self.picture)
            fits = printed.ndim == 3 and printed.shape[2] == 3 and printed.size and printed.dtype == np.uint8
            if not fits or not isinstance(self.solid, Box):
                raise ArrayError(
                    f"the picture of {self.name!r} must be a (rows, columns, 3) array of uint8 on a box, got {printed.shape} of "
                    f"{printed.dtype} on a {type(self.solid).__name__}"
                )
            printed.setflags(write=False)
            object.__setattr__(self, "picture", printed)

    @property
    def moves(self) -> bool:
        """Whether it has a mass."""
        return self.mass is not None


@dataclass(frozen=True, eq=False)
class SceneCamera:
    """A camera in the world: x right, y down, z ahead, as in OpenCV.

    Attributes
    ----------
    name : str
    T_world_camera : (4, 4) array
    field_of_view : float
        Up and down [rad].
    """

    name: str
    T_world_camera: FloatArray
    field_of_view: float = float(np.radians(40.0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_world_camera", pose(self.T_world_camera, f"T_world_camera of {self.name!r}"))
        if not 0.0 < self.field_of_view < np.pi:
            raise ArrayError(f"field_of_view must be between 0 and pi rad, got {self.field_of_view}")

    @classmethod
    def looking(
        cls, name: str, eye: ArrayLike, target: ArrayLike, *, field_of_view: float = float(np.radians(40.0))
    ) -> SceneCamera:
        """A level camera at a point, (3,) [m], that looks at another.

        Raises
        ------
        ArrayError
            Both are the same point.
        """
        where, there = stack(eye, (3,), "eye"), stack(target, (3,), "target")
        ahead = there - where
        if float(np.linalg.norm(ahead)) < 1e-9:
            raise ArrayError(f"eye and target must be different points, got {where.tolist()} for both")
        z = ahead / np.linalg.norm(ahead)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x = np.array([1.0, 0.0, 0.0]) if float(np.linalg.norm(x)) < 1e-9 else x / np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        T[:3, 3] = where
        return cls(name, T, field_of_view)


@dataclass(frozen=True, eq=False)
class Scene:
    """Things and cameras around an arm.

    Attributes
    ----------
    objects : tuple of SceneObject
    cameras : tuple of SceneCamera
    floor : float or None
        Height of the ground [m]; None for none.

    Raises
    ------
    ArrayError
        Two things or two cameras of one name.
    """

    objects: tuple[SceneObject, ...] = ()
    cameras: tuple[SceneCamera, ...] = ()
    floor: float | None = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", tuple(self.objects))
        object.__setattr__(self, "cameras", tuple(self.cameras))
        for kind, names in (("object", [o.name for o in self.objects]), ("camera", [c.name for c in self.cameras])):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ArrayError(f"every {kind} of a scene needs a name of its own; {twice[0]!r} is given twice")
        if self.floor is not None and not np.isfinite(self.floor):
            raise ArrayError(f"floor must be a height [m] or None, got {self.floor}")

    def object(self, name: str) -> SceneObject:
        """The thing of that name."""
        found = next((thing for thing in self.objects if thing.name == name), None)
        if found is None:
            raise unknown_name("object", name, [thing.name for thing in self.objects], "the scene")
        return found

    def with_object(self, thing: SceneObject) -> Scene:
        """The scene with one more thing, or another one of the same name."""
        return replace(self, objects=(*(other for other in self.objects if other.name != thing.name), thing))


def pose(value: ArrayLike, name: str) -> FloatArray:
    """A read-only (4, 4) pose, checked.

    Raises
    ------
    ArrayError
        Another shape, or no rotation in it.
    """
    T = np.array(stack(value, (4, 4), name))
    if T.ndim != 2:
        raise ArrayError(f"{name} must have shape (4, 4), got {T.shape}")
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6) or np.linalg.det(T[:3, :3]) < 0.0:
        raise ArrayError(f"{name} must be a pose, and its 3x3 block is no rotation")
    T.setflags(write=False)
    return T


def at(x: float, y: float, z: float, *, yaw: float = 0.0) -> FloatArray:
    """The pose of something upright at a point, turned about the vertical.

    Parameters
    ----------
    x, y, z : float
        In the frame of the world [m].
    yaw : float
        [rad]

    Returns
    -------
    (4, 4) array
    """
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


# --------------------------------------------------------------------------------------------------------------------
# furniture


def shelf(
    name: str,
    *,
    x: tuple[float, float],
    edges: Iterable[float],
    boards: Iterable[float],
    top: float,
    floor: float = 0.0,
    thickness: float = 0.03,
    color: str = WOOD,
) -> tuple[SceneObject, ...]:
    """A shelf that opens towards -x.

    Parameters
    ----------
    name : str
    x : (float, float)
        Front and back [m].
    edges : floats
        Where the upright walls are, along y [m].
    boards : floats
        Heights of the upper sides of the boards [m].
    top : float
        Height of the upper ends of the walls and of the lid [m].
    floor : float
        Height that the walls begin at [m].
    thickness : float
        Of boards and walls [m].
    color : str
        ``"#rrggbb"``.

    Returns
    -------
    tuple of SceneObject
        Walls, boards, back and lid, all fixed.
    """
    ys, heights = sorted(edges), sorted(boards)
    deep, middle = x[1] - x[0], 0.5 * (x[0] + x[1])
    wide, y = ys[-1] - ys[0], 0.5 * (ys[0] + ys[-1])
    high = top - floor
    parts = [
        SceneObject(f"{name}/board{k}", _box(deep, wide, thickness), at(middle, y, h - 0.5 * thickness), color=color)
        for k, h in enumerate([*heights, top])
    ]
    parts += [
        SceneObject(f"{name}/wall{k}", _box(deep, thickness, high), at(middle, side, floor + 0.5 * high), color=color)
        for k, side in enumerate(ys)
    ]
    back = _box(0.5 * thickness, wide, high)
    parts.append(SceneObject(f"{name}/back", back, at(x[1], y, floor + 0.5 * high), color=color))
    return tuple(parts)


def open_box(
    name: str,
    *,
    center: tuple[float, float],
    size: tuple[float, float, float],
    floor: float = 0.0,
    wall: float = 0.02,
    color: str = PLASTIC,
) -> tuple[SceneObject, ...]:
    """A box without a lid: `center` (x, y) and outer `size` (x, y, z) [m]."""
    (x, y), (sx, sy, sz) = center, size
    z = floor + 0.5 * sz
    walls = {
        "floor": (_box(sx, sy, wall), at(x, y, floor + 0.5 * wall)),
        "left": (_box(sx, wall, sz), at(x, y + 0.5 * (sy - wall), z)),
        "right": (_box(sx, wall, sz), at(x, y - 0.5 * (sy - wall), z)),
        "front": (_box(wall, sy, sz), at(x + 0.5 * (sx - wall), y, z)),
        "back": (_box(wall, sy, sz), at(x - 0.5 * (sx - wall), y, z)),
    }
    return tuple(SceneObject(f"{name}/{side}", solid, T, color=color) for side, (solid, T) in walls.items())


def table(
    name: str,
    *,
    center: tuple[float, float],
    size: tuple[float, float],
    height: float,
    floor: float = 0.0,
    thickness: float = 0.03,
    color: str = WOOD,
) -> tuple[SceneObject, ...]:
    """A table: `center` (x, y) and `size` (x, y) of its top, whose upper side is at `height` [m]; four legs when it is high enough."""
    (x, y), (sx, sy) = center, size
    parts = [SceneObject(f"{name}/top", _box(sx, sy, thickness), at(x, y, height - 0.5 * thickness), color=color)]
    long = height - thickness - floor
    if long > thickness:
        leg = _box(1.5 * thickness, 1.5 * thickness, long)
        for k, (a, b) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)]):
            foot = at(x + a * 0.45 * sx, y + b * 0.45 * sy, floor + 0.5 * long)
            parts.append(SceneObject(f"{name}/leg{k}", leg, foot, color=STEEL))
    return tuple(parts)


def _box(x: float, y: float, z: float) -> Box:
    return Box(np.array([x, y, z]))


# --------------------------------------------------------------------------------------------------------------------
# into MuJoCo


def add_scene(spec: Any, scene: Scene) -> None:
    """Put a scene into a MuJoCo specification whose world is that of the scene. Bodies, joints and geoms are named ``thing/<name>``."""
    mujoco = import_mujoco()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1440
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 2048
    spec.visual.headlight.ambient = [0.40] * 3
    spec.visual.headlight.diffuse = [0.36] * 3
    spec.visual.headlight.specular = [0.10] * 3
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.98], rgb2=[0.70, 0.76, 0.84], width=64, height=384,
    )  # fmt: skip
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[-2.0, 2.0, 6.0], dir=[0.45, -0.3, -1.0], diffuse=[0.5] * 3, specular=[0.1] * 3,
        castshadow=True,
    )  # fmt: skip
    if scene.floor is not None:
        _add_floor(spec, scene.floor)
    for thing in scene.objects:
        T = thing.T_world_object
        body = spec.worldbody.add_body(name=f"thing/{thing.name}", pos=T[:3, 3], quat=quaternion(T[:3, :3]))
        if thing.moves:
            body.add_freejoint(name=f"thing/{thing.name}")
        kind, size = primitive(thing.solid)
        printed = {} if thing.picture is None else {"material": _add_picture(spec, thing.name, thing.picture)}
        body.add_geom(
            name=f"thing/{thing.name}", type=kind, size=size, rgba=[*([1.0] * 3 if printed else rgb(thing.color)), 1.0], **printed, contype=2, conaffinity=3, condim=6 if thing.moves else 4,
            mass=thing.mass or 0.0, friction=friction_vector(thing.friction), priority=1 if thing.moves else 0, solref=_STIFF,
        )  # fmt: skip
    for camera in scene.cameras:
        T = camera.T_world_camera
        spec.worldbody.add_camera(
            name=camera.name, pos=T[:3, 3], quat=quaternion(T[:3, :3] @ np.diag([1.0, -1.0, -1.0])),
            fovy=float(np.degrees(camera.field_of_view)),
        )  # fmt: skip


def _add_picture(spec: Any, name: str, picture: NDArray[np.uint8]) -> str:
    """A material with a picture on it; returns its name."""
    mujoco = import_mujoco()
    called = f"picture/{name}"
    rows, columns, _ = picture.shape
    texture = spec.add_texture(name=called, type=mujoco.mjtTexture.mjTEXTURE_2D, width=columns, height=rows, nchannel=3)
    texture.data = picture.tobytes()
    material = spec.add_material(name=called, specular=0.0)
    textures = list(material.textures)
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = called
    material.textures = textures
    return called


def friction_vector(friction: float) -> list[float]:
    """MuJoCo's three numbers: sliding [-], spinning [m], rolling [m]."""
    return [friction, _TORSION * friction, _ROLLING * friction]


def _add_floor(spec: Any, height: float) -> None:
    mujoco = import_mujoco()
    spec.add_texture(
        name="ground", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.86, 0.87, 0.89], rgb2=[0.81, 0.82, 0.85], width=256, height=256,
    )  # fmt: skip
    material = spec.add_material(name="ground", texrepeat=[1.0, 1.0], texuniform=True, specular=0.0)
    textures = list(material.textures)
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "ground"
    material.textures = textures
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20.0, 20.0, 0.1], pos=[0.0, 0.0, height], material="ground",
        contype=2, conaffinity=2, condim=4, solref=_STIFF,
    )  # fmt: skip
