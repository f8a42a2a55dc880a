"""What was recorded is said again, message by message and at its time."""

from __future__ import annotations

from sqlite3 import OperationalError

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pieper.errors import RosError, UnknownNameError
from pieper.ros import bags, messages
from pieper.ros.bags import Bag, Recorder, Replay, record, replay
from pieper.ros.fake import FakeNetwork
from pieper.ros.qos import LATCHED, QoS
from pieper.ros.topics import Topic

JOINTS = Topic("/joint_states", "sensor_msgs/msg/JointState")
TARGET = Topic("/target", "geometry_msgs/msg/Point")
DESCRIPTION = Topic("/robot_description", "std_msgs/msg/String", LATCHED)
MILLISECOND = 1_000_000  # ns: the step in which the fake network lets time pass


@pytest.fixture
def network():
    return FakeNetwork()


def talk(network, path, *, storage="mcap", topics=(JOINTS, TARGET, DESCRIPTION)):
    """A bag of half a second: a description, joint states at 100 Hz, two targets."""
    arm, recorder_bus = network.bus("arm"), network.bus("recorder")
    arm.publisher("robot_description", DESCRIPTION.type, qos=LATCHED).send(data="<robot/>")
    recorder = Recorder(recorder_bus, topics, path, storage=storage)
    joints, target = arm.publisher("joint_states", JOINTS.type), arm.publisher("target", TARGET.type)
    begin = network.time
    arm.timer(
        0.01,
        lambda: joints.send(
            header={"stamp": arm.stamp()}, name=["a", "b"], position=[(network.time - begin) * 1e-9, 1.0]
        ),
    )
    network.advance(0.105)
    target.send(x=0.3)
    network.advance(0.2)
    target.send(x=0.4)
    network.advance(0.2)
    counts = recorder.close()
    arm.close()
    recorder_bus.close()
    return counts


def said(bag_path, topics=()):
    with Bag(bag_path) as bag:
        return [(m.topic, m.type, m.time, messages.as_fields(m.message)) for m in bag.messages(topics)]


@pytest.mark.parametrize("storage", bags.STORAGES)
def test_a_bag_holds_what_was_said_and_when(network, tmp_path, storage):
    begin = network.time
    counts = talk(network, tmp_path / "bag", storage=storage)
    assert counts == {"/joint_states": 50, "/target": 2, "/robot_description": 1}
    found = said(tmp_path / "bag")
    assert len(found) == 53
    assert [m[2] for m in found] == sorted(m[2] for m in found)
    joints = [m for m in found if m[0] == "/joint_states"]
    assert all(type_name == JOINTS.type for _, type_name, _, _ in joints)
    np.testing.assert_allclose([m[3]["position"][0] for m in joints], 0.01 * np.arange(1, 51), atol=1e-12)
    assert [m[2] - begin for m in joints] == [10 * MILLISECOND * k for k in range(1, 51)]
    assert [m[3] for m in found if m[0] == "/target"] == [{"x": x, "y": 0.0, "z": 0.0} for x in (0.3, 0.4)]
    with Bag(tmp_path / "bag") as bag:
        assert bag.topics["/robot_description"].qos.transient_local
        assert not bag.topics["/target"].qos.transient_local
        assert bag.count == 53
        assert bag.duration == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("storage", bags.STORAGES)
def test_a_single_file_of_a_bag_is_read_too(network, tmp_path, storage):
    talk(network, tmp_path / "bag", storage=storage)
    (file,) = (tmp_path / "bag").glob("bag*.mcap" if storage == "mcap" else "bag*.db3")
    assert said(file) == said(tmp_path / "bag")


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_a_replay_keeps_the_times_between_messages(network, tmp_path, rate):
    talk(network, tmp_path / "bag")
    recorded = said(tmp_path / "bag")
    player, listener = network.bus("player"), network.bus("listener")
    heard = []
    for topic in (JOINTS, TARGET, DESCRIPTION):
        listener.subscribe(
            topic.name,
            topic.type,
            lambda m, topic=topic: heard.append((network.time, topic.name, messages.as_fields(m))),
        )
    begin = network.time
    with Replay(player, tmp_path / "bag", rate=rate, delay=0.1) as again:
        for _ in range(3000):
            network.advance(0.001)
            if again.done:
                break
        assert again.done
        assert again.sent == len(recorded)
    first = recorded[0][2]
    for topic in (JOINTS.name, TARGET.name, DESCRIPTION.name):
        these, those = [h for h in heard if h[1] == topic], [m for m in recorded if m[0] == topic]
        assert [fields for _, _, fields in these] == [fields for _, _, _, fields in those]
        for (at, _, _), (_, _, time, _) in zip(these, those, strict=True):
            assert abs((at - begin) - (1e8 + (time - first) / rate)) <= MILLISECOND


