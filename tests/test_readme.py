"""The first screen of the README: a sentence, a film, two commands, eight lines, and where to go."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LARGEST, LONGEST, SHORTEST = 3e6, 12.0, 8.0  # bytes and seconds: it loads at once and is watched to its end


def test_first_screen_is_in_its_order() -> None:
    parts = ("# Pieper\n\nKinematics", "![", "```bash\n./run", "```python\nimport pieper", "| You want to | Open |", "<!-- comparison:")  # fmt: skip
    places = [README.index(part) for part in parts]
    assert places == sorted(places)


def test_two_commands_are_there() -> None:
    block = re.search(r"```bash\n(.*?)```", README, re.DOTALL)
    assert block is not None
    programs = [line.split()[0] for line in block[1].splitlines()]
    assert len(programs) == 2
    assert all(os.access(ROOT / program, os.X_OK) for program in programs)


def test_eight_lines_load_an_arm_and_get_every_solution() -> None:
    block = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert block is not None
    assert len([line for line in block[1].splitlines() if line.strip()]) == 8
    assert "pieper.load(" in block[1]
    assert "arm.ik(" in block[1]


def test_film_is_small_short_and_loops() -> None:
    pillow = pytest.importorskip("PIL.Image")
    shown = re.search(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert shown is not None
    path = ROOT / shown[1]
    assert path.stat().st_size <= LARGEST
    with pillow.open(path) as film:
        assert film.size == (800, 450)
        assert film.is_animated
        assert film.info["loop"] == 0  # for ever
        milliseconds = 0
        for k in range(film.n_frames):
            film.seek(k)
            film.load()
            milliseconds += film.info["duration"]
    assert SHORTEST <= milliseconds / 1e3 <= LONGEST
