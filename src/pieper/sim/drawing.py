"""A `Picture` turned into pixels: a MuJoCo model of its arms, drawn in layers that are laid over each other.

Solid arms and the floor come first. Each ghost is drawn alone and laid over what is behind it, so that its own parts do not show
through each other. Frames, axes and lines come last; where something is in front of them they are fainter. Then the names are written.

Everything is drawn in a unit of length of its own, the size of what is shown: an arm of a millimetre looks like one of a kilometre.
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pieper.kinematics.fk import fk, fk_frames
from pieper.sim.framing import FIELD_OF_VIEW, Camera, fitted_camera, grid_width
from pieper.sim.ghost import laid_over
from pieper.sim.labels import Name, with_names
from pieper.sim.offscreen import Offscreen, Pixels, import_mujoco
from pieper.sim.stage import AXIS_COLORS, rgb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from pieper.sim.stage import ShownArm, Stage

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]
_TIMES_LOOKED_AT = 40  # of a motion, when the camera is set up
_TRACE_POINTS = 200
_SHOWS_THROUGH = 0.55  # of a frame behind something
_SOLID = 0.999
_NOT_DRAWN = 5  # a group of MuJoCo's
# as fractions of the size of what is shown
_ARROW, _ARROW_WIDTH = 0.08, 0.0055
_AXIS, _AXIS_WIDTH = 0.13, 0.0028
_LINE_WIDTH = 0.0035


class _Stroke(NamedTuple):
    """An arrow or a rod between two points, in the unit of the drawing."""

    start: FloatArray
    end: FloatArray
    width: float
    color: str
    arrow: bool = False


@contextmanager
def drawing(stage: Stage) -> Iterator[Callable[[float], Image]]:
    """A function that draws a picture at a time [s]; on leaving, the graphics memory is freed."""
    scale, center, corners = _extent(stage)
    factor = 2 if stage.smooth else 1
    width, height = (factor * side for side in stage.size)
    camera = fitted_camera(corners, center, stage.view, stage.size)
    floor = min(0.0, float(corners[:, 2].min())) if len(stage.arms) else 0.0
    model, owners = _model(stage, scale, camera, center, floor, (width, height))
    mujoco = import_mujoco()
    data = mujoco.MjData(model)
    option = mujoco.MjvOption()
    option.geomgroup[_NOT_DRAWN] = 0
    seen = mujoco.MjvCamera()
    seen.type = mujoco.mjtCamera.mjCAMERA_FIXED
    seen.fixedcamid = 0
    traces = [_trace(arm) * scale for arm in stage.arms if arm.trace]
    lines = [(line.points * scale, line.color) for line in stage.lines]
    lines += [(points, "#d6336c") for points in traces]

    with Offscreen(model, width, height) as target:

        def layer(shown: set[int], strokes: list[_Stroke], *, alone: bool) -> Pixels:
            model.geom_group[:] = [0 if owner in shown else _NOT_DRAWN for owner in owners]
            flags = target.scene.flags
            flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not alone
            flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
            flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not alone
            flags[mujoco.mjtRndFlag.mjRND_FOG] = not alone
            mujoco.mjv_updateScene(
                model, data, option, mujoco.MjvPerturb(), seen, mujoco.mjtCatBit.mjCAT_ALL, target.scene
            )
            for stroke in strokes:
                _put(target.scene, stroke, mujoco)
            return target.draw()

        def draw(t: float) -> Image:
            _move(stage, data, t, scale, mujoco)
            solid = {-1} | {k for k, arm in enumerate(stage.arms) if arm.opacity >= _SOLID}
            pixels = layer(solid, [], alone=False)
            colors, depth = pixels.colors.astype(np.float32), pixels.depth
            ghosts = [
                (arm.opacity, layer({k}, [], alone=True)) for k, arm in enumerate(stage.arms) if arm.opacity < _SOLID
            ]
            strokes, names = _marks(stage, t, scale, lines)
            nearest = depth
            colors = laid_over(colors, depth, ghosts)
            for _, ghost in ghosts:
                nearest = np.minimum(nearest, ghost.depth)
            if strokes:
                marks = layer(set(), strokes, alone=True)
                there = marks.depth < 1.0
                weight = np.where(marks.depth <= nearest + 1e-7, 1.0, _SHOWS_THROUGH) * there
                colors += weight[..., None].astype(np.float32) * (marks.colors - colors)
            image = _shrunk(colors, factor)
            return with_names(image, stage, names, camera, scale)

        yield draw


def _shrunk(colors: NDArray[np.float32], factor: int) -> Image:
    h, w = colors.shape[0] // factor, colors.shape[1] // factor
    small = colors.reshape(h, factor, w, factor, 3).mean(axis=(1, 3)) if factor > 1 else colors
    return np.clip(np.rint(small), 0, 255).astype(np.uint8)


def _extent(stage: Stage) -> tuple[float, FloatArray, FloatArray]:
    """The factor from metres to the unit of the drawing, the middle, and points around everything, both in that unit."""
    points = [frame.T_base_frame[None, :3, 3] for frame in stage.frames(0.0)]
    points += [line.points for line in stage.lines]
    for arm in stage.arms:
        times = np.linspace(0.0, arm.motion.duration, 1 if arm.motion.duration == 0.0 else _TIMES_LOOKED_AT)
        Ts = fk_frames(arm.chain, arm.motion.sample(arm.motion.t[0] + times).q, frames=range(len(arm.chain.screws) + 1))
        for body in arm.bodies:
            low, high = body.mesh.vertices.min(axis=0), body.mesh.vertices.max(axis=0)
            ends = np.stack([low, high])
            box = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
            T = Ts[:, body.link]
            points.append((np.einsum("tij,kj->tki", T[:, :3, :3], box) + T[:, None, :3, 3]).reshape(-1, 3))
    cloud = np.vstack(points) if points else np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.5]])
    size = float(np.linalg.norm(np.ptp(cloud, axis=0)))
    scale = 1.0 / size if size > 0.0 else 1.0
    strokes, _ = _marks(stage, 0.0, scale, [])
    around = np.vstack([cloud * scale, *[stroke.end[None] for stroke in strokes], *[s.start[None] for s in strokes]])
    return scale, 0.5 * (around.min(axis=0) + around.max(axis=0)), around


def _trace(arm: ShownArm) -> FloatArray:
    """The way of the tip, (k, 3) [m]."""
    times = np.linspace(0.0, arm.motion.duration, _TRACE_POINTS)
    return np.asarray(fk(arm.chain, arm.motion.sample(arm.motion.t[0] + times).q)[:, :3, 3])


def _model(
    stage: Stage, scale: float, camera: Camera, center: FloatArray, floor: float, size: tuple[int, int]
) -> tuple[Any, list[int]]:
    """A MuJoCo model in which every link is a body that is put where it belongs; and to which arm each geom belongs, -1 the floor."""
    mujoco = import_mujoco()
    spec = mujoco.MjSpec()
    _set_look(spec, stage, center, size)
    R = np.column_stack([camera.right, camera.up, -camera.ahead])
    spec.worldbody.add_camera(
        name="eye", pos=camera.eye, quat=_quaternion(R, mujoco), fovy=float(np.degrees(FIELD_OF_VIEW))
    )
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=center + np.array([0.5, -1.0, 2.0]), dir=[-0.35, 0.45, -1.0],
        diffuse=[0.42] * 3, specular=[0.1] * 3, castshadow=True,
    )  # fmt: skip
    owners = []
    if stage.grid:
        _add_floor(spec, stage, scale, floor)
        owners.append(-1)
    for k, arm in enumerate(stage.arms):
        _add_links(spec, k, arm, scale)
    model = spec.compile()
    owners += [int(model.body(int(body)).name.split("/")[0]) for body in model.geom_bodyid[len(owners) :]]
    return model, owners


def _set_look(spec: Any, stage: Stage, center: FloatArray, size: tuple[int, int]) -> None:
    """Size of the picture, sky and haze, and light from the side of the eye."""
    mujoco = import_mujoco()
    background = rgb(stage.theme.background)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 2048
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 60.0
    spec.visual.map.fogstart, spec.visual.map.fogend = 2.6, 7.0
    spec.visual.rgba.fog = [*background, 1.0]
    spec.visual.headlight.ambient = [0.42] * 3
    spec.visual.headlight.diffuse = [0.38] * 3
    spec.visual.headlight.specular = [0.12] * 3
    spec.stat.extent, spec.stat.center = 1.0, center
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=background, rgb2=background, width=8, height=48,
    )  # fmt: skip


def _add_floor(spec: Any, stage: Stage, scale: float, floor: float) -> None:
    """A plane at a height, with a grid whose width is a round number of metres."""
    mujoco, theme = import_mujoco(), stage.theme
    cell = grid_width(1.0 / scale) * scale
    spec.add_texture(
        name="grid", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE, rgb1=rgb(theme.floor), rgb2=rgb(theme.floor), markrgb=rgb(theme.lines),
        width=200, height=200,
    )  # fmt: skip
    material = spec.add_material(name="floor", texrepeat=[1.0 / cell, 1.0 / cell], texuniform=True, specular=0.0)
    textures = list(material.textures)
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    material.textures = textures
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[12.0, 12.0, 0.1], material="floor",
        pos=[0.5 * cell, 0.5 * cell, floor - 1e-4], contype=0, conaffinity=0,
    )  # fmt: skip


def _add_links(spec: Any, number: int, arm: ShownArm, scale: float) -> None:
    """A body for each link of an arm, named by the number of the arm and the link, with its meshes."""
    mujoco = import_mujoco()
    bodies: dict[int, Any] = {}
    for k, body in enumerate(arm.bodies):
        if body.link not in bodies:
            bodies[body.link] = spec.worldbody.add_body(name=f"{number}/{body.link}", mocap=True)
        name = f"{number}/{k}"
        spec.add_mesh(
            name=name,
            uservert=(body.mesh.vertices * scale).astype(np.float32).ravel(),
            userface=body.mesh.faces.astype(np.int32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        bodies[body.link].add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=[*rgb(body.color), 1.0], contype=0, conaffinity=0
        )


def _quaternion(R: FloatArray, mujoco: Any) -> FloatArray:
    """MuJoCo's order: w x y z."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).ravel())
    return quaternion


