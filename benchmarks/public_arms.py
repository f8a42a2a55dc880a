"""Arms of other people, for the recall report: their numbers are read where installed packages put them.

An arm is a row of constant motions between joint axes, z along each axis,

    T_base_tip = C_0 Rz(q_1) C_1 Rz(q_2) ... Rz(q_n) C_n,

made here from what a package holds, without the package under test. Nothing of the packages is run or copied.

    python benchmarks/public_arms.py        lists what is found
"""

import ast
import json
import pathlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

import arms
import numpy as np

LOCKED_AT = 0.3  # rad, of the last joint of an arm with seven
URDFS = (  # package, end of the path, base, tip
    ("airo-models", "arms/ur3e/ur3e.urdf", "base_link", "tool0"),
    ("airo-models", "arms/ur5e/ur5e.urdf", "base_link", "tool0"),
    ("example-robot-data", "ur_description/urdf/ur3_robot.urdf", "world", "tool0"),
    ("example-robot-data", "ur_description/urdf/ur5_robot.urdf", "world", "tool0"),
    ("example-robot-data", "ur_description/urdf/ur10_robot.urdf", "world", "tool0"),
    ("example-robot-data", "kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector"),
    ("example-robot-data", "panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
    ("example-robot-data", "xarm_description/urdf/xarm7.urdf", "world", "link_eef"),
    ("example-robot-data", "z1_description/urdf/z1.urdf", "world", "link06"),
    ("example-robot-data", "baxter_description/urdf/baxter.urdf", "base", "left_gripper"),
    ("example-robot-data", "baxter_description/urdf/baxter.urdf", "base", "right_gripper"),
    ("example-robot-data", "so_arm_description/urdf/so101.urdf", "base_link", "gripper_frame_link"),
    ("pybullet", "kuka_iiwa/model.urdf", "lbr_iiwa_link_0", "lbr_iiwa_link_7"),
    ("pybullet", "xarm/xarm6_robot.urdf", "world", "link6"),
    ("rtb-data", "abb_irb140_description/urdf/irb140.urdf", "base_link", "tool0"),
    ("rtb-data", "kuka_kr120/urdf/kr120r2500pro.urdf", "base_link", "tool0"),
    ("rtb-data", "kuka_kr16/urdf/kr16_2.urdf", "base_link", "tool0"),
    ("rtb-data", "kuka_kr210/urdf/kr210l150.urdf", "base_link", "tool0"),
    ("rtb-data", "kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "base_link", "tool0"),
    ("rtb-data", "urdf/puma560_robot.urdf", "link1", "link7"),
)
PACKAGES = ("ssik", *dict.fromkeys(package for package, *_ in URDFS))


@dataclass(frozen=True)
class Arm:
    """Axes that turn, with the motions between them, (n + 1, 4, 4) [m, -]."""

    name: str
    source: str
    constants: np.ndarray
    note: str = ""

    @property
    def dof(self) -> int:
        return len(self.constants) - 1

    @property
    def screws(self) -> np.ndarray:
        """(n, 6) axes at rest in the base frame, linear part first."""
        T, found = self.constants[0], []
        for constant in self.constants[1:]:
            z = T[:3, 2] / np.linalg.norm(T[:3, 2])
            found.append(np.concatenate([np.cross(T[:3, 3], z), z]))
            T = T @ constant
        return np.array(found)

    @property
    def home(self) -> np.ndarray:
        """(4, 4) pose of the tip at rest, its rotation orthonormal to the last digit."""
        T = self.constants[0]
        for constant in self.constants[1:]:
            T = T @ constant
        u, _, v = np.linalg.svd(T[:3, :3])
        T = T.copy()
        T[:3, :3] = u @ v
        return T

    def forward(self, q: np.ndarray) -> np.ndarray:
        """The judge: (m, n) joint values to (m, 4, 4) poses."""
        q = np.asarray(q, dtype=float)
        columns = np.tile(self.constants[0][:3], (len(q), 1, 1))
        for value, constant in zip(q.T, self.constants[1:], strict=True):
            c, s = np.cos(value)[:, None], np.sin(value)[:, None]
            x, y = columns[:, :, 0], columns[:, :, 1]
            columns[:, :, 0], columns[:, :, 1] = c * x + s * y, c * y - s * x
            columns = (columns.reshape(-1, 4) @ constant).reshape(-1, 3, 4)
        T = np.zeros((len(q), 4, 4))
        T[:, :3], T[:, 3, 3] = columns, 1.0
        return T

    def locked(self) -> "Arm":
        """The arm without its last joint, which is held."""
        *first, before, after = self.constants
        turned = before @ _about_z(LOCKED_AT) @ after
        note = f"joint {self.dof} held at {LOCKED_AT} rad"
        return Arm(f"{self.name}, locked", self.source, np.array([*first, turned]), note)


def built_in(name: str) -> Arm:
    """A built-in arm from its table of joints or of screws, read as data."""
    table = json.loads((arms.TABLES / f"{name}.json").read_text())
    if "joints" in table:
        return _from_table(arms.Arm(name, table), "built in")
    points = np.array([screw["point"] for screw in table["screws"]])
    steps = np.diff(points, axis=0, prepend=0.0)
    x, y, z, w = table["home"]["quaternion_xyzw"]
    norm = x * x + y * y + z * z + w * w
    tip = np.eye(4)
    tip[:3, :3] += (2.0 / norm) * np.array(
        [
            [-(y * y + z * z), x * y - z * w, x * z + y * w],
            [x * y + z * w, -(x * x + z * z), y * z - x * w],
            [x * z - y * w, y * z + x * w, -(x * x + y * y)],
        ]
    )
    tip[:3, 3] = table["home"]["position"] - points[-1]
    right = [np.eye(4)] * (len(points) - 1) + [tip]
    axes = [np.array(screw["axis"]) for screw in table["screws"]]
    return Arm(name, "built in", _aligned([_moved(step) for step in steps], axes, right))


def built_in_names() -> list[str]:
    """Those with five or six axes that turn."""
    found = []
    for path in sorted(arms.TABLES.glob("*.json")):
        table = json.loads(path.read_text())
        kinds = [joint["type"] for joint in table.get("joints", ())] or ["revolute"] * len(table.get("screws", ()))
        moving = [kind for kind in kinds if kind != "fixed"]
        if len(moving) in (5, 6) and set(moving) <= {"revolute", "continuous"}:
            found.append(path.stem)
    return found


def public() -> list[Arm]:
    """All arms that the installed packages hold, those of seven joints with the last one held."""
    return [arm.locked() if arm.dof == 7 else arm for arm in (*_ssik(), *_urdfs())]


def _ssik() -> Iterator[Arm]:
    """The arms that ssik holds prepared solvers for. Their constants are read as literals; the modules are not imported."""
    for name, path in _files("ssik", "_ik.py"):
        found = {}
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found[node.targets[0].id] = node.value
        if "_JOINT_AXES" not in found or set(ast.literal_eval(found["_JOINT_TYPES"])) != {"revolute"}:
            continue
        axes, left, right = (_arrays(found[key]) for key in ("_JOINT_AXES", "_JOINT_T_LEFTS", "_JOINT_T_RIGHTS"))
        yield Arm(
            "/".join(pathlib.PurePath(name).parts[-2:]).removesuffix("_ik.py"),
            f"ssik {metadata.version('ssik')}",
            _aligned(left, axes, right),
        )


def _urdfs() -> Iterator[Arm]:
    for package, ending, base, tip in URDFS:
        for _, path in _files(package, ending):
            above = {joint.find("child").get("link"): joint for joint in _tree(path).findall("joint")}
            link, joints = tip, []
            while link != base:
                joints.append(_joint(above[link]))
                link = joints[-1]["parent"]
            label = ending.removesuffix(".urdf").removesuffix("/model").rpartition("/")[2]
            if sum(other == ending for _, other, *_ in URDFS) > 1:
                label += f" to {tip}"
            table = arms.Arm(label, {"base": base, "tip": tip, "joints": joints[::-1]})
            yield _from_table(table, f"{package} {metadata.version(package)}")


def _files(package: str, ending: str) -> Iterator[tuple[str, pathlib.Path]]:
    try:
        installed = metadata.files(package) or ()
    except metadata.PackageNotFoundError:
        return
    for item in sorted(installed, key=str):
        if str(item).endswith(ending):
            yield "/".join(part for part in item.parts if part != ".."), pathlib.Path(item.locate())


def _tree(path: pathlib.Path) -> ET.Element:
    """The XML of a URDF; the colons of prefixes that may not be declared go."""
    text = path.read_text(encoding="utf-8", errors="replace").strip()
    return ET.fromstring(re.sub(r"([<\s]|</)([A-Za-z_][\w.-]*):(?=[A-Za-z_])", r"\1\2_", text).encode())


def _joint(joint: ET.Element) -> dict:
    def numbers(tag: str, attribute: str, default: str) -> list[float]:
        element = joint.find(tag)
        return [float(x) for x in (default if element is None else element.get(attribute, default)).split()]

    return {
        "name": joint.get("name"),
        "type": joint.get("type"),
        "parent": joint.find("parent").get("link"),
        "child": joint.find("child").get("link"),
        "xyz": numbers("origin", "xyz", "0 0 0"),
        "rpy": numbers("origin", "rpy", "0 0 0"),
        "axis": numbers("axis", "xyz", "1 0 0"),
    }


def _from_table(table: arms.Arm, source: str) -> Arm:
    """The fixed motions of a joint table gathered between its axes."""
    left, axes, T = [], [], np.eye(4)
    for joint in table.joints:
        T = T @ arms._origin(joint)
        if joint["type"] in ("revolute", "continuous"):
            left.append(T)
            axes.append(np.asarray(joint["axis"], dtype=float))
            T = np.eye(4)
        elif joint["type"] != "fixed":
            raise ValueError(f"{table.name}: joint {joint['name']} is {joint['type']}")
    right = [np.eye(4)] * (len(axes) - 1) + [T]
    return Arm(table.name, source, _aligned(left, axes, right))


def _aligned(left: list[np.ndarray], axes: list[np.ndarray], right: list[np.ndarray]) -> np.ndarray:
    """``left_i turn(axis_i, q_i) right_i`` in a row, with frames turned so that every axis is z."""
    constants, T = [], np.eye(4)
    for before, axis, after in zip(left, axes, right, strict=True):
        z = axis / np.linalg.norm(axis)
        F = np.eye(4)
        if z[2] < 0.9999999999999999:
            helper = np.eye(3)[np.argmin(np.abs(z))]
            x = np.cross(helper, z) / np.linalg.norm(np.cross(helper, z))
            F[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        constants.append(T @ before @ F)
        T = F.T @ after
    return np.array([*constants, T])


def _arrays(node: ast.expr) -> list[np.ndarray]:
    """The numbers of a list of ``np.array([...], dtype=...)``."""
    assert isinstance(node, ast.List)
    return [np.array(ast.literal_eval(item.args[0]), dtype=float) for item in node.elts if isinstance(item, ast.Call)]


def _moved(step: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = step
    return T


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


if __name__ == "__main__":
    for one in public():
        print(f"{one.source:28} {one.name:34} {one.dof} joints  {one.note}")
