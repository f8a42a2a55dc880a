"""What every test shares."""

from __future__ import annotations

import pytest
from hypothesis import settings

from pieper._native import kernels

# No test depends on time: the first example of a run may import a package, and machines of others are slower.
settings.register_profile("pieper", deadline=None)
settings.load_profile("pieper")


@pytest.fixture(params=kernels.instruction_sets())
def instruction_set(request):
    """Every instruction set that this processor has, in turn."""
    before = kernels.instruction_set()
    kernels.use_instruction_set(request.param)
    yield request.param
    kernels.use_instruction_set(before)
