import dataclasses
import signal
import threading
import time

import pytest

from pieper.errors import RosError
from pieper.ros import messages
from pieper.ros.bare import topic
from pieper.ros.bare.topic import TopicWriter
from pieper.ros.qos import DEFAULT, LATCHED, SENSOR, QoS
from tests.ros.bare.peers import cdr, process, until, written

JOINT_STATE = "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"
FOLLOW = "control_msgs/action/FollowJointTrajectory"

TALKER = """
import sys
from pieper.ros import messages
from pieper.ros.bare import DdsWire
from pieper.ros.qos import QoS, LATCHED

domain, count = int(sys.argv[1]), int(sys.argv[2])
wire = DdsWire("talker", domain=domain)
latched = wire.open_writer("/robot_description", "std_msgs/msg/String", LATCHED)
for text in ("old", "<robot/>"):
    latched.write(messages.encode("std_msgs/msg/String", messages.make("std_msgs/msg/String", data=text)))
states = wire.open_writer("/joint_states", "sensor_msgs/msg/JointState", QoS(depth=count))
print("open", flush=True)
while not states.matched:
    wire.wait(0.01)
for i in range(count):
    message = messages.make("sensor_msgs/msg/JointState", name=["a", "b"], position=[i, -i])
    states.write(messages.encode("sensor_msgs/msg/JointState", message))
sys.stdin.read()
wire.close()
"""

LISTENER = """
import sys
from pieper.ros.bare import DdsWire
from pieper.ros.qos import QoS

wire = DdsWire("listener", domain=int(sys.argv[1]))
heard = []
reader = wire.open_reader("/target", "std_msgs/msg/String", QoS(depth=5), lambda data: print(data.hex(), flush=True))
while True:
    wire.wait(1.0)
"""


def test_another_process_is_heard_in_order_without_a_loss_and_byte_by_byte(join, domain):
    wire, heard, count = join(), [], 500
    wire.open_reader("/joint_states", JOINT_STATE, QoS(depth=count), heard.append)
    with process(TALKER, domain, count):
        assert until(lambda: len(heard) == count, wire)
    expected = [cdr(JOINT_STATE, name=["a", "b"], position=[i, -i]) for i in range(count)]
    assert heard == [data.ljust(-len(data) % 4 + len(data), b"\0") for data in expected]


def test_a_late_process_gets_the_latched_sample(join, domain):
    with process(TALKER, domain, 1) as talker:
        assert talker.stdout.readline() == "open\n"
        wire, heard = join(), []
        wire.open_reader("/robot_description", STRING, LATCHED, heard.append)
        assert until(lambda: heard, wire)
    assert [messages.decode(STRING, data).data for data in heard] == ["<robot/>"]


def test_a_process_that_ends_is_no_publisher_any_more(join, domain):
    wire = join()
    reader = wire.open_reader("/joint_states", JOINT_STATE, DEFAULT, lambda data: None)
    with process(TALKER, domain, 1) as talker:
        assert until(lambda: reader.matched == 1, wire)
        talker.stdin.close()
        assert until(lambda: reader.matched == 0, wire)


def test_a_subscriber_that_stands_still_does_not_hold_up_the_publisher(join, domain):
    wire = join()
    writer = wire.open_writer("/target", STRING, QoS(depth=5))
    with process(LISTENER, domain) as listener:
        assert until(lambda: writer.matched, wire)
        listener.send_signal(signal.SIGSTOP)
        for i in range(200):  # 4 MB, far more than any buffer on the way
            writer.write(cdr(STRING, data=f"{i} " + "x" * 20_000))
        listener.send_signal(signal.SIGCONT)
        last = ""
        for line in listener.stdout:
            last = messages.decode(STRING, bytes.fromhex(line)).data.split()[0]
            if last == "199":
                break
        assert last == "199"
    assert wire.check() is None


def test_a_sample_that_was_given_up_is_told_once(join):
    wire = join()
    writer = wire.open_writer("/target", STRING, DEFAULT)
    assert wire.check() is None
    writer.dropped += 3
    assert wire.check() == "/target: 3 samples were given up because a subscriber does not keep up"
    assert wire.check() is None


