"""OpenCV that is not there, and OpenCV that is there and does not load."""

from __future__ import annotations

import sys

import pytest

from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.perception.opencv import opencv


class Finder:
    """Says of cv2 what is given to it."""

    def __init__(self, error):
        self.error = error

    def find_spec(self, name, path=None, target=None):
        if name == "cv2":
            raise self.error
        return


def asked(monkeypatch, error):
    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Finder(error), *sys.meta_path])
    return opencv("reading a video")


def test_what_is_not_installed_names_the_extra(monkeypatch):
    with pytest.raises(
        MissingExtraError,
        match=r"OpenCV is not installed; reading a video needs it: pip install 'pieper\[perception\]'",
    ):
        asked(monkeypatch, ModuleNotFoundError("No module named 'cv2'", name="cv2"))


@pytest.mark.parametrize(
    "error",
    [
        ImportError("libGL.so.1: cannot open shared object file"),
        OSError("libGL.so.1: cannot open shared object file"),
        ModuleNotFoundError("No module named 'libGL.so.1: cannot open shared object file'", name="libGL"),
    ],
)
def test_what_is_installed_and_broken_says_why(monkeypatch, error):
    with pytest.raises(
        MissingLibraryError, match=r"OpenCV is installed but does not load.*libGL\.so\.1: cannot open.*install it anew"
    ) as caught:
        asked(monkeypatch, error)
    assert "not installed" not in str(caught.value)
