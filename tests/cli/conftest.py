"""The command as a function: what it printed, what it complained about, and its exit code."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from pieper.cli.main import main

if TYPE_CHECKING:
    from collections.abc import Callable


class Result(NamedTuple):
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


@pytest.fixture
def pieper_command(capsys: pytest.CaptureFixture[str]) -> Callable[..., Result]:
    """Run ``pieper ARGUMENTS``; numbers are turned into words."""

    def run(*arguments: object) -> Result:
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return run
