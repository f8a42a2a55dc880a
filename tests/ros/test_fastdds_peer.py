"""The bare backend and Debian's Fast DDS, which is the default wire of ROS 2 and shares no code with ours, byte for byte."""

from __future__ import annotations

from importlib.util import find_spec

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.ros import messages
from pieper.ros.qos import LATCHED
from tests.ros import fastdds
from tests.ros.networks import Network

pytestmark = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="cyclonedds is not installed")

JOINT_STATE = "sensor_msgs/msg/JointState"
POINT = "geometry_msgs/msg/Point"
POSE = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"

HEADER = {"stamp": {"sec": 1_700_000_000, "nanosec": 999_999_999}, "frame_id": "bäse_link"}
QUATERNION = {"x": 0.5, "y": -0.5, "z": 0.5, "w": -0.5}
SAMPLES = {
    "joint_states": (
        JOINT_STATE,
        {"header": HEADER, "name": ["joint_a", "b", ""], "position": [0.1, -2e-300, 3.0], "effort": [-0.0]},
    ),
    "target": (POINT, {"x": 0.1, "y": 0.2, "z": -0.3}),
    "tool_pose": (POSE, {"header": HEADER, "pose": {"position": {"x": 1.5}, "orientation": QUATERNION}}),
    "tf": (
        TF,
        {
            "transforms": [
                {"header": HEADER, "child_frame_id": "link_1", "transform": {"rotation": QUATERNION}},
                {"child_frame_id": "l", "transform": {"translation": {"x": 1.0, "y": 2.0, "z": 3.0}}},
            ]
        },
    ),
}
TOPICS = sorted(SAMPLES)
URDF = '<robot name="ärm">\n\t<link name="\\base\'"/>\n</robot>' * 5000  # 255 kB: in several datagrams


def on_the_wire(data: bytes) -> bytes:
    """What the other side is handed: RTPS fills its submessages up to four bytes (2.5, 9.4.1) and keeps no true length."""
    return data + bytes(-len(data) % 4)


@pytest.fixture(scope="module", autouse=True)
def peer_is_compiled():
    fastdds.peer_program()


@pytest.fixture
def network():
    network = Network("bare")
    yield network
    network.close()


@pytest.mark.parametrize("topic", TOPICS)
def test_fast_dds_reads_what_we_publish(network, topic):
    type_name, fields = SAMPLES[topic]
    message = messages.make(type_name, fields)
    publisher = network.join("arm").publisher(topic, type_name)
    with fastdds.Subscriber(network.domain, topic, type_name, count=3) as peer:
        assert network.until(lambda: publisher.subscribers == 1)
        peer.matched()
        for _ in range(3):
            publisher.send(fields)
        for received in peer.received():
            assert received.message == messages.as_fields(message)
            assert received.payload == on_the_wire(messages.encode(type_name, message))


@pytest.mark.parametrize("topic", TOPICS)
def test_we_read_what_fast_dds_publishes(network, topic):
    type_name, fields = SAMPLES[topic]
    message = messages.make(type_name, fields)
    heard: list = []
    subscription = network.join("arm").subscribe(topic, type_name, heard.append)
    with fastdds.Publisher(network.domain, topic, type_name) as peer:
        assert network.until(lambda: subscription.publishers == 1)
        peer.matched()
        sent = [peer.send(**fields) for _ in range(3)]
        assert network.until(lambda: len(heard) == 3)
    assert sent == [messages.encode(type_name, message)] * 3
    assert [messages.as_fields(one) for one in heard] == [messages.as_fields(message)] * 3


def test_fast_dds_hears_our_latched_topic_after_the_fact(network):
    publisher = network.join("arm").publisher("robot_description", STRING, qos=LATCHED)
    for text in ("superseded", URDF):
        publisher.send(data=text)
    with fastdds.Subscriber(network.domain, "robot_description", STRING, latched=True) as peer:
        (received,) = peer.received()
    assert received.message == {"data": URDF}
    assert received.payload == on_the_wire(messages.encode(STRING, messages.make(STRING, data=URDF)))


def test_we_hear_a_latched_topic_of_fast_dds_after_the_fact(network):
    heard: list = []
    bus = network.join("arm")
    with fastdds.Publisher(network.domain, "robot_description", STRING, latched=True) as peer:
        peer.send(data="superseded")
        sent = peer.send(data=URDF)
        bus.subscribe("robot_description", STRING, heard.append, qos=LATCHED)
        assert network.until(lambda: heard)
    assert [message.data for message in heard] == [URDF]
    assert sent == messages.encode(STRING, heard[0])


numbers = st.floats(allow_nan=False)
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)
stamps = st.fixed_dictionaries({"sec": st.integers(-(2**31), 2**31 - 1), "nanosec": st.integers(0, 2**32 - 1)})
headers = st.fixed_dictionaries({"stamp": stamps, "frame_id": texts})
points = st.fixed_dictionaries(dict.fromkeys("xyz", numbers))
quaternions = st.fixed_dictionaries(dict.fromkeys("xyzw", numbers))
poses = st.fixed_dictionaries({"position": points, "orientation": quaternions})
transforms = st.fixed_dictionaries({"translation": points, "rotation": quaternions})
ANY = {
    POINT: points,
    STRING: st.fixed_dictionaries({"data": texts}),
    POSE: st.fixed_dictionaries({"header": headers, "pose": poses}),
    JOINT_STATE: st.fixed_dictionaries(
        {
            "header": headers,
            "name": st.lists(texts, max_size=9),
            "position": st.lists(numbers, max_size=9),
            "velocity": st.lists(numbers, max_size=9),
            "effort": st.lists(numbers, max_size=9),
        }
    ),
    TF: st.fixed_dictionaries(
        {
            "transforms": st.lists(
                st.fixed_dictionaries({"header": headers, "child_frame_id": texts, "transform": transforms}), max_size=3
            )
        }
    ),
}


@pytest.mark.parametrize("type_name", sorted(ANY))
def test_every_message_is_encoded_and_decoded_as_fast_cdr_does(type_name):
    with fastdds.Encoder(type_name) as encoder, fastdds.Decoder(type_name) as decoder:

        @given(ANY[type_name])
        @settings(max_examples=100)
        def law(fields):
            message = messages.make(type_name, fields)
            data = messages.encode(type_name, message)
            assert encoder.encode(message) == data
            assert decoder.decode(data) == messages.as_fields(messages.decode(type_name, data))

        law()
