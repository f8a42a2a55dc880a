"""What every test shares."""

from __future__ import annotations

import os
import signal
import threading

import pytest
from hypothesis import settings

from pieper._native import kernels
from pieper.errors import MissingExtraError, MissingLibraryError

FORCED = os.environ.get("PIEPER_INSTRUCTION_SET")

# No test depends on time: the first example of a run may import a package, and machines of others are slower.
settings.register_profile("pieper", deadline=None)
settings.load_profile("pieper")

# A shell that starts the tests in the background may have told them to ignore Ctrl-C; the processes of the tests would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(params=[FORCED] if FORCED else kernels.instruction_sets())
def instruction_set(request):
    """Every instruction set that this processor has, in turn; the one that PIEPER_INSTRUCTION_SET names, where it does."""
    kernels.use_instruction_set(request.param)
    return request.param


@pytest.fixture(autouse=True)
def _the_instruction_set_is_left_as_it_was():
    """Else a test that chooses one would decide for those after it."""
    before = kernels.instruction_set()
    yield
    kernels.use_instruction_set(before)


@pytest.fixture(scope="session")
def can_draw() -> None:
    """Tests of pictures skip, and say why, where nothing can draw without a screen."""
    from pieper.sim import offscreen

    try:
        offscreen.import_mujoco()
        offscreen.import_pillow()
        offscreen.gl_context(16, 16).free()
    except (MissingExtraError, MissingLibraryError) as reason:
        pytest.skip(str(reason))
