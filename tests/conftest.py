"""What every test shares."""

from __future__ import annotations

from hypothesis import settings

# No test depends on time: the first example of a run may import a package, and machines of others are slower.
settings.register_profile("pieper", deadline=None)
settings.load_profile("pieper")
