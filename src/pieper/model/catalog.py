"""The built-in robots: names, short aliases, and the tables that each was read from.

Every robot is one JSON file in ``robots/``: joint origins and axes as its public description states them, limits, and
where the numbers come from. The origin of a joint is ``Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)`` with ``rpy`` in radians,
the convention of URDF. Some descriptions print 1.5708 where a quarter turn is meant: ``rpy`` keeps the printed value and
``rpy_nominal`` holds the exact multiple of pi/4.
"""

from __future__ import annotations

import json
from functools import lru_cache
from math import cos, inf, pi, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import unknown_name
from pieper.model.description import Description, Joint, Link

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.model.dh import DhTable

FloatArray = NDArray[np.float64]

_FOLDER = Path(__file__).parent / "robots"

ALIASES: dict[str, str] = {
    "crb15000": "abb_crb15000",
    "gofa": "abb_crb15000",
    "irb120": "abb_irb120",
    "irb2400": "abb_irb2400",
    "irb6640": "abb_irb6640",
    "crx10ia": "fanuc_crx10ia",
    "crx10ia_l": "fanuc_crx10ia_l",
    "crx10ial": "fanuc_crx10ia_l",
    "fr3": "franka_fr3",
    "panda": "franka_panda",
    "gen3": "kinova_gen3_7dof",
    "gen3_6dof": "kinova_gen3_6dof",
    "gen3_7dof": "kinova_gen3_7dof",
    "iiwa": "kuka_iiwa14",
    "iiwa14": "kuka_iiwa14",
    "kr210": "kuka_kr210_robond",
    "kr210_l150": "kuka_kr210_l150",
    "kr210_robond": "kuka_kr210_robond",
    "youbot": "kuka_youbot",
    "puma": "puma560",
    "so_100": "so100",
    "so_101": "so101",
    "xarm6": "ufactory_xarm6",
    "xarm7": "ufactory_xarm7",
    "mh12": "yaskawa_mh12",
}
"""Short names and the robots that they stand for; names and aliases may be typed with ``-``, spaces or capitals too."""

_QUARTER = 0.5 * pi


@lru_cache(maxsize=1)
def names() -> tuple[str, ...]:
    """The built-in robots in alphabetical order.

    >>> "ur5e" in names(), "mh12-report" in names()
    (True, True)
    """
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.json")))


def find(name: str) -> str:
    """The built-in robot that a name or an alias stands for.

    Raises
    ------
    UnknownNameError
        The message has the near matches first.

    Examples
    --------
    >>> find("mh12"), find("KR210"), find("UR5e")
    ('yaskawa_mh12', 'kuka_kr210_robond', 'ur5e')
    """
    if isinstance(name, str):
        typed = _plain(name)
        for known in names():
            if _plain(known) == typed:
                return known
        if typed in ALIASES:
            return ALIASES[typed]
    raise unknown_name("robot", str(name), sorted({*names(), *ALIASES}))


def record(name: str) -> dict[str, Any]:
    """Everything that is kept about a built-in robot: joints, source and licence, remarks, dimensions, DH rows.

    Parameters
    ----------
    name : str
        A name or an alias.

    Returns
    -------
    dict
        A fresh copy. Always there: ``name``, ``title``, ``base``, ``tip``, ``source`` (with ``licence``), and either
        ``joints`` or ``screws``. Lengths in metres, angles in radians unless the key ends in ``_deg``.

    Raises
    ------
    UnknownNameError

    Examples
    --------
    >>> record("ur5e")["source"]["licence"]
    'BSD-3-Clause'
    """
    known = find(name)
    data: dict[str, Any] = json.loads((_FOLDER / f"{known}.json").read_text(encoding="utf-8"))
    return data


def describe(name: str, *, nominal: bool = False) -> Description:
    """The description of a built-in robot.

    Parameters
    ----------
    name : str
        A name or an alias.
    nominal : bool
        False: angles as the source prints them, which reproduces its URDF. True: the exact multiples of pi/4 that they
        stand for, so that axes which are meant to be parallel or to intersect do so.

    Returns
    -------
    Description
        With base and tip set.

    Raises
    ------
    UnknownNameError
        The message has the near matches first.

    Examples
    --------
    >>> describe("mh12").chain()
    Chain('yaskawa_mh12', 6 joints, 'base_link' -> 'tool0')
    """
    data = record(name)
    joints = _joints_of_screws(data) if "screws" in data else [_joint(j, nominal) for j in data["joints"]]
    links = [Link(joints[0].parent), *(Link(joint.child) for joint in joints)]
    return Description(
        name=data["name"],
        links=tuple(links),
        joints=tuple(joints),
        source=f"built-in robot {data['name']!r}",
        base=data["base"],
        tip=data["tip"],
    )


