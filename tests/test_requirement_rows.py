"""Every row of the source reports that is done has a test named after it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ROWS = (
    "A1 A2 A3 A4 A5 A6 A7 A8 A9 A10 A11 A12 A13 A14 A15 P1 P2 P3 P4 P5 "
    "B1 B2 B3 B4 B5 B6 B7 B8 B9 B10 B11 B12 B13 B14 B15 B16 B17 C1 C2 C3 C4 C5 C6 C7 C8 C9 C10 C12 C13 C14 D1 D2 D3 D4 D5 D6 D7 D8 D9 D10 D11 "
    "E1 E2 E3 E4 E5 E6 E7 E8 "
    "M1 M2 M3 M4 M5 M6 M7 K1 K3 K4 K5 K6 K7 K8 K10 R1 R2 R3 R4 R7 Y2 Y3 Y5 Y6 U1 U2"
)


@pytest.mark.parametrize("row", ROWS.split(" "))
def test_a_test_is_named_after_the_row(row):
    named = re.compile(rf"def test_(?:\w*_)?{row}(?:_|\b)", re.IGNORECASE)
    assert any(named.search(path.read_text(encoding="utf-8")) for path in TESTS.rglob("test_*.py"))
