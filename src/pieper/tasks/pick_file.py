"""Pick-and-place tasks in YAML files: the same task for another arm, hand or room is another file.

Metres, radians, kilograms, newtons; places in the base frame of the arm. A pose has a `position`, and an orientation that is one of `rpy`,
`quaternion` (x, y, z, w) and `facing`: ``ahead`` turns z of a hand to x of the frame, ``down`` turns it to -z; y stays. What may be left
out stands in brackets:

.. code-block:: yaml

    name: kr210
    arm: kr210                        # a built-in robot, or a URDF file beside this one
    [tip: tool0]                      # a link, where the description leaves a choice
    gripper: {stroke: 0.16, force: 150, reach: 0.2, [mount: {facing: ahead}, pad: [0.014, 0.05, 0.07], speed: 0.2, mass: 8, color: "#4a4f57"]}
    scene:
      [floor: 0.0]                    # height of the ground, or none
      [shelves]: [{name: shelf, x: [2.48, 2.95], edges: [-0.45, 0.45], boards: [0.66, 1.43], top: 2.95, [floor, thickness, color]}]
      [boxes]:   [{name: bin, center: [0.05, 2.5], size: [1.0, 0.9, 0.75], [floor, wall, color]}]          # without a lid
      [tables]:  [{name: table, center: [0.27, 0], size: [0.28, 0.5], height: -0.05, [floor, thickness, color]}]
      [things]:  [{name: post, box: [0.1, 0.1, 1], position: [1, 0, 0.5], [rpy, mass, color, friction]}]   # or cylinder, capsule, sphere
      cameras:   [{name: corner, eye: [-3.2, -3.8, 3.1], target: [1.2, 0.6, 1.2], [field_of_view: 0.7]}]
    targets: {name: can, cylinder: {radius: 0.05, length: 0.3}, mass: 1.0, [friction: 0.9], slots: [[2.6, 0.9, 0.811], ...]}
                                      # or a list of names of things with a mass
    grasp: {[position: [0, 0, 0]], facing: ahead}     # the middle of the pads in the frame of a target
    drop: {position: [-0.1, 2.5, 1.6]}                # of the tip when it lets go
    bin_region: [[-0.45, 2.05, 0], [0.55, 2.95, 0.75]]
    q_home: [0, 0, 0, 0, -0.6, 0]
    [postures: [[...], ...], approach: 0.2, clearance: 0.5, lift: 0.03, drop_step: 0, spin_free: false, position_noise: 0.005,
     yaw_noise: 0.087, attempts: 3, speed: 1]         # see `pieper.tasks.pick.PickTask`
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from pieper.arm import load
from pieper.errors import PieperError, WorldError
from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.sim.gripper import ParallelGripper
from pieper.sim.scene import CLAY, Scene, SceneCamera, SceneObject, at, open_box, shelf, table
from pieper.spatial import rotation
from pieper.tasks.pick import PickTask
from pieper.yaml_file import Section, parse_yaml, read_yaml

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from pieper.arm import Arm

    FloatArray = NDArray[np.float64]

AHEAD = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(4, 4): z of the hand along x of the thing, y along y: a grasp from the front."""

DOWN = np.diag([-1.0, 1.0, -1.0, 1.0])
"""(4, 4): z of the hand down: a grasp from above."""

COLORS = (CLAY, "#2f7fd1", "#3aa655", "#c9a227", "#8a63c7", "#d9773b", "#4fb3bf", "#b5485d", "#6b8e23")
"""Of the targets, one after another."""

SOLIDS = ("box", "cylinder", "capsule", "sphere")

Made = TypeVar("Made")

_NUMBERS = ("approach", "clearance", "lift", "drop_step", "position_noise", "yaw_noise", "speed")


def read_pick_task(path: str | Path) -> PickTask:
    """Read a task from a YAML file; the layout is at the top of this module.

    Parameters
    ----------
    path : str or Path
        A URDF file that it names is looked for beside it.

    Returns
    -------
    PickTask

    Raises
    ------
    OSError
        The file cannot be read.
    WorldError
        It is malformed, or no task: the message names file, line and field.
    MissingExtraError
        PyYAML is not installed.
    """
    return _task(read_yaml(path, error=WorldError, extra="sim"), Path(path).parent)


def parse_pick_task(raw: bytes, name: str) -> PickTask:
    """Read a task from the bytes of such a file; `name` stands in messages."""
    return _task(parse_yaml(raw, name, error=WorldError, extra="sim"), Path())