def _move(stage: Stage, data: Any, t: float, scale: float, mujoco: Any) -> None:
    """Put every link where it is at a time."""
    model = data.model
    for k, arm in enumerate(stage.arms):
        Ts = fk_frames(arm.chain, arm.joints(t), frames=range(len(arm.chain.screws) + 1))
        for link in {body.link for body in arm.bodies}:
            mocap = int(model.body(f"{k}/{link}").mocapid[0])
            data.mocap_pos[mocap] = Ts[link, :3, 3] * scale
            data.mocap_quat[mocap] = _quaternion(Ts[link, :3, :3], mujoco)
    mujoco.mj_forward(model, data)


def _marks(
    stage: Stage, t: float, scale: float, lines: list[tuple[FloatArray, str]]
) -> tuple[list[_Stroke], list[Name]]:
    strokes, names = [], []
    for frame in stage.frames(t):
        origin = frame.T_base_frame[:3, 3] * scale
        for k, color in enumerate(AXIS_COLORS):
            strokes.append(_Stroke(origin, origin + _ARROW * frame.T_base_frame[:3, k], _ARROW_WIDTH, color, True))
        if frame.label:
            names.append(Name(frame.label, origin))
    for arm in stage.arms:
        if not arm.axes:
            continue
        for name, point, direction in axes_at(arm, t):
            middle = point * scale
            strokes.append(_Stroke(middle - _AXIS * direction, middle + _AXIS * direction, _AXIS_WIDTH, "#9a4dd0"))
            if arm.labels:
                names.append(Name(name, middle + _AXIS * direction))
    for points, color in lines:
        strokes += [_Stroke(a, b, _LINE_WIDTH, color) for a, b in pairwise(points) if (a != b).any()]
    return strokes, names


