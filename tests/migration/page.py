"""docs/guides/coming_from.md as data: its sections, their code, and the lines of their tables."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "coming_from.md"
EQUIVALENTS = ("You write", "In Pieper", "How they agree")
COMPLAINTS = ("You pass", "It says")
NOT_TESTED = "not run"
OURS_ALONE = "ours runs"

HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
BLOCK = re.compile(r"^```(python|py)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TABLE = re.compile(r"(?:^\|.*\|\n)+", re.MULTILINE)
CODE = re.compile(r"(`+)(.+?)\1(?!`)")
RELATION = re.compile(r"\*\*([a-z ]+?)(?: to ([0-9.e-]+))?\*\*")


@dataclass(frozen=True)
class Line:
    """One line of a table: what is written there, what is written here, and how the two agree."""

    section: str
    number: int
    theirs: str
    ours: str
    relation: str
    tolerance: float | None

    def __str__(self) -> str:
        return f"{self.section}-{self.number}"

    @property
    def is_tested(self) -> bool:
        return self.relation != NOT_TESTED


@dataclass(frozen=True)
class Section:
    """One package: its name, its text, the code of its blocks by language, and the lines of its table."""

    name: str
    text: str
    blocks: tuple[tuple[str, str], ...]
    lines: tuple[Line, ...]


def rows_of(text: str, head: tuple[str, ...]) -> list[list[str]]:
    """The cells of every row of the tables with this head. A cell that holds a bar would have to be split: none may."""
    found = []
    for table in TABLE.findall(text):
        rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
        if tuple(rows[0]) == head:
            assert all(len(row) == len(head) for row in rows), f"a row of other than {len(head)} cells in {table}"
            found += rows[2:]
    return found


def code_of(cell: str) -> str:
    """The statements of a cell, one in each pair of backticks."""
    return "\n".join(code for _, code in CODE.findall(cell))


def lines_of(name: str, text: str) -> tuple[Line, ...]:
    """The lines of the table of a section; a word of relation stands first in each last cell."""
    found = []
    for number, (theirs, ours, note) in enumerate(rows_of(text, EQUIVALENTS), start=1):
        relation = RELATION.match(note)
        assert relation is not None, f"{name}: no relation at the start of {note!r}"
        tolerance = None if relation[2] is None else float(relation[2])
        found.append(Line(name, number, code_of(theirs), code_of(ours), relation[1], tolerance))
    return tuple(found)


def sections() -> dict[str, Section]:
    """Every section by its name, the text before the first one as ''."""
    text = PAGE.read_text(encoding="utf-8")
    names = ["", *HEADING.findall(text)]
    parts = HEADING.split(text)[::2]
    return {
        name: Section(name, part, tuple(BLOCK.findall(part)), lines_of(name, part))
        for name, part in zip(names, parts, strict=True)
    }


def value_of(code: str, namespace: dict[str, Any], where: str) -> Any:
    """What the last statement of `code` gives, be it an expression or an assignment to one name."""
    tree = ast.parse(code)
    *before, last = tree.body
    exec(compile(ast.Module(before, []), where, "exec"), namespace)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), where, "eval"), namespace)
    exec(compile(ast.Module([last], []), where, "exec"), namespace)
    assert isinstance(last, ast.Assign), f"{where}: the last statement must have a value"
    assert isinstance(last.targets[0], ast.Name), f"{where}: the last statement must name one value"
    return namespace[last.targets[0].id]