def dh_tables(name: str) -> dict[str, DhTable]:
    """The Denavit-Hartenberg tables that are on record for a built-in robot, by label; none for most.

    They are written down, not computed: `pieper.model.dh.as_dh` computes one for any arm.

    Raises
    ------
    UnknownNameError

    Examples
    --------
    >>> sorted(dh_tables("youbot"))
    ['full', 'full_z_down', 'simplified']
    >>> dh_tables("ur5e")
    {}
    """
    from pieper.model.dh import from_record

    data = record(name)
    moving = [joint for joint in data.get("joints", ()) if joint["type"] != "fixed"]
    arm = {
        "name": data["name"],
        "base": data["base"],
        "joint_names": [joint["name"] for joint in moving],
        "limits": [[joint.get("lower", -inf), joint.get("upper", inf)] for joint in moving],
        "max_velocity": [joint.get("velocity", inf) for joint in moving],
        "max_effort": [joint.get("effort", inf) for joint in moving],
    }
    return {label: from_record({**arm, "tip": data["tip"], **table}) for label, table in data.get("dh", {}).items()}


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "_").replace(" ", "_")


def _joint(data: dict[str, Any], nominal: bool) -> Joint:
    rpy = data.get("rpy_nominal", data["rpy"]) if nominal else data["rpy"]
    return Joint(
        name=data["name"],
        type=data["type"],
        parent=data["parent"],
        child=data["child"],
        T_parent_joint=_origin(data["xyz"], rpy),
        axis=data.get("axis", (1.0, 0.0, 0.0)),
        lower=data.get("lower", -inf),
        upper=data.get("upper", inf),
        velocity=data.get("velocity", inf),
        effort=data.get("effort", inf),
    )


def _joints_of_screws(data: dict[str, Any]) -> list[Joint]:
    """Joints with the base axes in every frame, each frame at the given point of its axis, and a fixed tool joint."""
    joints, parent, at = [], data["base"], np.zeros(3)
    for number, screw in enumerate(data["screws"], start=1):
        T = np.eye(4)
        T[:3, 3] = np.asarray(screw["point"]) - at
        limits = {key: screw.get(key, default) for key, default in _NO_LIMITS.items()}
        joints.append(
            Joint(screw["joint"], "revolute", parent, f"link_{number}", T_parent_joint=T, axis=screw["axis"], **limits)
        )
        parent, at = f"link_{number}", at + T[:3, 3]
    home = np.eye(4)
    home[:3, :3] = _from_quaternion(data["home"]["quaternion_xyzw"])
    home[:3, 3] = np.asarray(data["home"]["position"]) - at
    joints.append(Joint(f"{parent}-{data['tip']}", "fixed", parent, data["tip"], T_parent_joint=home))
    return joints


_NO_LIMITS = {"lower": -inf, "upper": inf, "velocity": inf, "effort": inf}


def _origin(xyz: Sequence[float], rpy: Sequence[float]) -> FloatArray:
    """``Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)``, (4, 4). Plain arithmetic: loading a robot needs no SciPy."""
    (sr, cr), (sp, cp), (sy, cy) = map(_sin_cos, rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, xyz[0]],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, xyz[1]],
            [-sp, cp * sr, cp * cr, xyz[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine; exactly 0 and +-1 at the doubles nearest to the multiples of pi/2."""
    quarters = round(angle / _QUARTER)
    if angle == quarters * _QUARTER:
        return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[quarters % 4]
    return sin(angle), cos(angle)


def _from_quaternion(xyzw: Sequence[float]) -> FloatArray:
    """Rotation matrix of a quaternion, normalised first, (3, 3)."""
    q = np.asarray(xyzw, dtype=np.float64)
    x, y, z, w = (float(c) for c in q / np.sqrt(q @ q))
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
