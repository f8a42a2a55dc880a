"""Labels in any alphabet: with a font that has their letters, or with a word about the boxes."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from pieper.errors import PieperWarning

pytest.importorskip("PIL", reason="Pillow is not installed")
from PIL import Image, ImageDraw, ImageFont

from pieper.sim import font as fonts
from pieper.sim.font import font_for
from pieper.sim.scene_view import captioned

NOWHERE = "\U0010fffd"  # in no font


@pytest.fixture(autouse=True)
def _forgotten():
    font_for.cache_clear()
    yield
    font_for.cache_clear()


def has(name):
    try:
        return bool(ImageFont.truetype(name, 12.0))
    except OSError:
        return False


@pytest.mark.parametrize("words", ["", "tool0", "shoulder pan 12.5 deg"])
def test_latin_is_drawn_in_the_usual_font(words):
    assert font_for(words, 12.0).getname() == ImageFont.load_default(12.0).getname()


@pytest.mark.skipif(not has("DejaVuSans.ttf"), reason="this machine has no DejaVu Sans")
def test_letters_that_the_usual_font_lacks_come_from_another():
    assert font_for("захват", 20.0).getname()[0] == "DejaVu Sans"
    pictures = {letter: np.array(captioned(np.zeros((200, 200, 3), np.uint8), letter)) for letter in "зжд"}
    assert (pictures["з"] != pictures["ж"]).any()  # boxes would be alike
    assert (pictures["ж"] != pictures["д"]).any()


def test_letters_that_no_font_has_are_told_once(monkeypatch):
    monkeypatch.setattr(fonts, "FALLBACKS", ("there is no such font.ttf",))
    with pytest.warns(
        PieperWarning,
        match="no font found here has the letters 手 of 'arm 手', and they are drawn as boxes; install one",
    ):
        font_for("arm 手", 12.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert font_for("arm 手", 12.0).getname() == ImageFont.load_default(12.0).getname()


def test_the_box_of_a_missing_letter_is_known():
    usual = ImageFont.load_default(12.0)
    assert fonts._missing(usual, {"a", "手", NOWHERE}) == {"手", NOWHERE}
    canvas = Image.new("L", (40, 40))
    ImageDraw.Draw(canvas).text((5, 5), "手", font=usual, fill=255)
    assert np.array(canvas).any()  # a box, and not nothing
