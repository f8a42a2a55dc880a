"""How far a verb is: a bar on standard error, where that is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """A bar for as long as the work goes on.

    Gives ``advance(done, of=None, words="")``: how many of how many are done, and what is said beside it.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    screen = Console(stderr=True)
    beside = TextColumn("{task.fields[words]}")
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), beside, TimeRemainingColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(what, total=total, words="")

        def advance(done: int, of: int | None = None, words: str = "") -> None:
            bar.update(task, completed=done, total=total if of is None else of, words=words)

        yield advance
