"""Type hashes against those that rosidl published, and the interface texts that they vouch for.

The hash of a type covers its name and the names, order and types of its fields, down to the last nested one, so an
equal hash proves the text of an interface. It does not cover constants and default values.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="ROS 2 messages need the extra pieper[ros]")

from pieper.ros import messages

GOLDEN = json.loads((Path(__file__).parent / "golden" / "rihs01.json").read_text(encoding="utf-8"))
PUBLISHED = {type_name: value for source in GOLDEN["sources"] for type_name, value in source["hashes"].items()}
INTERFACES = Path(messages.__file__).parent / "interfaces"
TEXTS = sorted(text for text in INTERFACES.glob("*/*/*.*") if text.parts[-3] != "pieper_interfaces")  # our own
PARTS = {"msg": [""], "srv": ["_Request", "_Response"], "action": ["_Goal", "_Result", "_Feedback"]}


def types_of(text: Path) -> list[str]:
    package, kind = text.parts[-3:-1]
    return [f"{package}/{kind}/{text.stem}{part}" for part in PARTS[kind]]


def test_at_least_100_standard_types_have_a_hash_that_rosidl_published() -> None:
    written_by_rosidl = [source for source in GOLDEN["sources"] if source["made_by"] == "rosidl"]
    assert sum(len(source["hashes"]) for source in written_by_rosidl) >= 100


@pytest.mark.parametrize("package", sorted({name.split("/")[0] for name in PUBLISHED}))
def test_type_hashes_are_the_published_ones(package: str) -> None:
    published = {name: value for name, value in PUBLISHED.items() if name.split("/")[0] == package}
    assert {name: messages.type_hash(name) for name in published} == published


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: "/".join(text.parts[-3:]))
def test_every_interface_text_has_a_published_hash(text: Path) -> None:
    assert [name for name in types_of(text) if name not in PUBLISHED] == []


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: "/".join(text.parts[-3:]))
def test_an_empty_message_of_every_interface_text_survives_the_wire(text: Path) -> None:
    for name in types_of(text):
        message = messages.make(name)
        again = messages.decode(name, messages.encode(name, message))
        assert messages.as_fields(again) == messages.as_fields(message)


@pytest.mark.parametrize(
    ("type_name", "field", "value"),
    [
        ("geometry_msgs/msg/Quaternion", "w", 1.0),
        ("sensor_msgs/msg/NavSatStatus", "status", -2),
        ("type_description_interfaces/srv/GetTypeDescription_Request", "include_type_sources", True),
    ],
)
def test_default_values_are_those_of_rosidl(type_name: str, field: str, value: object) -> None:
    assert getattr(messages.make(type_name), field) == value