def axes_at(arm: ShownArm, t: float) -> list[tuple[str, FloatArray, FloatArray]]:
    """Name, a point (3,) [m] and the direction (3,) of every joint axis at a time [s]."""
    chain = arm.chain
    m = len(chain.screws)
    Ts = fk_frames(chain, arm.joints(t), frames=range(1, m + 1))
    found = []
    for i, screw in enumerate(chain.screws):
        home = chain.frame(i + 1).home
        moved = Ts[i] @ np.linalg.inv(home)
        v, w = screw[:3], screw[3:]
        direction = w if w.any() else v
        point = home[:3, 3]
        if w.any():
            on = np.cross(w, v)
            point = on + w * float(w @ (point - on))
        joint = int(np.argmax(np.abs(chain.coupling[i])))
        found.append((chain.joint_names[joint], moved[:3, :3] @ point + moved[:3, 3], moved[:3, :3] @ direction))
    return found


def _put(scene: Any, stroke: _Stroke, mujoco: Any) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_ARROW if stroke.arrow else mujoco.mjtGeom.mjGEOM_CAPSULE
    color = np.array([*rgb(stroke.color), 1.0], dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), color)
    far = stroke.start + 2.0 * (stroke.end - stroke.start) if stroke.arrow else stroke.end  # an arrow ends half way
    mujoco.mjv_connector(geom, kind, stroke.width, stroke.start, far)
    geom.emission = 0.5
    scene.ngeom += 1
