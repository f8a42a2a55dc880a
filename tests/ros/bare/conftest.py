from contextlib import ExitStack

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from pieper.ros.bare import DdsWire
from tests.ros.domains import new_domain


@pytest.fixture
def domain():
    return new_domain()


@pytest.fixture
def join(domain):
    """Make wires in a domain of this test's own; all are closed in the end."""
    with ExitStack() as stack:

        def join(node="node", namespace="/"):
            wire = DdsWire(node, namespace, domain)
            stack.callback(wire.close)
            return wire

        yield join
