"""Every built-in robot once. A new robot is a new row here, and every law that runs over `ROBOTS` then runs on it too."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from pieper.model import catalog
from pieper.model.chain import Chain


class Robot(NamedTuple):
    name: str
    dof: int
    aliases: tuple[str, ...] = ()


ROBOTS = (
    Robot("abb_crb15000", 6, ("crb15000", "gofa")),
    Robot("abb_irb120", 6, ("irb120",)),
    Robot("abb_irb2400", 6, ("irb2400",)),
    Robot("abb_irb6640", 6, ("irb6640",)),
    Robot("fanuc_crx10ia", 6, ("crx10ia",)),
    Robot("fanuc_crx10ia_l", 6, ("crx10ia_l", "crx10ial")),
    Robot("franka_fr3", 7, ("fr3",)),
    Robot("franka_panda", 7, ("panda",)),
    Robot("kinova_gen3_6dof", 6, ("gen3_6dof",)),
    Robot("kinova_gen3_7dof", 7, ("gen3", "gen3_7dof")),
    Robot("kuka_iiwa14", 7, ("iiwa", "iiwa14")),
    Robot("kuka_iiwa14_ros_industrial", 7),
    Robot("kuka_kr210_l150", 6, ("kr210_l150",)),
    Robot("kuka_kr210_robond", 6, ("kr210", "kr210_robond")),
    Robot("kuka_youbot", 5, ("youbot",)),
    Robot("mh12-report", 5),
    Robot("puma560", 6, ("puma",)),
    Robot("so100", 5, ("so_100",)),
    Robot("so101", 5, ("so_101",)),
    Robot("ufactory_xarm6", 6, ("xarm6",)),
    Robot("ufactory_xarm7", 7, ("xarm7",)),
    Robot("ur10", 6),
    Robot("ur10e", 6),
    Robot("ur16e", 6),
    Robot("ur20", 6),
    Robot("ur3", 6),
    Robot("ur30", 6),
    Robot("ur3e", 6),
    Robot("ur5", 6),
    Robot("ur5e", 6),
    Robot("yaskawa_mh12", 6, ("mh12",)),
)
NAMES = tuple(robot.name for robot in ROBOTS)


@cache
def chain(name: str, nominal: bool = False) -> Chain:
    """The chain of a built-in robot, made once; chains are read-only."""
    return catalog.describe(name, nominal=nominal).chain()
