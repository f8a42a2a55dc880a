"""What the tests of pictures share: they skip, and say why, where nothing can draw without a screen."""

from __future__ import annotations

import pytest

from pieper.errors import MissingExtraError, MissingLibraryError


@pytest.fixture(scope="session")
def can_draw() -> None:
    from pieper.sim import offscreen

    try:
        offscreen.import_mujoco()
        offscreen.import_pillow()
        offscreen.gl_context(16, 16).free()
    except (MissingExtraError, MissingLibraryError) as reason:
        pytest.skip(str(reason))
