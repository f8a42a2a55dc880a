"""The stages of a pick-and-place cycle, and what became of them."""

from __future__ import annotations

from typing import NamedTuple

STAGES = (
    "plan to pre-grasp",
    "inverse kinematics",
    "move",
    "reach",
    "close gripper",
    "retract",
    "move to bin",
    "release",
    "next target",
)
"""Of a cycle, in order. ``recover`` comes between when a grasp was lost."""


class Stage(NamedTuple):
    """What became of a stage: which `cycle` (from 1) and `target`, its `name`, whether it `succeeded`, why not, and from when to when [s]."""

    cycle: int
    target: str
    name: str
    succeeded: bool
    reason: str
    start: float
    end: float

    @property
    def outcome(self) -> str:
        """``SUCCEEDED`` or ``FAILED``."""
        return "SUCCEEDED" if self.succeeded else "FAILED"

    def __str__(self) -> str:
        line = f"{self.end:8.2f} s  cycle {self.cycle:<3d} {self.target:<10s} {self.name:<18s} {self.outcome}"
        return f"{line}  {self.reason}" if self.reason else line


class Cycle(NamedTuple):
    """What became of a cycle: its `number` from 1, its `target`, whether it was `placed`, `attempts`, the `reason` if not, and `duration` [s]."""

    number: int
    target: str
    placed: bool
    attempts: int
    reason: str
    duration: float
