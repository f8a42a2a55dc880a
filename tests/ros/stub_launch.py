"""As much of ``launch`` and ``launch_ros`` as launch files need, so that they can be tried where there is no ROS.

What it checks is what ROS would complain about: arguments that are not declared, choices, conditions that are no booleans,
files that are not there. It is written after the documentation of launch (Jazzy), and starts nothing.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROS2 = Path(__file__).parents[2] / "ros2"


class LaunchError(Exception):
    """What ROS would say of a launch file or its arguments."""


@dataclass
class Context:
    """The values of the launch arguments, and what was started."""

    arguments: dict[str, str]
    declared: dict[str, DeclareLaunchArgument] = field(default_factory=dict)
    started: list[Started] = field(default_factory=list)


@dataclass
class Started:
    """A process that would have been started."""

    package: str
    executable: str
    name: str | None
    arguments: list[str]
    parameters: list[Any]
    remappings: list[tuple[str, str]]


def perform(what: Any, context: Context) -> str:
    if isinstance(what, list | tuple):
        return "".join(perform(part, context) for part in what)
    if isinstance(what, str):
        return what
    return what.perform(context)


class LaunchDescription:
    def __init__(self, entities):
        self.entities = list(entities)


class DeclareLaunchArgument:
    def __init__(self, name, *, default_value=None, description=None, choices=None):
        assert description, f"argument {name} has no description"
        self.name, self.default, self.choices = name, default_value, choices

    def visit(self, context):
        if self.name not in context.arguments:
            if self.default is None:
                raise LaunchError(f"required argument {self.name!r} is missing")
            context.arguments[self.name] = perform(self.default, context)
        if self.choices is not None and context.arguments[self.name] not in self.choices:
            raise LaunchError(f"{self.name}:={context.arguments[self.name]} is not one of {self.choices}")
        context.declared[self.name] = self


class PythonLaunchDescriptionSource:
    def __init__(self, path):
        self.path = path


class IncludeLaunchDescription:
    def __init__(self, source, *, launch_arguments=()):
        self.source, self.arguments = source, list(launch_arguments)

    def visit(self, context):
        arguments = {name: perform(value, context) for name, value in self.arguments}
        inner = Context(arguments)
        _visit(Path(perform(self.source.path, context)), inner)
        if unknown := arguments.keys() - inner.declared.keys():
            raise LaunchError(f"included with arguments that are not declared: {sorted(unknown)}")
        context.started += inner.started


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        if self.name not in context.declared:
            raise LaunchError(f"launch configuration {self.name!r} does not exist")
        return context.arguments[self.name]


class PathJoinSubstitution:
    def __init__(self, parts):
        self.parts = list(parts)

    def perform(self, context):
        return str(Path(*(perform(part, context) for part in self.parts)))


class PythonExpression:
    def __init__(self, parts):
        self.parts = list(parts)

    def perform(self, context):
        return str(eval(perform(self.parts, context)))


class IfCondition:
    def __init__(self, predicate):
        self.predicate = predicate

    def holds(self, context):
        text = perform(self.predicate, context).strip().lower()
        if text not in ("true", "1", "false", "0"):
            raise LaunchError(f"a condition must be true or false, got {text!r}")
        return text in ("true", "1")


class UnlessCondition(IfCondition):
    def holds(self, context):
        return not super().holds(context)


class FindPackageShare:
    def __init__(self, package):
        self.package = package

    def perform(self, context):
        folder = ROS2 / self.package  # what is installed has the folders of the source
        if not (folder / "package.xml").is_file():
            raise LaunchError(f"package {self.package!r} not found")
        return str(folder)


class Node:
    def __init__(
        self,
        *,
        package,
        executable,
        name=None,
        arguments=(),
        parameters=(),
        remappings=(),
        output="log",
        condition=None,
    ):
        assert output in ("log", "screen", "both")
        self.words = (package, executable, name)
        self.arguments, self.parameters, self.remappings = arguments, parameters, remappings
        self.condition = condition

    def visit(self, context):
        if self.condition is not None and not self.condition.holds(context):
            return
        package, executable, name = self.words
        parameters = []
        for given in self.parameters:
            if isinstance(given, dict):
                parameters.append({key: perform(value, context) for key, value in given.items()})
                continue
            parameters.append(Path(perform(given, context)))
            if not parameters[-1].is_file():
                raise LaunchError(f"{parameters[-1]} is not there")
        context.started.append(
            Started(
                package,
                executable,
                name,
                [perform(argument, context) for argument in self.arguments],
                parameters,
                list(self.remappings),
            )
        )


_MODULES = {
    "launch": [LaunchDescription],
    "launch.actions": [DeclareLaunchArgument, IncludeLaunchDescription],
    "launch.conditions": [IfCondition, UnlessCondition],
    "launch.launch_description_sources": [PythonLaunchDescriptionSource],
    "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution, PythonExpression],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.substitutions": [FindPackageShare],
}


def run(file: Path, **arguments: str) -> tuple[list[Started], dict[str, DeclareLaunchArgument]]:
    """Build the description of a launch file; what it would start, and the arguments that it declares."""
    context = Context(dict(arguments))
    with pytest.MonkeyPatch.context() as patch:
        for name, content in _MODULES.items():
            module = ModuleType(name)
            for kind in content:
                setattr(module, kind.__name__, kind)
            patch.setitem(sys.modules, name, module)
        _visit(file, context)
    if unknown := arguments.keys() - context.declared.keys():
        raise LaunchError(f"no launch arguments {sorted(unknown)}; there are: {sorted(context.declared)}")
    return context.started, context.declared


def _visit(file: Path, context: Context) -> None:
    if not file.is_file():
        raise LaunchError(f"{file} is not there")
    namespace: dict[str, Any] = {"__name__": file.stem}
    exec(compile(file.read_text(encoding="utf-8"), str(file), "exec"), namespace)
    for entity in namespace["generate_launch_description"]().entities:
        entity.visit(context)
