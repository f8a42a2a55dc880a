"""The values that a shell offers when the Tab key is pressed; each is asked of the room that knows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

import typer


def _words_of(module: str, name: str) -> Callable[[], list[str]]:
    """What offers the words of a tuple or the keys of a mapping, which is imported when it is asked for."""

    def words() -> list[str]:
        try:
            found: Iterable[Any] = getattr(import_module(module), name)
        except Exception:  # noqa: BLE001  a shell that asks for words has no use for a traceback, nor for a sentence
            return []
        return [str(word) for word in found]

    return words


scenes = _words_of("pieper.perception.scene_presets", "PRESETS")
patterns = _words_of("pieper.perception.pattern", "BUILT_IN")
spaces = _words_of("pieper.perception.color_space", "SPACES")
quantities = _words_of("pieper.workspace.map", "UNITS")
views = _words_of("pieper.sim.stage", "VIEWS")
themes = _words_of("pieper.sim.stage", "THEMES")
planners = _words_of("pieper.tasks.pick", "PLANNERS")
modes = _words_of("pieper.ros.launch", "MODES")
qualities = _words_of("pieper.ros.topics", "QUALITIES")
backends = _words_of("pieper.ros.backends", "BACKENDS")
storages = _words_of("pieper.ros.bags", "STORAGES")
methods = _words_of("pieper.cli.track", "METHODS")


def robots() -> list[str]:
    """Every built-in robot, by its full and its short names."""
    from pieper.model import catalog

    return sorted({*catalog.names(), *catalog.ALIASES})


def tables() -> list[str]:
    """The robots, and the tables on record: ``kr210:report``."""
    from pieper.model import catalog

    return robots() + [f"{name}:{label}" for name in robots() for label in catalog.dh_tables(name)]


def universal_robots() -> list[str]:
    """Those of Universal Robots, by their short names."""
    return [name for name in robots() if name.startswith("ur") and "_" not in name]


def pick_arms() -> list[str]:
    """The arms that pick."""
    return ["kr210", "ur10e", "mh12", "youbot"]


def field_lines() -> list[str]:
    """The fields whose lines are known."""
    return ["vsss", "ssl-a", "ssl-b"]


def mounts() -> list[str]:
    """Where a camera can be."""
    return ["hand", "cell"]


def drawings() -> list[str]:
    """What ``render --dh`` draws."""
    return ["standard", "modified", "hayati", "simplified", "full", "full_z_down"]


def colors(context: typer.Context) -> list[str]:
    """The colours of the file that ``--colors`` names."""
    from pieper.perception.color import ColorModel

    try:
        return list(ColorModel.load(context.params["colors"]).names)
    except Exception:  # noqa: BLE001  not typed yet, or no such file: nothing is offered
        return []
