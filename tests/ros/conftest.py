import pytest

from tests.ros.networks import Network, backends


@pytest.fixture(params=list(backends()))
def network(request):
    """A network of every backend in turn; what its nodes' callbacks raise fails the test, unless it takes it off."""
    network = Network(request.param)
    yield network
    errors = [error for bus in network.buses for error in bus.errors]
    network.close()
    assert not errors
