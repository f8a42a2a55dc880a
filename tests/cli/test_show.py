"""How tables are laid out."""

from __future__ import annotations

import io

from rich.console import Console

from pieper.cli.show import print_columns


def test_columns_that_do_not_fit_go_into_the_next_table() -> None:
    out = Console(file=io.StringIO(), width=24)
    print_columns(
        out, "answer", ["elbow", "wrist"], [["1", "10.5", "-3"], ["2", "7.0", "100.0"], ["3", "0", "0"]], title="deg"
    )
    lines = out.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert lines == [
        "deg",
        "answer     1      2",
        "elbow   10.5    7.0",
        "wrist     -3  100.0",
        "",
        "answer  3",
        "elbow   0",
        "wrist   0",
        "",
    ]
    assert max(map(len, lines)) <= 24


def test_a_column_wider_than_the_screen_is_not_cut() -> None:
    out = Console(file=io.StringIO(), width=10)
    print_columns(out, "joint", ["a"], [["1", "x" * 30]])
    assert "x" * 30 in out.file.getvalue()  # type: ignore[attr-defined]