def _task(file: Section, folder: Path) -> PickTask:
    file.only(
        "name", "comment", "arm", "tip", "gripper", "scene", "targets", "grasp", "drop", "bin_region", "q_home", "postures", "attempts",
        "spin_free", *_NUMBERS,
    )  # fmt: skip
    arm = _arm(file, folder)
    gripper = _gripper(file.section("gripper"))
    scene = _scene(file.section("scene"))
    things, targets = _targets(file)
    region = file.array("bin_region", (2, 3))
    if (region[0] >= region[1]).any():
        raise file.error("bin_region", "must be the lower and the upper corner [m], in this order")
    more: dict[str, Any] = {name: file.number(name) for name in _NUMBERS if name in file}
    if "attempts" in file:
        more["attempts"] = file.integer("attempts", least=1)
    if "spin_free" in file:
        more["spin_free"] = file.boolean("spin_free")
    postures = file.array("postures", (None, arm.dof), np.zeros((0, arm.dof)))
    for q in postures:
        _within(file, "postures", arm, q)
    q_home = file.array("q_home", (arm.dof,))
    _within(file, "q_home", arm, q_home)
    scene = _made(file, "targets", lambda: Scene((*scene.objects, *things), scene.cameras, floor=scene.floor))
    return _made(
        file, "",
        lambda: PickTask(
            file.text("name"), arm, gripper, scene, targets, _pose(file.section("grasp")), _pose(file.section("drop")), region, q_home,
            postures=tuple(postures), **more,
        ),
    )  # fmt: skip


def _made(section: Section, key: str, make: Callable[[], Made]) -> Made:
    """What is made, or the error about it with file, line and field."""
    try:
        return make()
    except WorldError as cause:
        if str(cause).startswith(section.file):
            raise
        raise section.error(key, str(cause)) from None
    except PieperError as cause:
        raise section.error(key, str(cause)) from None


def _arm(file: Section, folder: Path) -> Arm:
    name = file.text("arm")
    beside = folder / name
    what = str(beside) if beside.suffix in (".urdf", ".xacro", ".xml") else name
    tip = file.text("tip") if "tip" in file else None
    try:
        return load(what, tip=tip)
    except OSError as cause:
        raise file.error("arm", f"{what}: {cause.strerror or cause}") from None
    except PieperError as cause:
        raise file.error("arm", str(cause)) from None


def _within(file: Section, key: str, arm: Arm, q: FloatArray) -> None:
    lower, upper = arm.limits.T
    for name, value, low, high in zip(arm.joint_names, q, lower, upper, strict=True):
        if not low <= value <= high:
            raise file.error(key, f"joint {name!r} at {value:g} is outside its limits [{low:.6g}, {high:.6g}]")


def _gripper(fields: Section) -> ParallelGripper:
    fields.only("stroke", "force", "reach", "mount", "pad", "speed", "mass", "color")
    more: dict[str, Any] = {name: fields.number(name) for name in ("speed", "mass") if name in fields}
    if "pad" in fields:
        more["pad"] = fields.array("pad", (3,))
    if "color" in fields:
        more["color"] = fields.text("color")
    if "mount" in fields:
        more["T_tip_mount"] = _pose(fields.section("mount"))
    more |= {name: fields.number(name) for name in ("stroke", "force", "reach")}
    return _made(fields, "", lambda: ParallelGripper(**more))


def _scene(fields: Section) -> Scene:
    fields.only("floor", "shelves", "boxes", "tables", "things", "cameras")
    floor: float | None = 0.0
    if "floor" in fields:
        floor = None if fields.plain("floor")["floor"] is None else fields.number("floor")
    things: list[SceneObject] = []
    ground = 0.0 if floor is None else floor
    for section in fields.sections("shelves", []):
        things += _shelf(section, ground)
    for section in fields.sections("boxes", []):
        things += _open_box(section, ground)
    for section in fields.sections("tables", []):
        things += _table(section, ground)
    things += [_thing(section) for section in fields.sections("things", [])]
    cameras = [_camera(section) for section in fields.sections("cameras")]
    return _made(fields, "", lambda: Scene(tuple(things), tuple(cameras), floor=floor))


def _shelf(fields: Section, floor: float) -> tuple[SceneObject, ...]:
    fields.only("name", "x", "edges", "boards", "top", "floor", "thickness", "color")
    front, back = fields.array("x", (2,))
    if front >= back:
        raise fields.error("x", "must be the front and the back [m], in this order")
    edges = fields.array("edges", (None,))
    if len(edges) < 2:
        raise fields.error("edges", "must be two or more places of walls along y [m]")
    more = _looks(fields, "thickness")
    return _made(
        fields, "",
        lambda: shelf(
            fields.text("name"), x=(float(front), float(back)), edges=edges, boards=fields.array("boards", (None,)), top=fields.number("top"),
            floor=fields.number("floor", floor), **more,
        ),
    )  # fmt: skip


