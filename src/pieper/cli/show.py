"""How the verbs print: tables in plain columns, and JSON that scripts can rely on."""

from __future__ import annotations

import json
import math
import sys
from textwrap import wrap
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console


def console() -> Console:
    """Standard output; colours on a terminal only, 80 columns where the width is not known."""
    from rich.console import Console

    return Console(file=sys.stdout, highlight=False, soft_wrap=False)


def say(words: str, style: str | None = None) -> None:
    """One sentence on standard output, as long as it is."""
    console().print(words, style=style, markup=False, highlight=False, soft_wrap=True)


def written(path: Path, *, json: bool) -> None:
    """Say that a file was written, unless standard output is for JSON."""
    if not json:
        say(f"wrote {path}")


def print_table(out: Console, headings: Sequence[str], rows: Iterable[Sequence[str]], *, title: str = "") -> None:
    """Print rows under headings, see `table_lines`."""
    if title:
        out.print(title, style="bold", markup=False)
    for line_number, line in enumerate(table_lines(headings, rows, out.width)):
        out.print(line, style=None if line_number else "dim", markup=False, no_wrap=True, overflow="ignore", crop=False)


def print_columns(
    out: Console, heading: str, labels: Sequence[str], columns: Sequence[Sequence[str]], *, title: str = ""
) -> None:
    """Print columns side by side, each under its first cell, in as many tables as the width of the screen asks for."""
    broadest = max(len(cell) for column in columns for cell in column) + 2
    across = max(1, (out.width - max(map(len, [heading, *labels]))) // broadest)
    for first in range(0, len(columns), across):
        block = columns[first : first + across]
        rows = [[label, *(column[k] for column in block)] for k, label in enumerate(labels, start=1)]
        print_table(out, [heading, *(">" + column[0] for column in block)], rows, title=title if not first else "")
        out.print()


def table_lines(headings: Sequence[str], rows: Iterable[Sequence[str]], width: int = 80) -> list[str]:
    """Rows under headings, two spaces apart; a heading that begins with ``>`` is of a column set to the right.

    Nothing is cut: only the last column, if it is set to the left, is wrapped to the width of the screen.

    >>> for line in table_lines(["joint", ">deg"], [["elbow", "90.0"], ["wrist_1", "-5.0"]]):
    ...     print(line)
    joint     deg
    elbow    90.0
    wrist_1  -5.0
    """
    cells = [[heading.removeprefix(">") for heading in headings], *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(headings))]
    right = [heading.startswith(">") for heading in headings]
    start = sum(widths[:-1]) + 2 * (len(widths) - 1)
    lines = []
    for row in cells:
        parts = [text.rjust(w) if r else text.ljust(w) for text, w, r in zip(row, widths, right, strict=True)]
        last = [parts[-1]] if right[-1] else wrap(row[-1], max(20, width - start)) or [""]
        lines.append("  ".join([*parts[:-1], last[0]]).rstrip())
        lines += [" " * start + more for more in last[1:]]
    return lines


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on standard output; arrays as lists, numbers in full, null for what is infinite or unknown."""
    sys.stdout.write(json.dumps(plain(value), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """The value in types that JSON has.

    >>> import numpy as np
    >>> plain({"limits": np.array([[-1.0, np.inf]]), "ok": np.bool_(True)})
    {'limits': [[-1.0, None]], 'ok': True}
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def number(value: float, digits: int = 6) -> str:
    """A fixed number of decimals, without a minus before zero; ``-`` for what is infinite or unknown.

    >>> number(1.25, 3), number(-1e-9, 3), number(float("inf"))
    ('1.250', '0.000', '-')
    """
    if not math.isfinite(value):
        return "-"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def numbers(values: Iterable[float], digits: int = 6, width: int = 0) -> str:
    """Several numbers in one line, each `width` characters wide."""
    return "  ".join(number(value, digits).rjust(width) for value in values)


def small(value: float, unit: str) -> str:
    """An error as a person reads it: three figures at most.

    >>> small(3.14e-13, "m"), small(0.0, "m"), small(1.03712, "m")
    ('3.14e-13 m', '0 m', '1.04 m')
    """
    if not math.isfinite(value):
        return "-"
    return f"{value:.3g} {unit}"


def gauge(value: float, lower: float, upper: float, width: int = 13) -> str:
    """Where a joint stands between its limits, drawn in plain characters; empty for a joint without limits.

    >>> gauge(0.0, -1.0, 1.0, 7), gauge(2.0, -1.0, 1.0, 7)
    ('[--|--]', '[-----]!')
    """
    if not (math.isfinite(lower) and math.isfinite(upper) and math.isfinite(value)) or lower >= upper:
        return ""
    inside = width - 2
    if not lower <= value <= upper:
        return ("!" if value < lower else "") + "[" + "-" * inside + "]" + ("!" if value > upper else "")
    at = min(inside - 1, int((value - lower) / (upper - lower) * inside))
    return "[" + "-" * at + "|" + "-" * (inside - 1 - at) + "]"


def matrix(T: NDArray[np.float64], digits: int = 6) -> str:
    """A matrix, one row a line."""
    return "\n".join("  " + numbers(row, digits, digits + 4) for row in T.tolist())