def test_record_and_replay_as_functions(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    target = source.publisher("target", TARGET.type)
    source.timer(0.1, lambda: target.send(x=1.0))
    assert record(other, [TARGET], tmp_path / "bag", seconds=1.05) == {"/target": 10}
    source.close()
    heard = []
    network.bus("listener").subscribe("target", TARGET.type, heard.append)
    assert replay(other, tmp_path / "bag", rate=10.0) == 10
    network.settle()
    assert len(heard) == 10


def test_a_recording_ends_when_the_bus_is_stopped(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    target = source.publisher("target", TARGET.type)
    source.timer(0.1, lambda: target.send(x=1.0))
    other.timer(0.55, other.stop)
    assert record(other, [TARGET], tmp_path / "bag") == {"/target": 5}
    assert len(said(tmp_path / "bag")) == 5


def test_a_bag_appears_when_it_is_whole(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    recorder = Recorder(other, [TARGET], tmp_path / "deep" / "bag")
    source.publisher("target", TARGET.type).send(x=1.0)
    network.settle()
    assert not (tmp_path / "deep" / "bag").exists()
    recorder.close()
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["bag"]
    assert len(said(tmp_path / "deep" / "bag")) == 1


def test_an_abandoned_recording_leaves_nothing(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    recorder = Recorder(other, [TARGET], tmp_path / "bag")
    source.publisher("target", TARGET.type).send(x=1.0)
    network.settle()
    recorder.abandon()
    assert not list(tmp_path.iterdir())
    source.publisher("target", TARGET.type).send(x=1.0)
    network.settle()
    assert not other.errors


def test_a_loop_begins_again(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    target = source.publisher("target", TARGET.type)
    source.timer(0.1, lambda: target.send(x=1.0))
    record(other, [TARGET], tmp_path / "bag", seconds=0.35)
    source.close()
    times = []
    network.bus("listener").subscribe("target", TARGET.type, lambda _: times.append(network.time))
    with Replay(other, tmp_path / "bag", loop=True) as again:
        network.advance(2.0)
        assert not again.done
    np.testing.assert_allclose(np.diff(times), 0.1e9, atol=2 * MILLISECOND)
    assert len(times) >= 18


def test_a_loop_of_one_message_does_not_flood(network, tmp_path):
    source, other = network.bus("source"), network.bus("other")
    recorder = Recorder(other, [TARGET], tmp_path / "bag")
    source.publisher("target", TARGET.type).send(x=1.0)
    network.settle()
    recorder.close()
    with Replay(other, tmp_path / "bag", loop=True) as again:
        network.advance(1.0)
        assert 1 <= again.sent <= 102


def test_names_are_remapped_on_the_way_in_and_out(network, tmp_path):
    source = network.bus("source", ["--ros-args", "-r", "__ns:=/cell2"])
    recorder = Recorder(
        network.bus("recorder", ["--ros-args", "-r", "__ns:=/cell2"]), [Topic.parse("target")], tmp_path / "bag"
    )
    source.publisher("target", TARGET.type).send(x=1.0)
    network.settle()
    assert recorder.close() == {"/cell2/target": 1}
    heard = []
    network.bus("listener").subscribe("/goal", TARGET.type, heard.append)
    replay(network.bus("player", ["--ros-args", "-r", "/cell2/target:=/goal"]), tmp_path / "bag")
    network.settle()
    assert len(heard) == 1


def test_only_the_topics_that_are_asked_for(network, tmp_path):
    talk(network, tmp_path / "bag")
    assert replay(network.bus("player"), tmp_path / "bag", topics=["/target"], rate=100.0) == 2
    assert {m[0] for m in said(tmp_path / "bag", ["/target", "/joint_states"])} == {"/target", "/joint_states"}


# Bags of ROS 1


def ros_1_bag(path):
    """Joint states, a camera's description (fields renamed in ROS 2), and tf under its old name."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf/msg/tfMessage"))
    store.register(get_types_from_msg("float64 secret", "our_msgs/msg/Secret"))
    t = store.types

    def header(k):
        stamp = t["builtin_interfaces/msg/Time"](10 + k, 5)
        return t["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="base_link")

    def camera():
        region = t["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        K, P = np.arange(9.0), np.arange(12.0)
        return t["sensor_msgs/msg/CameraInfo"](
            header(0), 480, 640, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, region
        )

    def joints(k):
        return t["sensor_msgs/msg/JointState"](header(k), ["a"], np.array([0.1 * k]), np.array([]), np.array([]))

    def transforms():
        v, q = t["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0), t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        transform = t["geometry_msgs/msg/Transform"](v, q)
        return t["tf/msg/tfMessage"]([t["geometry_msgs/msg/TransformStamped"](header(0), "tool0", transform)])

    said = [("/joint_states", JOINTS.type, 1_000_000_000 + 100_000_000 * k, joints(k)) for k in range(5)]
    said.append(("/camera_info", "sensor_msgs/msg/CameraInfo", 1_050_000_000, camera()))
    said.append(("/tf", "tf/msg/tfMessage", 1_060_000_000, transforms()))
    said.append(("/secret", "our_msgs/msg/Secret", 1_070_000_000, t["our_msgs/msg/Secret"](1.0)))
    with Writer(path) as writer:
        connections = {}
        for topic, type_name, time, message in said:
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, type_name, typestore=store, latching=1 if topic == "/camera_info" else None
                )
            writer.write(connections[topic], time, store.serialize_ros1(message, type_name))
    return path


def test_a_ros_1_bag_is_read_as_ros_2(tmp_path):
    path = ros_1_bag(tmp_path / "old.bag")
    with Bag(path) as bag:
        assert bag.topics["/tf"].type == "tf2_msgs/msg/TFMessage"
        assert bag.topics["/camera_info"].qos == LATCHED
        assert "our_msgs/msg/Secret" in bag.topics["/secret"].problem
        found = list(bag.messages())
        assert bag.undecodable == 0
    assert [m.topic for m in found].count("/joint_states") == 5
    joints = [m.message for m in found if m.topic == "/joint_states"]
    assert [m.position[0] for m in joints] == [0.1 * k for k in range(5)]
    assert [m.header.stamp.sec for m in joints] == [10, 11, 12, 13, 14]
    (camera,) = (m.message for m in found if m.topic == "/camera_info")
    np.testing.assert_array_equal(camera.k, np.arange(9.0))
    np.testing.assert_array_equal(camera.p, np.arange(12.0))
    (tf,) = (m.message for m in found if m.topic == "/tf")
    assert tf.transforms[0].transform.translation.z == 3.0
    assert tf.transforms[0].header.frame_id == "base_link"


def test_a_ros_1_bag_is_replayed(network, tmp_path):
    path = ros_1_bag(tmp_path / "old.bag")
    player, listener = network.bus("player"), network.bus("listener")
    heard = []
    listener.subscribe(
        "/joint_states", JOINTS.type, lambda m: heard.append((network.time, m.position[0], m.header.frame_id))
    )
    assert replay(player, path) == 7
    network.settle()
    assert [(q, frame) for _, q, frame in heard] == [(0.1 * k, "base_link") for k in range(5)]
    np.testing.assert_allclose(np.diff([at for at, _, _ in heard]), 0.1e9, atol=MILLISECOND)
    assert any("our_msgs/msg/Secret" in line and "left out" in line for line in player.lines)
    with pytest.raises(RosError, match="/secret: no type 'our_msgs/msg/Secret'; no package 'our_msgs'"):
        replay(player, path, topics=["/secret"])


# Definitions that a bag brings


def bag_with_definition(path, type_name, definition, data, *, digest="RIHS01_" + 64 * "0"):
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/odd", type_name, msgdef=definition, rihs01=digest)
        writer.write(connection, 1, data)
    return path


def test_a_type_that_has_changed_since_is_read_by_the_names_of_its_fields(tmp_path):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 z\nfloat64 x\nstring note", "geometry_msgs/msg/Point"))
    data = store.serialize_cdr(store.types["geometry_msgs/msg/Point"](3.0, 1.0, "old"), "geometry_msgs/msg/Point")
    path = bag_with_definition(tmp_path / "bag", "geometry_msgs/msg/Point", "float64 z\nfloat64 x\nstring note\n", data)
    assert said(path) == [("/odd", "geometry_msgs/msg/Point", 1, {"x": 1.0, "y": 0.0, "z": 3.0})]


def test_a_type_with_char_is_read(tmp_path):
    """rosidl takes a char for a uint8, so the definition and the hash in a bag of ROS differ from those of rosbags."""
    name = "rmw_dds_common/msg/Gid"
    data = messages.encode(name, messages.make(name, data=list(range(16))))
    path = bag_with_definition(tmp_path / "bag", name, "char[16] data\n", data, digest=messages.type_hash(name))
    assert said(path)[0][3] == {"data": list(range(16))}


def test_damaged_messages_are_left_out_and_counted(network, tmp_path):
    definition = "float64 x\nfloat64 y\nfloat64 z\n"
    path = bag_with_definition(tmp_path / "bag", "geometry_msgs/msg/Point", definition, b"\x00\x01\x00\x00\x07")
    with Bag(path) as bag:
        assert list(bag.messages()) == []
        assert bag.undecodable == 1
    with pytest.raises(RosError, match="none of its messages can be read"):
        replay(network.bus("player"), path)


# Bad input


def test_what_cannot_be_recorded_is_said(network, tmp_path):
    bus = network.bus("recorder")
    (tmp_path / "there").mkdir()
    with pytest.raises(RosError, match=r"there exists already, and a recording never overwrites"):
        Recorder(bus, [TARGET], tmp_path / "there")
    with pytest.raises(RosError, match="name at least one topic"):
        Recorder(bus, [], tmp_path / "bag")
    with pytest.raises(UnknownNameError, match="no storage 'mcapp'; did you mean 'mcap'"):
        Recorder(bus, [TARGET], tmp_path / "bag", storage="mcapp")
    with pytest.raises(RosError, match="geometry_msgs/msg/Pointt"):
        Recorder(bus, [Topic("/target", "geometry_msgs/msg/Pointt")], tmp_path / "bag")
    with pytest.raises(RosError, match="/target is named twice"):
        Recorder(bus, [TARGET, Topic.parse("target")], tmp_path / "bag")
    with pytest.raises(RosError, match="take the storage mcap"):
        Recorder(bus, [TARGET], tmp_path / "a#b" / "bag", storage="sqlite3")
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(RosError, match="cannot be written"):
        Recorder(bus, [TARGET], tmp_path / "file" / "bag")
    with pytest.raises(RosError, match="nothing was recorded: no message came on /target"):
        record(bus, [TARGET], tmp_path / "bag", seconds=0.1)
    for seconds in (0.0, -1.0, float("nan")):
        with pytest.raises(RosError, match="the seconds of a recording must be positive and finite, got"):
            record(bus, [TARGET], tmp_path / "bag", seconds=seconds)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "there"]


def test_a_full_disk_is_said_and_leaves_nothing(network, tmp_path, monkeypatch):
    source, bus = network.bus("source"), network.bus("recorder")
    target = source.publisher("target", TARGET.type)
    source.timer(0.1, lambda: target.send(x=1.0))
    recorder = Recorder(bus, [TARGET], tmp_path / "bag")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder._writer, "write", full)
    network.advance(0.5)
    assert not bus.errors
    with pytest.raises(RosError, match=r"bag could not be written: .*No space left"):
        recorder.close()
    assert not list(tmp_path.iterdir())


def test_a_disk_that_is_full_before_the_first_message_is_said(network, tmp_path, monkeypatch):
    from rosbags.rosbag2 import Writer

    def full(_):
        raise OperationalError("database or disk is full")

    monkeypatch.setattr(Writer, "open", full)
    with pytest.raises(RosError, match="bag cannot be written: database or disk is full"):
        Recorder(network.bus("recorder"), [TARGET], tmp_path / "bag", storage="sqlite3")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_replayed_is_said(network, tmp_path):
    bus = network.bus("player")
    with pytest.raises(RosError, match=r"there is no bag at .*nowhere"):
        replay(bus, tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RosError, match="folder is not a bag"):
        replay(bus, tmp_path / "folder")
    for name in ("text.txt", "text.bag", "text.mcap", "text.db3"):
        (tmp_path / name).write_text("nothing but text")
        with pytest.raises(RosError, match=f"{name} is not a bag"):
            replay(bus, tmp_path / name)
    talk(network, tmp_path / "bag")
    with pytest.raises(UnknownNameError, match=r"no topic '/targett' in .*; did you mean '/target'"):
        replay(bus, tmp_path / "bag", topics=["/targett"])
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(RosError, match="rate of a replay must be positive"):
            replay(bus, tmp_path / "bag", rate=rate)
    with pytest.raises(RosError, match="delay of a replay"):
        replay(bus, tmp_path / "bag", delay=-1.0)


def test_an_empty_bag_is_said(network, tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3):
        pass
    with Bag(tmp_path / "bag") as bag:
        assert (bag.count, bag.duration, list(bag.messages())) == (0, 0.0, [])
    with pytest.raises(RosError, match="bag is empty"):
        replay(network.bus("player"), tmp_path / "bag")


@pytest.fixture(scope="module")
def whole_bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    talk(FakeNetwork(), folder / "bag")
    talk(FakeNetwork(), folder / "lite", storage="sqlite3")
    ros_1_bag(folder / "old.bag")
    return {
        p.name: p.read_bytes() for p in (folder / "bag" / "bag.mcap", folder / "lite" / "lite.db3", folder / "old.bag")
    }


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["bag.mcap", "lite.db3", "old.bag"]),
    st.floats(0.0, 1.0),
    st.binary(min_size=1, max_size=8),
    st.booleans(),
)
def test_damaged_files_give_an_error_or_their_sound_part(whole_bag, tmp_path, name, where, junk, cut):
    data = whole_bag[name]
    at = int(where * len(data))
    (tmp_path / name).write_bytes(data[:at] if cut else data[:at] + junk + data[at + len(junk) :])
    found, complaint = [], name
    try:
        found = said(tmp_path / name)
    except RosError as error:
        complaint = str(error)
    assert name in complaint
    assert all(topic in (JOINTS.name, TARGET.name, DESCRIPTION.name, "/camera_info", "/tf") for topic, *_ in found)


# Names of topics


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/tf_static", Topic("/tf_static", "tf2_msgs/msg/TFMessage", QoS(transient_local=True, depth=100))),
        ("target", Topic("target", "geometry_msgs/msg/Point")),
        ("/x:std_msgs/msg/String", Topic("/x", "std_msgs/msg/String")),
        ("/x:std_msgs/msg/String:latched", Topic("/x", "std_msgs/msg/String", LATCHED)),
        ("/target::latched", Topic("/target", "geometry_msgs/msg/Point", LATCHED)),
    ],
)
def test_a_topic_is_read_from_its_name(text, expected):
    assert Topic.parse(text) == expected


def test_topics_that_cannot_be_read():
    with pytest.raises(RosError, match="the type of topic '/weather' is not known; write it behind the name"):
        Topic.parse("/weather")
    with pytest.raises(RosError, match="no quality of service 'lached'; there are: default, latched, sensor"):
        Topic.parse("/x:std_msgs/msg/String:lached")
