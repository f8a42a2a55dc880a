"""Every example runs by itself, says something, and warns of nothing."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
DRAWN = ("12_picture", "21_see_and_reach")  # these draw pictures without a screen


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda p: p.name)
def test_example_runs(example: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if example.stem in DRAWN:
        request.getfixturevalue("can_draw")
    result = subprocess.run(
        [sys.executable, "-W", "error", str(example)],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip()
    assert not result.stderr


def test_the_list_of_examples_has_each_with_its_own_words() -> None:
    listed = (EXAMPLES[0].parent / "README.md").read_text(encoding="utf-8").splitlines()
    for example in EXAMPLES:
        words = ast.get_docstring(ast.parse(example.read_text(encoding="utf-8"))) or ""
        said = " ".join(words.partition("\n\n")[0].split())
        assert f"| [{example.stem}]({example.name}) | {said} |" in listed
