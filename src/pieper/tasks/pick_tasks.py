"""The pick-and-place tasks that come with the package: the KR210 at its shelf, and the same for other arms by other files alone."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

from pieper.errors import unknown_name
from pieper.tasks.pick_file import parse_pick_task

if TYPE_CHECKING:
    from pieper.tasks.pick import PickTask

_NAMES = ("kr210", "ur10e", "mh12", "youbot")


def names() -> tuple[str, ...]:
    """Names of the arms that have a task."""
    return _NAMES


def task_file(name: str) -> bytes:
    """The YAML file of a task, to change a copy of it.

    Raises
    ------
    UnknownNameError
        There is none for that arm.

    Examples
    --------
    >>> task_file("mh12").decode().splitlines()[2]
    'arm: mh12'
    """
    key = name.lower()
    if key not in _NAMES:
        raise unknown_name("pick task", name, _NAMES)
    return files("pieper.tasks").joinpath("scenes", f"{key}.yaml").read_bytes()


def task(name: str = "kr210") -> PickTask:
    """The task of an arm.

    Parameters
    ----------
    name : str
        One of `names`.

    Raises
    ------
    UnknownNameError
        There is none for that arm.

    Examples
    --------
    >>> from pieper.sim.scene import at
    >>> kr210 = task("kr210")
    >>> len(kr210.targets), kr210.grasp_at(at(2.6, 0.9, 0.811))[:3, 3].round(3)
    (9, array([2.4  , 0.9  , 0.811]))
    """
    return parse_pick_task(task_file(name), f"{name.lower()}.yaml")
