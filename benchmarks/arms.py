"""The built-in arms for the peers, and a judge that shares no code with anyone.

The joint tables are read as data; URDF text for the peers and the judge's forward kinematics are made from them here,
without the package under test.
"""

import json
import pathlib
import tempfile
from collections.abc import Container

import numpy as np

TABLES = pathlib.Path(__file__).parents[1] / "src" / "pieper" / "model" / "robots"


class Arm:
    """One chain: joints from base to tip with their tables, its limits, and its URDF."""

    def __init__(self, name: str, table: dict) -> None:
        self.name = name
        self.base: str = table["base"]
        self.tip: str = table["tip"]
        self.joints: list[dict] = table["joints"]
        self.moving = [joint for joint in self.joints if joint["type"] != "fixed"]
        self.dof = len(self.moving)

    def nominal(self) -> "Arm":
        """The same arm with the exact turns its rounded angles stand for."""
        joints = [{**joint, "rpy": joint.get("rpy_nominal", joint["rpy"])} for joint in self.joints]
        return Arm(self.name, {"base": self.base, "tip": self.tip, "joints": joints})

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper value of each moving joint, infinite where there is none."""
        return np.array(
            [[joint.get("lower", -np.inf), joint.get("upper", np.inf)] for joint in self.moving], dtype=float
        )

    @property
    def limits(self) -> np.ndarray:
        """The same, with half a turn either way of zero where there is none."""
        return np.where(np.isinf(self.bounds), [-np.pi, np.pi], self.bounds)

    def sample(self, count: int, *, seed: int = 0) -> np.ndarray:
        """Joint values drawn evenly between the limits, shape (count, dof)."""
        lower, upper = self.limits.T
        return np.random.default_rng(seed).uniform(lower, upper, (count, self.dof))

    def forward(self, q: np.ndarray) -> np.ndarray:
        """The judge's forward kinematics: (count, dof) to (count, 4, 4), base to tip."""
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        column = iter(np.asarray(q).T)
        for joint in self.joints:
            T = T @ _origin(joint)
            if joint["type"] != "fixed":
                T = T @ _motion(joint, next(column))
        return T

    def within_limits(self, q: np.ndarray, *, slack: float = 0.0) -> np.ndarray:
        """Whether each row of (count, dof) keeps the limits."""
        lower, upper = self.bounds.T
        return np.all((q >= lower - slack) & (q <= upper + slack), axis=-1)

    def urdf(self, *, continuous: bool = True) -> str:
        """The chain as URDF text, links without geometry.

        For peers that keep two numbers for a continuous joint: not ``continuous`` makes it a revolute one that may
        turn a hundred times.
        """
        links = [self.base, *(joint["child"] for joint in self.joints)]
        lines = [f'<robot name="{self.name}">', *(f'  <link name="{link}"/>' for link in links)]
        for joint in self.joints:
            endless = joint["type"] == "continuous"
            kind = "revolute" if endless and not continuous else joint["type"]
            lines.append(f'  <joint name="{joint["name"]}" type="{kind}">')
            lines.append(f'    <parent link="{joint["parent"]}"/><child link="{joint["child"]}"/>')
            lines.append(f'    <origin xyz="{_text(joint["xyz"])}" rpy="{_text(joint["rpy"])}"/>')
            if joint["type"] != "fixed":
                lines.append(f'    <axis xyz="{_text(joint["axis"])}"/>')
                lower, upper = (-628.0, 628.0) if endless else (float(joint["lower"]), float(joint["upper"]))
                bounds = "" if kind == "continuous" else f'lower="{lower!r}" upper="{upper!r}" '
                lines.append(f'    <limit {bounds}velocity="1" effort="1"/>')
            lines.append("  </joint>")
        return "\n".join([*lines, "</robot>"])

    def urdf_file(self) -> pathlib.Path:
        """The same in a temporary file, for peers that want a path."""
        path = pathlib.Path(tempfile.mkdtemp(prefix="pieper-bench-")) / f"{self.name}.urdf"
        path.write_text(self.urdf())
        return path


def load(name: str) -> Arm:
    return Arm(name, json.loads((TABLES / f"{name}.json").read_text()))


def names(*, dof: Container[int] = (6, 7)) -> list[str]:
    """The built-in arms with so many joints that have a joint table."""
    tables = {path.stem: json.loads(path.read_text()) for path in sorted(TABLES.glob("*.json"))}
    return [name for name, table in tables.items() if "joints" in table and Arm(name, table).dof in dof]


def pose_errors(T: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and angle [rad] between poses, accurate also for small angles."""
    distance = np.linalg.norm(T[..., :3, 3] - target[..., :3, 3], axis=-1)
    R = np.swapaxes(target[..., :3, :3], -1, -2) @ T[..., :3, :3]
    skew = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    angle = np.arctan2(np.linalg.norm(skew, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return distance, angle


def _origin(joint: dict) -> np.ndarray:
    roll, pitch, yaw = joint["rpy"]
    T = np.eye(4)
    T[:3, :3] = _turn([0, 0, 1], yaw) @ _turn([0, 1, 0], pitch) @ _turn([1, 0, 0], roll)
    T[:3, 3] = joint["xyz"]
    return T


def _motion(joint: dict, value: np.ndarray) -> np.ndarray:
    T = np.tile(np.eye(4), (len(value), 1, 1))
    axis = np.asarray(joint["axis"], dtype=float) / np.linalg.norm(joint["axis"])
    if joint["type"] == "prismatic":
        T[:, :3, 3] = value[:, None] * axis
    else:
        T[:, :3, :3] = _turn(axis, value)
    return T


def _turn(axis: object, angle: object) -> np.ndarray:
    """Rotation by Rodrigues' formula, for one angle or a row of them."""
    x, y, z = np.asarray(axis, dtype=float)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def _text(values: list) -> str:
    return " ".join(repr(float(value)) for value in values)
