"""OpenGL without a screen: a context from EGL or OSMesa, and a MuJoCo model drawn into arrays of colours and depths."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import MissingExtraError, MissingLibraryError

if TYPE_CHECKING:
    from types import TracebackType

    from numpy.typing import NDArray
    from typing_extensions import Self

PURPOSE = "drawing pictures without a screen"
LARGEST_SIDE = 4096  # pixels; twice as many are drawn for smooth edges, and graphics cards stop at 16384

_PACKAGES = {"egl": "libegl1 libopengl0 libgl1-mesa-dri", "osmesa": "libosmesa6"}


class Pixels(NamedTuple):
    """What was drawn, row 0 on top: `colors` (h, w, 3) uint8, `depth` (h, w) from 0 near to 1 far; 1 where nothing is."""

    colors: NDArray[np.uint8]
    depth: NDArray[np.float32]


def import_mujoco() -> Any:
    """The module mujoco.

    Raises
    ------
    MissingExtraError
        It is not installed.
    MissingLibraryError
        It does not load.
    """
    try:
        import mujoco
    except ModuleNotFoundError as cause:
        raise MissingExtraError("mujoco", "sim", PURPOSE) from cause
    except (ImportError, OSError, RuntimeError) as cause:  # a library that it needs, or an odd MUJOCO_GL
        raise MissingLibraryError(f"mujoco is installed but does not load: {' '.join(str(cause).split())}") from cause
    return mujoco


def import_pillow() -> Any:
    """The module PIL.Image.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    try:
        import PIL.Image
    except ModuleNotFoundError as cause:
        raise MissingExtraError("pillow", "sim", PURPOSE) from cause
    return PIL.Image


def gl_context(width: int, height: int) -> Any:
    """An OpenGL context that needs no screen.

    On Linux ``MUJOCO_GL`` chooses between ``egl`` and ``osmesa``; otherwise EGL is tried, then OSMesa. Other systems have one way.

    Raises
    ------
    MissingLibraryError
        No library to draw with; the message names the packages of Debian.
    """
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if sys.platform != "linux":
        return _other_context(width, height)
    names = [wanted] if wanted in _PACKAGES else list(_PACKAGES)
    reasons = []
    for name in names:
        try:
            return _linux_context(name, width, height)
        except Exception as cause:  # noqa: BLE001, PERF203  each library has errors of its own
            reasons.append(f"{name}: {' '.join(str(cause).split()) or type(cause).__name__}"[:200])
    packages = ", or ".join(_PACKAGES[name] for name in names)
    raise MissingLibraryError(
        f"no OpenGL library that draws without a screen; install Debian's packages {packages} ({'; '.join(reasons)})"
    )


def _linux_context(name: str, width: int, height: int) -> Any:
    # Both set PYOPENGL_PLATFORM when they are imported and refuse one that is set to another; a failure leaves it clean.
    before = os.environ.get("PYOPENGL_PLATFORM")
    try:
        if name == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco.osmesa import GLContext
        # What failed in its beginning is cleaned up as well, and asks for this attribute then.
        return type("Context", (GLContext,), {"_context": None})(width, height)
    except Exception:
        if before is None:
            os.environ.pop("PYOPENGL_PLATFORM", None)
            for module in [m for m in sys.modules if m == "OpenGL" or m.startswith("OpenGL.")]:
                del sys.modules[module]
        raise


def _other_context(width: int, height: int) -> Any:
    mujoco = import_mujoco()
    try:
        return mujoco.GLContext(width, height)
    except Exception as cause:
        raise MissingLibraryError(f"OpenGL does not start: {' '.join(str(cause).split())}") from cause


class Offscreen:
    """Draws one MuJoCo model into arrays. A context manager: the graphics memory is freed on leaving.

    Parameters
    ----------
    model : mujoco.MjModel
    width, height : int
        Pixels.
    most_shapes : int
        Room in the scene.
    """

    def __init__(self, model: Any, width: int, height: int, *, most_shapes: int = 4000) -> None:
        self.model, self.width, self.height, self._most = model, width, height, most_shapes

    def __enter__(self) -> Self:
        mujoco = import_mujoco()
        with ExitStack() as undo:
            self._gl = gl_context(self.width, self.height)
            undo.callback(self._gl.free)
            self._gl.make_current()
            self._context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            undo.callback(self._context.free)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
            self.scene = mujoco.MjvScene(self.model, maxgeom=self._most)
            self._rect = mujoco.MjrRect(0, 0, self.width, self.height)
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._gl.make_current()
        self._undo.close()

    def draw(self) -> Pixels:
        """Draw the scene as it is now."""
        mujoco = import_mujoco()
        self._gl.make_current()
        colors = np.empty((self.height, self.width, 3), dtype=np.uint8)
        depth = np.empty((self.height, self.width), dtype=np.float32)
        mujoco.mjr_render(self._rect, self.scene, self._context)
        mujoco.mjr_readPixels(colors, depth, self._rect, self._context)
        return Pixels(colors[::-1], depth[::-1])
