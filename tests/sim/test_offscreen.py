"""Where nothing can draw, the message says what to install."""

from __future__ import annotations

import sys
import types

import pytest

import pieper
from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.sim import film, offscreen
from pieper.sim.picture import Picture


@pytest.mark.skipif(sys.platform != "linux", reason="the choice of libraries is one of Linux")
@pytest.mark.parametrize(
    ("choice", "packages"), [("", "libegl1 libopengl0 libgl1-mesa-dri, or libosmesa6"), ("osmesa", "libosmesa6")]
)
def test_a_missing_gl_library_is_named_with_its_debian_packages(monkeypatch, choice, packages):
    def missing(name, width, height):
        raise ImportError("cannot open shared object file")

    monkeypatch.setattr(offscreen, "_linux_context", missing)
    monkeypatch.setenv("MUJOCO_GL", choice)
    with pytest.raises(MissingLibraryError, match=f"install Debian's packages {packages} \\(") as caught:
        offscreen.gl_context(16, 16)
    assert "cannot open shared object file" in str(caught.value)


@pytest.mark.parametrize("package", ["mujoco", "PIL", "imageio_ffmpeg"])
def test_a_missing_package_is_named_with_its_extra(monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    needed = {"mujoco": offscreen.import_mujoco, "PIL": offscreen.import_pillow, "imageio_ffmpeg": film._ffmpeg}
    with pytest.raises(MissingExtraError, match=r"is not installed; .* needs it: pip install 'pieper\[sim\]'"):
        needed[package]()


def test_a_mujoco_that_does_not_load_is_said(monkeypatch):
    class Broken:
        def find_spec(self, name, path=None, target=None):
            if name == "mujoco":
                raise RuntimeError("invalid value for environment variable MUJOCO_GL: x11")

    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(MissingLibraryError, match=r"mujoco is installed but does not load: invalid value .* x11"):
        offscreen.import_mujoco()


@pytest.mark.skipif(sys.platform != "linux", reason="the choice of libraries is one of Linux")
def test_a_gl_library_that_does_not_start_is_named_and_no_more(monkeypatch):
    """MuJoCo's contexts clean up after themselves with an attribute that they lack when they have failed."""

    class GLContext:
        def __init__(self, width, height):
            raise RuntimeError("no such display")

        def __del__(self):  # what it raises is a warning, and so fails the test
            assert not self._context

    module = types.ModuleType("mujoco.osmesa")
    module.GLContext = GLContext
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", module)
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(MissingLibraryError, match=r"libosmesa6 \(osmesa: no such display\)"):
        offscreen.gl_context(16, 16)


@pytest.mark.usefixtures("can_draw")
def test_graphics_memory_is_freed_when_drawing_fails(monkeypatch):
    freed = []
    real = offscreen.gl_context

    def watched(width, height):
        context = real(width, height)
        free = context.free
        context.free = lambda: (freed.append(True), free())
        return context

    monkeypatch.setattr(offscreen, "gl_context", watched)
    picture = Picture(size=(64, 64))
    picture.add_arm(pieper.load("ur5e"), [0.0] * 6)
    picture.image()
    assert len(freed) == 1
    monkeypatch.setattr(offscreen.Offscreen, "draw", lambda self: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        picture.image()
    assert len(freed) == 2