def _open_box(fields: Section, floor: float) -> tuple[SceneObject, ...]:
    fields.only("name", "center", "size", "floor", "wall", "color")
    x, y = map(float, fields.array("center", (2,)))
    size = fields.array("size", (3,))
    more = _looks(fields, "wall")
    return _made(
        fields, "",
        lambda: open_box(
            fields.text("name"), center=(x, y), size=(float(size[0]), float(size[1]), float(size[2])), floor=fields.number("floor", floor), **more
        ),
    )  # fmt: skip


def _table(fields: Section, floor: float) -> tuple[SceneObject, ...]:
    fields.only("name", "center", "size", "height", "floor", "thickness", "color")
    x, y = map(float, fields.array("center", (2,)))
    wide, deep = map(float, fields.array("size", (2,)))
    more = _looks(fields, "thickness")
    return _made(
        fields, "",
        lambda: table(
            fields.text("name"), center=(x, y), size=(wide, deep), height=fields.number("height"), floor=fields.number("floor", floor), **more
        ),
    )  # fmt: skip


def _looks(fields: Section, *numbers: str) -> dict[str, Any]:
    more: dict[str, Any] = {name: fields.number(name) for name in numbers if name in fields}
    if "color" in fields:
        more["color"] = fields.text("color")
    return more


def _thing(fields: Section) -> SceneObject:
    fields.only("name", *SOLIDS, "position", "rpy", "quaternion", "facing", "mass", "color", "friction")
    solid, T, more = _solid(fields), _pose(fields), _looks(fields, "mass", "friction")
    return _made(fields, "", lambda: SceneObject(fields.text("name"), solid, T, **more))


def _solid(fields: Section) -> Box | Cylinder | Capsule | Sphere:
    kinds = [kind for kind in SOLIDS if kind in fields]
    if len(kinds) != 1:
        got = " and ".join(kinds) or "none of them"
        raise fields.error("", f"a thing needs one of {', '.join(SOLIDS)}; got {got}")
    kind = kinds[0]
    if kind == "box":
        return Box(fields.array("box", (3,)))
    if kind == "sphere":
        return Sphere(fields.number("sphere"))
    sizes = fields.section(kind)
    sizes.only("radius", "length")
    make = Cylinder if kind == "cylinder" else Capsule
    return make(sizes.number("radius"), sizes.number("length"))


def _camera(fields: Section) -> SceneCamera:
    fields.only("name", "eye", "target", "field_of_view")
    more: dict[str, Any] = {"field_of_view": fields.number("field_of_view")} if "field_of_view" in fields else {}
    name, eye, target = fields.text("name"), fields.array("eye", (3,)), fields.array("target", (3,))
    return _made(fields, "", lambda: SceneCamera.looking(name, eye, target, **more))


def _targets(file: Section) -> tuple[tuple[SceneObject, ...], tuple[str, ...]]:
    """Things in slots, or names of things that are in the scene already."""
    if isinstance(file.plain("targets").get("targets"), list):
        return (), tuple(file.texts("targets"))
    fields = file.section("targets")
    fields.only("name", *SOLIDS, "mass", "friction", "slots")
    solid, slots, name = _solid(fields), fields.array("slots", (None, 3)), fields.text("name")
    mass = fields.number("mass")
    more = _looks(fields, "friction")
    names = tuple(f"{name} {k + 1}" for k in range(len(slots)))
    if not names:
        raise fields.error("slots", "must hold at least one place")
    colors = [COLORS[k % len(COLORS)] for k in range(len(slots))]
    things = [
        _made(
            fields,
            "",
            partial(SceneObject, names[k], solid, at(*map(float, slots[k])), mass=mass, color=colors[k], **more),
        )
        for k in range(len(slots))
    ]
    return tuple(things), names


def _pose(fields: Section) -> FloatArray:
    """A position, and one way to tell an orientation."""
    given = [key for key in ("rpy", "quaternion", "facing") if key in fields]
    if len(given) > 1:
        raise fields.error(given[1], f"{given[0]} and {given[1]} both speak of the orientation; give one of them")
    T = np.eye(4)
    if "facing" in fields:
        facing = fields.text("facing")
        if facing not in ("ahead", "down"):
            raise fields.error("facing", f"must be ahead or down, got {facing!r}")
        T[:] = AHEAD if facing == "ahead" else DOWN
    elif "rpy" in fields:
        T[:3, :3] = rotation.from_rpy(fields.array("rpy", (3,)))
    elif "quaternion" in fields:
        xyzw = fields.array("quaternion", (4,))
        length = float(np.linalg.norm(xyzw))
        if abs(length - 1.0) > 1e-3:
            raise fields.error("quaternion", f"must have length 1 (x, y, z, w), got {length:.6g}")
        T[:3, :3] = rotation.from_quaternion(xyzw / length)
    T[:3, 3] = fields.array("position", (3,), np.zeros(3))
    return T
