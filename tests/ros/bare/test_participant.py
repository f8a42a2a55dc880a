import gc
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pieper.errors import RosError
from pieper.ros.bare import DdsWire
from pieper.ros.bare.loopback import sockets
from pieper.ros.bare.participant import domain_id
from pieper.ros.qos import DEFAULT
from tests.ros.bare.peers import cdr, process, until
from tests.ros.domains import new_domain

STRING = "std_msgs/msg/String"

NODE = """
import signal, sys
from pieper.ros import open_bus

with open_bus("node", domain=int(sys.argv[1]), backend="bare") as bus:
    if sys.argv[2] == "handler":
        signal.signal(signal.SIGINT, lambda *_: bus.stop())
    bus.subscribe("target", "std_msgs/msg/String", print)
    try:
        print("open", flush=True)
        bus.spin()
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.parametrize("text", ["-1", "233", "0x10", "1.0", "robots", "²"])
def test_a_domain_that_is_none_is_refused(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(RosError, match=rf"ROS_DOMAIN_ID must be a number from 0 to 232, got {re.escape(repr(text))}"):
        DdsWire("node")


@pytest.mark.parametrize(("text", "domain"), [(None, 0), ("", 0), ("0", 0), (" 42 ", 42), ("232", 232)])
def test_the_domain_comes_from_the_environment(monkeypatch, text, domain):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if text is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id() == domain


def test_the_environment_chooses_where_the_wire_is(monkeypatch, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    wire = DdsWire("node")
    assert wire.domain == domain
    wire.close()


def test_domains_do_not_hear_each_other(join):
    other = DdsWire("other", domain=new_domain())
    wire, heard = join(), []
    wire.open_reader("/target", STRING, DEFAULT, heard.append)
    writer = other.open_writer("/target", STRING, DEFAULT)
    same = join("same").open_writer("/target", STRING, DEFAULT)
    assert until(lambda: same.matched, wire)
    writer.write(cdr(STRING, data="Hi"))
    same.write(cdr(STRING, data="Hi"))
    assert until(lambda: heard, wire)
    wire.wait(0.05)
    assert (writer.matched, len(heard)) == (0, 1)
    other.close()


def test_no_socket_is_open_to_other_machines(join, domain):
    first, second = join("first"), join("second")
    first.open_writer("/target", STRING, DEFAULT)
    first.rebuild()
    second.open_reader("/target", STRING, DEFAULT, lambda data: None)
    mine = [one for one in sockets() if one.bound]
    assert any(0 <= one.port - (7400 + 250 * domain) < 250 for one in mine)
    assert [one for one in mine if one.reachable] == []


def threads():
    """Names of the threads of this process."""
    return [(task / "comm").read_text() for task in Path("/proc/self/task").iterdir()]


def test_a_closed_wire_leaves_no_thread_and_no_socket(domain):
    def there():
        return len(threads()), len(sockets())

    wires = [DdsWire(name, domain=domain) for name in "ab"]
    wires[0].open_server("/enable", "std_srvs/srv/SetBool", lambda data, respond: None)
    wires[1].open_reader("/target", STRING, DEFAULT, lambda data: None)
    for wire in wires:
        wire.close()
    gc.collect()
    before = there()
    for _ in range(3):
        wires = [DdsWire(name, domain=domain) for name in "ab"]
        wires[0].open_server("/enable", "std_srvs/srv/SetBool", lambda data, respond: None)
        wires[1].open_reader("/target", STRING, DEFAULT, lambda data: None)
        assert there()[0] > before[0]
        assert there()[1] > before[1]
        for wire in wires:
            wire.close()
            wire.close()
    assert there() == before
    assert not any(name.startswith(("recv", "tev", "gc", "dq.")) for name in threads())


def test_a_wait_ends_when_it_is_woken_by_another_thread(join):
    wire = join()
    threading.Timer(0.1, wire.wake).start()
    assert wire._participant.wait(60.0)
    wire.wake()
    assert wire._participant.wait(60.0)  # a wake before the wait counts
    assert not wire._participant.wait(0.0)


def test_nothing_can_be_opened_on_a_closed_wire(join):
    wire = join()
    wire.close()
    wire.wake()
    wire.wait(0.0)
    with pytest.raises(RosError, match="the node has left the network"):
        wire.open_writer("/target", STRING, DEFAULT)
    with pytest.raises(RosError, match="the node has left the network"):
        wire.open_caller("/enable", "std_srvs/srv/SetBool")


@pytest.mark.parametrize("mode", ["handler", "exception"])
def test_an_interrupt_ends_a_node_that_waits_and_it_exits_with_0(domain, mode):
    with process(NODE, domain, mode) as node:
        assert node.stdout.readline() == "open\n"
        node.send_signal(signal.SIGINT)
        assert node.wait(timeout=20) == 0
        assert node.stdout.read() == ("" if mode == "handler" else "interrupted\n")


def test_without_cyclonedds_the_message_says_what_to_install():
    script = "import sys; sys.modules['cyclonedds'] = None\nimport pieper.ros.bare"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "cyclonedds is not installed; a ROS 2 node without ROS needs it: pip install 'pieper[ros]'" in done.stderr
