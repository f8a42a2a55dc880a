import os
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from pieper.errors import RosError
from tests.ros.networks import Network, backends

if find_spec("rclpy"):  # keep it to this machine, too; read when the first node is made
    from pieper.ros.bare.loopback import configuration

    profile = str(Path(__file__).with_name("fastdds_loopback.xml"))
    os.environ |= {
        "FASTRTPS_DEFAULT_PROFILES_FILE": profile,
        "FASTDDS_DEFAULT_PROFILES_FILE": profile,
        "CYCLONEDDS_URI": configuration(),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # as these files say
        "ROS_LOG_DIR": str(Path(__file__).parents[2] / "build" / "logs"),
    }


@pytest.fixture(params=list(backends()))
def network(request):
    """A network of every backend in turn; what its nodes' callbacks raise fails the test, unless it takes it off."""
    network = Network(request.param)
    yield network
    errors = [error for bus in network.buses for error in bus.errors]
    network.close()
    assert not errors


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """A ROS without some package of messages skips the tests that send them: the wheels of rclpy bring few."""
    try:
        return (yield)
    except RosError as error:
        if find_spec("rclpy") and (lacks := re.match(r"this ROS installation has no [\w/]+", str(error))):
            pytest.skip(lacks[0])
        raise