@pytest.mark.parametrize(
    ("type_name", "dds_name"),
    [
        (JOINT_STATE, "sensor_msgs::msg::dds_::JointState_"),
        (f"{FOLLOW}_FeedbackMessage", "control_msgs::action::dds_::FollowJointTrajectory_FeedbackMessage_"),
    ],
)
def test_names_on_the_wire_are_those_of_ros(join, domain, type_name, dds_name):
    wire = join()
    wire.open_writer("/cell2/follow/_action/topic", type_name, SENSOR)
    assert {"rt/cell2/follow/_action/topic": dds_name}.items() <= written(domain).items()


def test_every_type_goes_through_as_it_was_written(join):
    wire = join()
    known = [*messages._store().fielddefs]
    for type_name in [*known, "moveit_msgs/srv/GetPositionIK_Request", f"{FOLLOW}_SendGoal_Request"]:
        heard = []
        writer = wire.open_writer(f"/{type_name}", type_name, DEFAULT)
        reader = wire.open_reader(f"/{type_name}", type_name, DEFAULT, heard.append)
        data = cdr(type_name)
        writer.write(data)
        assert until(lambda heard=heard: heard, wire), type_name
        assert heard[0] == data.ljust(-len(data) % 4 + len(data), b"\0"), type_name
        writer.close()
        reader.close()


def test_one_topic_has_one_type_in_a_node(join):
    wire = join()
    wire.open_writer("/target", STRING, DEFAULT)
    wire.open_reader("/target", STRING, DEFAULT, lambda data: None)
    with pytest.raises(
        RosError,
        match=r"has the topic 'rt/target' with the type std_msgs::msg::dds_::String_, and is now asked for it with std_msgs::msg::dds_::Bool_",
    ):
        wire.open_writer("/target", "std_msgs/msg/Bool", DEFAULT)


def test_a_depth_of_nothing_is_refused(join):
    with pytest.raises(RosError, match="depth of a quality of service must be at least 1, got 0"):
        join().open_writer("/target", STRING, dataclasses.replace(DEFAULT, depth=0))


