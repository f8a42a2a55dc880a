"""Messages: built from fields, to bytes and back, and what does not fit is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from pieper.errors import RosError
from pieper.ros import messages

SHIPPED = sorted(get_typestore(Stores.ROS2_JAZZY).fielddefs)
FOLDER = Path(messages.__file__).parent / "interfaces"
PARTS = {
    "msg": ("",),
    "srv": ("_Request", "_Response"),
    "action": ("_Goal", "_Result", "_Feedback", "_SendGoal_Request", "_GetResult_Response", "_FeedbackMessage"),
}
OWN = sorted(
    f"{file.parts[-3]}/{kind}/{file.stem}{part}"
    for kind, parts in PARTS.items()
    for file in FOLDER.glob(f"*/{kind}/*.{kind}")
    for part in parts
)
TYPES = SHIPPED + OWN

_SPANS = {f"{sign}int{bits}": (0 if sign else -(2 ** (bits - 1)), 2 ** (bits - (not sign)) - 1)
          for sign in ("", "u") for bits in (8, 16, 32, 64)}  # fmt: skip


def values_of(desc) -> st.SearchStrategy:
    """Any value of a field."""
    node, rest = desc
    if node == Nodetype.NAME:
        return fields_of(rest)
    if node == Nodetype.BASE:
        name, limit = rest
        if name == "string":
            return st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=(limit or 20) // 4)
        if name == "bool":
            return st.booleans()
        if name.startswith("float"):
            return st.floats(width=int(name[5:]), allow_nan=False)
        return st.integers(*_SPANS["uint8" if name in ("byte", "char") else name])
    inner, count = rest
    fixed = count if node == Nodetype.ARRAY else None
    return st.lists(values_of(inner), min_size=fixed or 0, max_size=fixed or min(count or 4, 4))


def fields_of(type_name: str) -> st.SearchStrategy:
    fields = messages._fielddefs(type_name)
    return st.fixed_dictionaries({}, optional={name: values_of(desc) for name, desc in fields})


def test_the_interface_texts_are_there():
    assert {"std_srvs/srv/SetBool_Request", "control_msgs/action/FollowJointTrajectory_Goal"} <= set(OWN)


@pytest.mark.parametrize("type_name", TYPES)
def test_every_type_has_a_default_that_survives_its_bytes(type_name):
    message = messages.make(type_name)
    data = messages.encode(type_name, message)
    assert data[:4] == b"\x00\x01\x00\x00"
    assert messages.as_fields(messages.decode(type_name, data)) == messages.as_fields(message)


@given(st.data())
def test_whatever_is_sent_is_what_arrives(data):
    type_name = data.draw(st.sampled_from(TYPES))
    given_fields = data.draw(fields_of(type_name))
    sent = messages.make(type_name, given_fields)
    arrived = messages.decode(type_name, messages.encode(type_name, sent))
    assert messages.as_fields(arrived) == messages.as_fields(sent)
    for name, value in given_fields.items():
        if isinstance(value, int | str):
            assert getattr(arrived, name) == value


@given(st.sampled_from(TYPES), st.binary(max_size=200))
def test_hostile_bytes_are_refused_or_decoded_but_never_crash(type_name, noise):
    for data in (noise, b"\x00\x01\x00\x00" + noise):
        try:
            messages.decode(type_name, data)
        except RosError as error:
            assert type_name in str(error)  # noqa: PT017  both outcomes are right


@pytest.mark.parametrize("cut", range(1, 40))
def test_a_message_cut_short_is_refused(cut):
    data = messages.encode("sensor_msgs/msg/JointState", messages.make("sensor_msgs/msg/JointState", name=["a"] * 3))
    if cut < len(data) - 3:  # DDS may add up to three bytes of padding, so as many may be missing
        with pytest.raises(RosError, match="the bytes are not a sensor_msgs/msg/JointState"):
            messages.decode("sensor_msgs/msg/JointState", data[:-4][: max(4, len(data) - 4 - cut)])


def test_a_count_far_beyond_the_bytes_is_refused():
    with pytest.raises(RosError, match="the bytes are not"):
        messages.decode("sensor_msgs/msg/JointState", b"\x00\x01\x00\x00" + bytes(12) + b"\xff\xff\xff\x7f" * 4)


def test_defaults_are_those_of_the_interface():
    assert messages.as_fields(messages.make("geometry_msgs/msg/Quaternion")) == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert messages.make("geometry_msgs/msg/TransformStamped").transform.rotation.w == 1.0


def test_values_are_converted_where_nothing_is_lost():
    state = messages.make("sensor_msgs/msg/JointState", name=("a", "b"), position=(1, 2), velocity=np.float32([0.5]))
    assert state.position.dtype == np.float64
    assert state.position.tolist() == [1.0, 2.0]
    image = messages.make("sensor_msgs/msg/Image", data=b"\x00\xff")
    assert image.data.tolist() == [0, 255]
    assert messages.make("geometry_msgs/msg/Point", x=np.int64(3)).x == 3.0


@pytest.mark.parametrize(
    ("type_name", "fields", "sentence"),
    [
        ("geometry_msgs/msg/Point", {"x": "1"}, r"Point\.x must be a number, got '1'"),
        ("geometry_msgs/msg/Point", {"x": [1.0]}, r"Point\.x must be a number, got \[1\.0\]"),
        ("geometry_msgs/msg/Pose", {"position": 1.0}, "made from a mapping of fields or from such a message, not from 1.0"),
        ("geometry_msgs/msg/Pose", {"position": {"r": 1}}, "geometry_msgs/msg/Point has no field 'r'"),
        ("sensor_msgs/msg/JointState", {"name": "elbow"}, r"JointState\.name must be a list, got 'elbow'"),
        ("sensor_msgs/msg/JointState", {"name": [1]}, r"JointState\.name must be text"),
        ("sensor_msgs/msg/JointState", {"position": [[1.0]]}, r"position must be a sequence of float64"),
        ("sensor_msgs/msg/JointState", {"position": ["a"]}, r"position must be a sequence of float64"),
        ("sensor_msgs/msg/Image", {"data": [256]}, r"data must be a sequence of uint8"),
        ("sensor_msgs/msg/Image", {"data": [-1]}, r"data must be a sequence of uint8"),
        ("sensor_msgs/msg/Image", {"data": [0.5]}, r"data must be a sequence of uint8"),
        ("sensor_msgs/msg/Image", {"width": -1}, "width must be an integer from 0 to 4294967295, got -1"),
        ("sensor_msgs/msg/Image", {"width": 1.0}, "width must be an integer"),
        ("std_msgs/msg/Bool", {"data": 1}, "data must be True or False, got 1"),
        ("std_msgs/msg/String", {"data": "a\0b"}, "text without zero characters"),
        ("std_msgs/msg/String", {"data": "\udcff"}, "text without zero characters and surrogates"),
        ("geometry_msgs/msg/PoseWithCovariance", {"covariance": [0.0] * 35}, "holds exactly 36 values, got 35"),
    ],
)  # fmt: skip
def test_values_that_do_not_fit_are_refused(type_name, fields, sentence):
    with pytest.raises(RosError, match=sentence):
        messages.make(type_name, fields)


@pytest.mark.parametrize("name", ["Point", "geometry_msgs/Point", "geometry_msgs/msg/point", "../msg/Point", ""])
def test_a_name_that_names_no_type_is_refused(name):
    with pytest.raises(RosError, match="is not the name of a type; expected one such as 'sensor_msgs/msg/JointState'"):
        messages.fields_of(name)


def test_an_unknown_type_names_its_neighbours():
    with pytest.raises(RosError, match="did you mean 'sensor_msgs/msg/JointState'"):
        messages.fields_of("sensor_msgs/msg/JointStates")
