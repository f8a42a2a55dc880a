"""What became of the cycles of a task, kept in a file, a line of JSON for each: whoever was interrupted goes on where the file ends."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.atomic_file import check_place
from pieper.errors import PieperError

if TYPE_CHECKING:
    import os

    from pieper.tasks.pick import Cycle, Stage


class PickLog:
    """A log of one task with one seed.

    Parameters
    ----------
    path : path
        Lines are added to it; it is made when it is not there.
    task : str
        Name of the task.
    seed : int
    version : str
        What else the cycles depend on, such as the text of the task's file and the planner; only its checksum is written.

    Attributes
    ----------
    done : list of Cycle
        What the file held.

    Raises
    ------
    PieperError
        The file holds something else, or cycles of another task, version or seed.
    OSError
        It cannot be read, or not be written.
    """

    def __init__(self, path: str | os.PathLike[str], task: str, seed: int, *, version: str = "") -> None:
        self.path, self.task, self.seed = Path(path), task, seed
        self.version = hashlib.sha256(version.encode()).hexdigest()[:16]
        self.done: list[Cycle] = []
        self._before = ""
        if self.path.exists():
            self._read()
        else:
            check_place(self.path)

    def add(self, cycle: Cycle, stages: list[Stage]) -> None:
        """Write a cycle with its stages."""
        record = {
            "task": self.task,
            "seed": self.seed,
            "version": self.version,
            **cycle._asdict(),
            "stages": [
                {"name": s.name, "outcome": s.outcome, "reason": s.reason, "start": s.start, "end": s.end}
                for s in stages
            ],
        }
        with self.path.open("a", encoding="utf-8") as lines:
            lines.write(self._before + json.dumps(record) + "\n")
        self._before = ""

    def _read(self) -> None:
        from pieper.tasks.pick import Cycle

        whole = self.path.read_text(encoding="utf-8", errors="replace")
        if whole and not whole.endswith("\n"):
            self._before = "\n"
        for number, line in enumerate(whole.splitlines(), start=1):
            record = self._record(line, number)
            if record.get("version") != self.version and record["task"] == self.task:
                raise PieperError(
                    f"{self.path}: line {number} is of the task {self.task!r} as it was before it was changed, or with another planner; give "
                    "another file"
                )
            if (record["task"], record["seed"]) != (self.task, self.seed):
                raise PieperError(
                    f"{self.path}: line {number} is of task {record['task']!r} with seed {record['seed']!r}, not of {self.task!r} with seed "
                    f"{self.seed}; give another file"
                )
            self.done.append(Cycle(*(record[key] for key in Cycle._fields)))

    def _record(self, line: str, number: int) -> dict[str, Any]:
        from pieper.tasks.pick import Cycle

        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            record = None
        wanted: dict[str, Any] = {
            "number": int,
            "target": str,
            "placed": bool,
            "attempts": int,
            "reason": str,
            "duration": (int, float),
        }
        if (
            not isinstance(record, dict)
            or not {"task", "seed", *Cycle._fields} <= record.keys()
            or not all(isinstance(record[key], kind) for key, kind in wanted.items())
            or record["number"] != number
        ):
            if self._before and number > 1 and not line.endswith("}"):
                raise PieperError(
                    f"{self.path}: line {number}, the last one, is cut off; remove it, and the log goes on from there"
                )
            raise PieperError(
                f"{self.path}: line {number} is not cycle {number} of a pick log; give another file, or remove this one"
            )
        return record
