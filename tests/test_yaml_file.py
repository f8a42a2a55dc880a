"""YAML is read with file, line and field in every complaint, and written whole or not at all."""

from __future__ import annotations

import os
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import PieperError, VisionError
from pieper.yaml_file import DEEPEST, LARGEST, Section, as_yaml, parse_yaml, read_yaml, write_yaml


def parsed(text: str) -> Section:
    return parse_yaml(text.encode(), "x.yaml")


plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=12),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@given(
    words=st.lists(st.text(max_size=20), max_size=4),
    number=st.floats(allow_nan=False, allow_infinity=False),
    flag=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_what_is_written_is_read(words, number, flag):
    section = parsed(as_yaml({"words": words, "in": {"number": number, "flag": flag}}))
    assert section.texts("words") == words
    assert section.section("in").number("number") == number
    assert section.section("in").boolean("flag") is flag


@given(st.integers(0, 4), st.integers(1, 4))
@settings(max_examples=20, deadline=None)
def test_arrays_come_back_exactly(rows, columns):
    array = np.random.default_rng(rows).standard_normal((rows, columns)) * 10.0 ** np.arange(-8, 8)[:columns]
    np.testing.assert_array_equal(
        parsed(as_yaml({"a": array})).array("a", (None, columns)).reshape(rows, columns), array
    )


@given(plain)
@settings(max_examples=60, deadline=None)
def test_any_plain_data_can_be_written(data):
    assert "data" in parsed(as_yaml({"data": data}))


@pytest.mark.parametrize(
    ("text", "read", "message"),
    [
        ("a: 1\nb: [1, 2]", lambda s: s.array("b", (3,)), "x.yaml, line 2, b: must be 3 numbers in lists, got 2"),
        ("a:\n  b: [[1, 2], [3]]", lambda s: s.section("a").array("b", (2, 2)), "x.yaml, line 2, a.b: .* rows of different"),
        ("a: [1, x]", lambda s: s.array("a", (2,)), "line 1, a: must be a number, got 'x'"),
        ("a: .nan", lambda s: s.number("a"), "a: must be a finite number, got '.nan'"),
        ("a: 1" + "0" * 400, lambda s: s.number("a"), "a: must be a finite number"),
        ("a: true", lambda s: s.number("a"), "a: must be a number, got True"),
        ("a: 5", lambda s: s.number("a", most=4), "a: must be at most 4, got 5"),
        ("a: -5", lambda s: s.integer("a", least=0, most=9), "a: must be at least 0 and at most 9, got -5"),
        ("a: 1.5", lambda s: s.integer("a"), "a: must be a whole number, got 1.5"),
        ("a: 3", lambda s: s.text("a"), "a: must be text, got 3; put it in quotes"),
        ("a: maybe", lambda s: s.boolean("a"), "a: must be true or false"),
        ("a: 1", lambda s: s.text("b"), "x.yaml, line 1, b: is missing"),
        ("\n\na:\n- b: 1\n- 2", lambda s: s.sections("a"), r"line 5, a\[1\]: must be a section of .*, got '2'"),
        ("a: [1, [2]]", lambda s: s.array("a", (2,)), "line 1, a: must be a number here, got a list"),
        ("a: 1", lambda s: s.array("a", (2,)), "line 1, a: must be a list of numbers, got '1'"),
        ("a: {b: 1}", lambda s: s.number("a"), "line 1, a: must be a (number|single value), got a section"),
        ("a: {}", lambda s: s.texts("a"), r"a: must be a list, as in `- first`, got a section"),
        ("a: [x, 3]", lambda s: s.texts("a"), r"a\[1\]: must be text"),
        ("coler: 1", lambda s: s.only("color", "bits"), "line 1, coler: no field 'coler' .* did you mean 'color'"),
        ("a: 1\na: 2", lambda s: s, "line 2, a: is there twice; leave one of them out"),
        ("a: &x 1\nb: *x", lambda s: s, "line 1: anchors and aliases"),
        ("a: !!python/object:os.system 1", lambda s: s.text("a"), "line 1, a: tags such as"),
        ("a: !!int b", lambda s: s.number("a"), "a: cannot be read as a value: 'b'"),
        ("- 1", lambda s: s, "line 1: must be a section of fields"),
        ("", lambda s: s, "line 1: the file is empty"),
        ("a: 1\n---\nb: 2", lambda s: s, "second document"),
        ("a: 1\nb: [1, 2", lambda s: s, "x.yaml, line [23]: "),
        ("a: 1\n\tb: 2", lambda s: s, "x.yaml, line 2: "),
        ("a: \x00", lambda s: s, "x.yaml, line 1: "),
        ("a: " + "[" * (DEEPEST + 1), lambda s: s, "nested deeper"),
    ],
)  # fmt: skip
def test_complaints_name_file_line_and_field(text, read, message):
    with pytest.raises(VisionError, match=message):
        read(parsed(text))


def test_defaults_stand_in_for_missing_fields():
    section = parsed("a: 1")
    assert section.text("b", None) is None
    assert section.number("b", 3.0) == 3.0
    assert section.sections("b", []) == []
    assert section.array("b", (3,), None) is None


def test_people_may_write_powers_of_ten_and_dates():
    section = parsed("a: 1e-3\ndate: 2026-01-02\nb: [1e3, 2]")
    assert section.number("a") == 1e-3
    assert section.text("date") == "2026-01-02"
    assert section.array("b", (2,)).tolist() == [1000.0, 2.0]


def test_a_large_file_is_refused_before_it_is_read(tmp_path):
    (tmp_path / "x.yaml").write_text("a: 1 # " + "x" * LARGEST)
    with pytest.raises(VisionError, match="larger than"):
        read_yaml(tmp_path / "x.yaml")


def test_bytes_that_are_no_text_are_named_by_line():
    with pytest.raises(VisionError, match=r"x\.yaml, line 2: is not UTF-8"):
        parse_yaml(b"a: 1\nb: \xff", "x.yaml")


def test_a_missing_file_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_yaml(tmp_path / "none.yaml")


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "x.yaml"
    write_yaml(path, {"a": 1}, comment="made by hand\nand kept")
    before = path.read_text()
    assert before.startswith("# made by hand\n# and kept\n")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        write_yaml(path, {"a": 2})
    assert path.read_text() == before
    assert [p.name for p in tmp_path.iterdir()] == ["x.yaml"]


SEED = b"colors:\n  red: {mean: [0.5, 2.0], covariance: [[1, 0], [0, 1e-3]], draw: [0, 0, 255]}\nthreshold: 3.5\ndate: 2026-01-02\n"


def touch_everything(section: Section, draw: random.Random) -> None:
    """Call each reader on each field."""
    readers = (
        section.text, section.boolean, section.integer, section.number, section.texts, section.section, section.sections,
        lambda key: section.array(key, draw.choice([(2,), (2, 2), (None,), (None, 3)])),
    )  # fmt: skip
    for key in list(section):
        for reader in readers:
            try:
                found = reader(key)
            except VisionError:
                continue
            for inner in [found] if isinstance(found, Section) else []:
                touch_everything(inner, draw)


def test_mutated_files_are_read_or_refused_and_nothing_else():
    draw = random.Random(1)
    for _ in range(400):
        raw = bytearray(SEED)
        for _ in range(draw.randint(1, 4)):
            at = draw.randrange(len(raw))
            raw[at : at + draw.randint(0, 3)] = draw.choice([b"", b"[", b"{", b"&a", b"*a", b"!!", b": ", b"\n", b"\xff", b"-", b"'", b"|", b"0x", b"1:2", draw.randbytes(2)])  # fmt: skip
        try:
            section = parse_yaml(bytes(raw), "x.yaml")
        except PieperError:
            continue
        touch_everything(section, draw)


@pytest.mark.parametrize("text", ["a: &x [1]\nb: *x\n", "a: " + "[" * 99, "a: 1\n---\nb: 2\n"])
def test_what_is_refused_names_file_and_line_once(text):
    with pytest.raises(VisionError) as caught:
        parse_yaml(text.encode(), "x.yaml")
    assert str(caught.value).count("x.yaml, line") == 1
