"""What README, docs/benchmarks.md and docs/recall.md say of measurements is what the data say: the scripts write the same again."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"
FEATURES = json.loads((BENCHMARKS / "results" / "features.json").read_text(encoding="utf-8"))
WRITE = (
    "import sys; sys.path.insert(0, sys.argv[1]); import {module}; sys.stdout.buffer.write({module}.page().encode())"
)


def written(module: str) -> str:
    """What a script writes, in a process of its own: its folder stays off our path, and matplotlib as it is."""
    pytest.importorskip("matplotlib")
    command = [sys.executable, "-c", WRITE.format(module=module), str(BENCHMARKS)]
    return subprocess.run(command, check=True, capture_output=True).stdout.decode()


@pytest.mark.parametrize(
    ("module", "page"),
    [
        ("comparison", "README.md"),
        ("table", "docs/benchmarks.md"),
        ("recall_table", "docs/recall.md"),
    ],
)
def test_page_is_what_the_data_say(module: str, page: str) -> None:
    assert written(module) == (ROOT / page).read_text(encoding="utf-8"), f"run: python benchmarks/{module}.py"


def test_a_changed_figure_changes_the_readme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    comparison = importlib.import_module("comparison")
    data = {name: json.loads((BENCHMARKS / "results" / f"{name}.json").read_text()) for name in comparison.QUESTIONS}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert comparison.page(data) == readme
    row = next(row for row in data["single_call"]["jacobian"]["rows"] if row["name"] == "pieper")
    row["nanoseconds"]["median"] = 1234.0
    changed = comparison.page(data)
    assert "| Jacobian, one call | 1.23\u00a0µs | **520\u00a0ns** |" in changed  # a peer that is better is bold
    assert changed.splitlines()[:40] == readme.splitlines()[:40]
    assert changed.endswith(readme[readme.index("<!-- end of comparison -->") :])


def test_every_commit_and_date_of_a_page_is_told() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    told = {line.split("`")[1] for line in page.splitlines() if line.startswith("*20")}
    sections = sum(line.startswith("## ") for line in page.splitlines())
    assert page.count("\n*20") >= sections
    assert all(len(commit.rstrip("+")) == 12 for commit in told)


@pytest.mark.parametrize("row", FEATURES["rows"], ids=lambda row: row["feature"])
def test_what_the_readme_says_we_have_is_there(row: dict) -> None:
    path = row["by"].get("pieper")
    if path is None:
        return
    module, _, names = path.partition(":")
    found = importlib.import_module(module)
    for name in filter(None, names.split(".")):
        found = getattr(found, name)


def test_robots_counted_are_those_that_come_along() -> None:
    from pieper.model import catalog

    assert FEATURES["robots"]["pieper"] == len(catalog.names())