@pytest.mark.parametrize("data", [b"", b"\0", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\xff", b"\0\1\0\0\x05\0\0\0Hi\0"])
def test_bytes_that_are_not_the_type_are_refused_and_the_next_sample_arrives(join, data):
    wire, heard = join(), []
    writer = wire.open_writer("/target", STRING, DEFAULT)
    wire.open_reader("/target", STRING, DEFAULT, heard.append)
    with pytest.raises(RosError, match=f"refuses {len(data)} bytes as a sample of 'rt/target'"):
        writer.write(data)
    writer.write(cdr(STRING, data="Hi"))
    assert until(lambda: heard, wire)
    assert messages.decode(STRING, heard[0]).data == "Hi"


def test_a_sample_that_is_too_large_is_refused(join, monkeypatch):
    monkeypatch.setattr(topic, "LARGEST_SAMPLE", 100)
    writer = join().open_writer("/target", STRING, DEFAULT)
    writer.write(cdr(STRING, data="x" * 80))
    with pytest.raises(RosError, match="rt/target: a sample has at most 100 bytes, and this one has 109"):
        writer.write(cdr(STRING, data="x" * 100))


def test_closed_ends_are_silent_and_closing_twice_does_no_harm(join):
    wire, heard = join(), []
    writer = wire.open_writer("/target", STRING, DEFAULT)
    reader = wire.open_reader("/target", STRING, DEFAULT, heard.append)
    other = wire.open_writer("/target", STRING, DEFAULT)
    assert until(lambda: reader.matched == 2, wire)
    for _ in range(2):
        writer.close()
        assert until(lambda: reader.matched == 1, wire)
    writer.write(cdr(STRING, data="Hi"))
    reader.close()
    assert (writer.matched, reader.matched) == (0, 0)
    other.write(cdr(STRING, data="Hi"))
    wire.wait(0.05)
    assert heard == []


def test_a_reader_may_be_closed_by_what_it_delivers(join):
    wire, heard = join(), []

    def deliver(data):
        heard.append(data)
        reader.close()

    reader = wire.open_reader("/target", STRING, QoS(depth=10), deliver)
    writer = wire.open_writer("/target", STRING, QoS(depth=10))
    assert until(lambda: writer.matched, wire)
    for text in "abc":
        writer.write(cdr(STRING, data=text))
    assert until(lambda: heard, wire)
    wire.wait(0.05)
    assert [messages.decode(STRING, data).data for data in heard] == ["a"]


def test_a_sample_past_its_lifespan_is_not_given_to_the_late(join):
    sender = join("sender")
    qos = QoS(transient_local=True, depth=10, lifespan=0.2)
    writer = sender.open_writer("/rosout", STRING, qos)
    writer.write(cdr(STRING, data="old"))
    time.sleep(0.3)
    writer.write(cdr(STRING, data="new"))
    late, heard = join("late"), []
    late.open_reader("/rosout", STRING, qos, heard.append)
    assert until(lambda: heard, late)
    late.wait(0.05)
    assert [messages.decode(STRING, data).data for data in heard] == ["new"]


@pytest.mark.parametrize(
    ("offered", "wanted", "policy"), [(SENSOR, DEFAULT, "reliability"), (DEFAULT, LATCHED, "durability")]
)
def test_ends_that_do_not_fit_are_told_once_on_both_sides(join, offered, wanted, policy):
    sender, listener = join("sender"), join("listener")
    sender.open_writer("/target", STRING, offered)
    listener.open_reader("/target", STRING, wanted, lambda data: None)
    told = [[], []]

    def both():
        for wire, said in ((sender, told[0]), (listener, told[1])):
            said.extend(filter(None, [wire.check()]))
        return all(told)

    assert until(both, sender, listener)
    both()
    assert told == [
        [f"/target: a subscriber asks for another {policy} than this node offers, and hears nothing of it"],
        [f"/target: a publisher offers another {policy} than this node asks for, and is not heard"],
    ]


def test_who_listens_for_latched_and_for_plain_samples_has_no_complaint(join):
    """As `description` does: what the latched reader has to refuse, the plain one hears."""
    sender, listener, heard = join("sender"), join("listener"), []
    writer = sender.open_writer("/robot_description", STRING, DEFAULT)
    strict = listener.open_reader("/robot_description", STRING, LATCHED, heard.append)
    plain = listener.open_reader("/robot_description", STRING, DEFAULT, heard.append)
    other = listener.open_reader("/target", STRING, DEFAULT, heard.append)
    refused, said = [], []
    complaint = strict.complaint
    strict.complaint = lambda: refused.append(complaint()) or refused[-1]

    def told():
        said.extend(filter(None, [listener.check()]))
        return any(refused)

    assert until(told, sender, listener)  # the latched one was refused, indeed
    assert said == []
    assert plain.asks_less_than(strict)
    assert not strict.asks_less_than(plain)
    assert not plain.asks_less_than(plain)
    assert not other.asks_less_than(strict)
    assert until(lambda: writer.matched, sender, listener)
    writer.write(cdr(STRING, data="plain"))
    assert until(lambda: heard, sender, listener)


MANY = """
import sys
from pieper.ros.bare import DdsWire
from pieper.ros.qos import DEFAULT

wire = DdsWire("listener", domain=int(sys.argv[1]))
for i in range(10):
    wire.open_reader(f"/target{i}", "std_msgs/msg/String", DEFAULT, lambda data: None)
wire.wait(60.0)
"""


def test_leaving_many_topics_waits_for_a_dead_subscriber_only_once(join, domain, monkeypatch):
    """Each writer waits up to a second for what is not acknowledged, so they have to wait at the same time."""
    wire = join()
    writers = [wire.open_writer(f"/target{i}", STRING, DEFAULT) for i in range(10)]
    with process(MANY, domain) as listener:
        assert until(lambda: all(writer.matched for writer in writers), wire)
    assert listener.returncode != 0
    for writer in writers:
        writer.write(cdr(STRING, data="Hi"))
    assert not any(writer.acknowledged for writer in writers)
    all_here = threading.Barrier(len(writers), timeout=10.0)
    leave = TopicWriter.leave

    def leave_with_the_others(writer):
        if writer in unheard:
            unheard.remove(writer)
            all_here.wait()
        leave(writer)

    unheard = list(writers)
    monkeypatch.setattr(TopicWriter, "leave", leave_with_the_others)
    wire.close()
    assert unheard == []
