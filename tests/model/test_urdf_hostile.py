"""Malformed and hostile URDFs: each fault raises `UrdfError` with source, element and reason, and nothing else comes out."""

from __future__ import annotations

import os
import random
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import AmbiguousError, PieperError, PieperWarning, UrdfError
from pieper.model import urdf
from pieper.model.chain import Chain
from pieper.model.urdf import as_urdf, from_urdf
from tests.model.random_trees import urdf_trees

LINKS = '<link name="a"/><link name="b"/><link name="c"/>'


def joint(
    name: str = "j",
    kind: str = "revolute",
    parent: str = "a",
    child: str = "b",
    inside: str = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>',
) -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def robot(*joints: str, links: str = LINKS) -> str:
    return f'<robot name="r">{links}{"".join(joints)}</robot>'


TAIL = joint("tail", "fixed", "b", "c", "")
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def with_origin(xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return robot(joint(inside=f'<origin xyz="{xyz}" rpy="{rpy}"/>{LIMIT}'), TAIL)


def with_limit(**limits: str) -> str:
    given = {"lower": "-1", "upper": "1", "effort": "1", "velocity": "1", **limits}
    return robot(joint(inside="<limit " + " ".join(f'{k}="{v}"' for k, v in given.items()) + "/>"), TAIL)


def with_link(inside: str) -> str:
    return robot(joint(), TAIL, links=f'<link name="a">{inside}</link><link name="b"/><link name="c"/>')


LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a0 "lol">'
    + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    + ']><robot name="&a11;"/>'
)

# what came: (text, element, part of the reason)
FAULTS: dict[str, tuple[str | bytes, str, str]] = {
    # hostile XML
    "billion laughs": (LAUGHS, "document type", "<!DOCTYPE> is refused"),
    "quadratic blowup": (
        f'<!DOCTYPE r [<!ENTITY a "{"x" * 50000}">]><robot name="{"&a;" * 1000}"/>',
        "document type",
        "refused",
    ),
    "external entity": (
        '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="r"><link name="&a;"/></robot>',
        "document type",
        "refused",
    ),
    "external dtd": ('<!DOCTYPE robot SYSTEM "http://example.org/x.dtd"><robot name="r"/>', "document type", "refused"),
    "parameter entity": (
        '<!DOCTYPE r [<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;]><robot/>',
        "document type",
        "refused",
    ),
    "harmless document type": ("<!DOCTYPE robot><robot name='r'><link name='a'/></robot>", "document type", "refused"),
    "undefined entity": ('<robot name="&nbsp;"/>', "document", "undefined entity"),
    "depth bomb": ("<robot name='r'>" + "<a>" * 200_000, "document", "is nested more than 64 elements deep"),
    "too many elements": (
        "<robot name='r'>" + "<a/>" * 150_000 + "</robot>",
        "document",
        "has more than 100000 elements",
    ),
    "too many attributes": (
        "<robot " + " ".join(f'a{i}=""' for i in range(1000)) + "/>",
        "<robot>",
        "more than 100 attributes",
    ),
    "too large": ("<robot name='r'>" + " " * 17 * 2**20, "document", "larger than 16 MiB"),
    "too large in bytes": (b"<" + b" " * 17 * 2**20, "document", "larger than 16 MiB"),
    # broken XML
    "empty": ("", "document", "is empty"),
    "blank": (" \n\t ", "document", "is empty"),
    "empty bytes": (b"", "document", "is empty"),
    "text": ("hello\nworld", "document", "not well-formed XML"),
    "binary": (bytes(range(256)), "document", "not well-formed XML"),
    "zeros": (bytes(1000), "document", "not well-formed XML"),
    "stl": (b"\0" * 80 + b"\x02\0\0\0" + os.urandom(100), "document", "not well-formed XML"),
    "truncated": (robot(joint(), TAIL)[:200], "document", "not well-formed XML"),
    "truncated inside": (robot(joint(), TAIL).removesuffix("</robot>"), "document", "the file may be cut off"),
    "two roots in XML": ("<robot name='r'><link name='a'/></robot><robot/>", "document", "junk after document element"),
    "mismatched tags": ("<robot name='r'><link></robot></link>", "document", "mismatched tag"),
    "attribute twice": ("<robot name='r' name='s'/>", "document", "duplicate attribute"),
    "unknown encoding": (b'<?xml version="1.0" encoding="klingon"?><robot name="r"/>', "document", "encoding"),
    "wrong encoding": (
        '<?xml version="1.0" encoding="utf-8"?><robot name="ü"/>'.encode("latin-1"),
        "document",
        "not well-formed",
    ),
    "lone surrogate": ("<robot name='\ud800'/>", "document", "cannot be decoded"),
    "control character": ("<robot name='\x01'/>", "document", "not well-formed XML"),
    "endless name": (robot(joint(name="x" * 10**6), TAIL), "<joint>", "is longer than 1000 characters"),
    "endless parent": (robot(joint(parent="x" * 10**6), TAIL), "joint 'j'", "is longer than 1000 characters"),
    # not a robot
    "another root": ("<sdf version='1.7'/>", "<sdf>", "the root element must be <robot>"),
    "html": ("<html><body>404 not found</body></html>", "<html>", "the root element must be <robot>"),
    "no name": ("<robot><link name='a'/></robot>", "<robot>", "needs a name"),
    "no links": ("<robot name='r'/>", "robot 'r'", "has no links"),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>',
        "<xacro:include>",
        "is not expanded",
    ),
    "xacro without its namespace": (
        '<robot name="r"><xacro:include filename="x"/></robot>',
        "document",
        "expand a xacro file first",
    ),
    "xacro expression": (with_origin(xyz="${x} 0 0"), "joint 'j'", "expand the xacro file first"),
    # the tree
    "unknown parent": (robot(joint(parent="x"), TAIL), "joint 'j'", "parent 'x' is not a link"),
    "unknown child": (robot(joint(child="x"), TAIL), "joint 'j'", "child 'x' is not a link"),
    "parent is child": (robot(joint(child="a"), TAIL), "joint 'j'", "parent and child are the same link"),
    "cycle": (
        robot(joint(), TAIL, joint("k", parent="c", child="a")),
        "joint 'j'",
        "the joints form a cycle",
    ),
    "cycle beside the root": (
        robot(joint("j", parent="b", child="c"), joint("k", parent="c", child="b")),
        "joint 'k'",
        "link 'b' is part of a cycle",
    ),
    "two roots": (robot(joint()), "robot 'r'", "has 2 roots ('a', 'c')"),
    "two parents": (robot(joint(), joint("k", parent="c")), "joint 'k'", "link 'b' is already the child of joint 'j'"),
    "link twice": (robot(joint(), TAIL, links=LINKS + '<link name="a"/>'), "link 'a'", "the name is given twice"),
    "joint twice": (robot(joint(), joint(child="c")), "joint 'j'", "the name is given twice"),
    "link without name": (robot(links="<link/>"), "<link>", "needs a name"),
    "joint without name": (robot(joint(name=""), TAIL), "<joint>", "needs a name"),
    # joints
    "no type": (robot(joint().replace('type="revolute"', ""), TAIL), "joint 'j'", "needs the attribute 'type'"),
    "unknown type": (
        robot(joint(kind="spherical"), TAIL),
        "joint 'j'",
        "unknown type 'spherical'; types are: revolute",
    ),
    "type in capitals": (robot(joint(kind="Revolute"), TAIL), "joint 'j'", "unknown type 'Revolute'"),
    "no parent": (robot(joint().replace('<parent link="a"/>', ""), TAIL), "joint 'j'", "needs a <parent> element"),
    "no child": (robot(joint().replace('<child link="b"/>', ""), TAIL), "joint 'j'", "needs a <child> element"),
    "parent without link": (robot(joint().replace('link="a"', ""), TAIL), "joint 'j'", "needs the attribute 'link'"),
    "two parents in a joint": (robot(joint(inside='<parent link="c"/>'), TAIL), "joint 'j'", "has 2 <parent> elements"),
    "two origins": (robot(joint(inside="<origin/><origin/>"), TAIL), "joint 'j'", "has 2 <origin> elements"),
    "zero axis": (robot(joint(inside=f'<axis xyz="0 0 0"/>{LIMIT}'), TAIL), "joint 'j'", "the axis is zero"),
    "nan axis": (
        robot(joint(inside=f'<axis xyz="0 nan 1"/>{LIMIT}'), TAIL),
        "joint 'j'",
        "xyz of <axis> must be finite",
    ),
    "axis of two": (robot(joint(inside=f'<axis xyz="0 1"/>{LIMIT}'), TAIL), "joint 'j'", "needs 3 numbers, got 2"),
    "axis without xyz": (robot(joint(inside=f"<axis/>{LIMIT}"), TAIL), "joint 'j'", "needs the attribute 'xyz'"),
    # numbers
    "nan origin": (with_origin(xyz="0 NaN 0"), "joint 'j'", "xyz of <origin> must be finite, got 'NaN'"),
    "infinite origin": (with_origin(rpy="0 -inf 0"), "joint 'j'", "rpy of <origin> must be finite"),
    "huge number": (with_origin(xyz="1e999 0 0"), "joint 'j'", "too large for a number"),
    "far away": (with_origin(xyz="1e12 0 0"), "joint 'j'", "must be within +-1e+09"),
    "many digits": (with_origin(xyz="9" * 100_000 + " 0 0"), "joint 'j'", "must be a number"),
    "two numbers": (with_origin(xyz="0 0"), "joint 'j'", "xyz of <origin> needs 3 numbers, got 2"),
    "four numbers": (with_origin(rpy="0 0 0 1"), "joint 'j'", "rpy of <origin> needs 3 numbers, got more than 3"),
    "no number": (with_origin(xyz=""), "joint 'j'", "needs 3 numbers, got 0"),
    "a million numbers": (with_origin(xyz="0 " * 1_000_000), "joint 'j'", "got more than 3"),
    "words": (with_origin(xyz="one two three"), "joint 'j'", "must be a number, got 'one'"),
    "commas": (with_origin(xyz="0,1 0,2 0,3"), "joint 'j'", "must be a number, got '0,1'"),
    "python number": (with_origin(xyz="1_000 0 0"), "joint 'j'", "must be a number"),
    "arabic digits": (with_origin(xyz="٣ 0 0"), "joint 'j'", "must be a number"),
    "hexadecimal": (with_origin(xyz="0x10 0 0"), "joint 'j'", "must be a number"),
    "limits swapped": (with_limit(lower="1", upper="-1"), "joint 'j'", "limits must be lower <= upper"),
    "nan limit": (with_limit(lower="nan"), "joint 'j'", "lower of <limit> must be finite"),
    "infinite limit": (with_limit(upper="inf"), "joint 'j'", "upper of <limit> must be finite"),
    "empty limit": (with_limit(effort=""), "joint 'j'", "effort of <limit> needs 1 number, got 0"),
    "negative velocity": (with_limit(velocity="-1"), "joint 'j'", "velocity limit must not be negative"),
    # mimic
    "mimic of nothing": (
        robot(joint(inside=f'{LIMIT}<mimic joint="k"/>'), TAIL),
        "joint 'j'",
        "mimics 'k', which is no joint",
    ),
    "mimic without joint": (robot(joint(inside=f"{LIMIT}<mimic/>"), TAIL), "joint 'j'", "needs the attribute 'joint'"),
    "mimic circle": (
        robot(
            joint(inside=f'{LIMIT}<mimic joint="k"/>'),
            joint("k", parent="b", child="c", inside=f'{LIMIT}<mimic joint="j"/>'),
        ),
        "joint 'j'",
        "mimics itself",
    ),
    "mimic nan": (
        robot(joint(inside=f'{LIMIT}<mimic joint="j" multiplier="nan"/>'), TAIL),
        "joint 'j'",
        "multiplier of <mimic> must be finite",
    ),
    # links
    "visual without geometry": (with_link("<visual/>"), "link 'a'", "needs a <geometry> element"),
    "empty geometry": (with_link("<visual><geometry/></visual>"), "link 'a'", "needs one box, cylinder"),
    "two shapes": (
        with_link('<visual><geometry><sphere radius="1"/><box size="1 1 1"/></geometry></visual>'),
        "link 'a'",
        "sphere or mesh, got 2",
    ),
    "mesh without file": (
        with_link("<visual><geometry><mesh/></geometry></visual>"),
        "link 'a'",
        "needs the attribute 'filename'",
    ),
    "negative radius": (
        with_link('<collision><geometry><sphere radius="-1"/></geometry></collision>'),
        "link 'a'",
        "radius of <sphere> must not be negative",
    ),
    "negative box": (
        with_link('<collision><geometry><box size="1 -1 1"/></geometry></collision>'),
        "link 'a'",
        "size of <box> must not be negative",
    ),
    "bad colour": (
        robot(joint(), TAIL, links='<material name="m"><color rgba="1 0 0"/></material>' + LINKS),
        "material 'm'",
        "rgba of <color> needs 4 numbers, got 3",
    ),
    "inertia nan": (
        with_link('<inertial><mass value="1"/><inertia ixx="nan" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'),
        "link 'a'",
        "ixx of <inertia> must be finite",
    ),
    "inertial without mass": (with_link("<inertial/>"), "link 'a'", "needs a <mass> element"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_name_source_element_and_reason(fault):
    what, element, reason = FAULTS[fault]
    with pytest.raises(UrdfError) as caught:
        from_urdf(what, source="robot.urdf")
    assert caught.value.source == "robot.urdf"
    assert caught.value.element == element
    assert reason in caught.value.reason
    assert caught.value.reason.count("robot.urdf") == 0, "one error, not an error in an error"
    assert len(str(caught.value)) < 1000, "a message is for reading, also when the input is huge"


@pytest.mark.parametrize("fault", ["billion laughs", "binary", "truncated", "cycle", "too large"])
def test_faults_in_files_name_the_file(fault, tmp_path):
    what, element, _ = FAULTS[fault]
    file = tmp_path / "robot.urdf"
    file.write_bytes(what if isinstance(what, bytes) else what.encode())
    with pytest.raises(UrdfError) as caught:
        from_urdf(file)
    assert (caught.value.source, caught.value.element) == (str(file), element)


@pytest.mark.parametrize("what", [None, 3, ["<robot/>"], object()])
def test_other_things_are_refused(what):
    with pytest.raises(UrdfError, match="must be URDF text or a file name, got"):
        from_urdf(what)


@pytest.mark.parametrize("name", ["nowhere.urdf", "a\0b", "x" * 5000, "~", "/dev/null/x", "http://example.org/a.urdf"])
def test_names_of_no_file_are_refused(name):
    with pytest.raises(UrdfError) as caught:
        from_urdf(name)
    assert caught.value.element == "file"
    assert len(str(caught.value)) < 1000


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs a device file")
def test_devices_are_not_read():
    with pytest.raises(UrdfError, match="is not a regular file"):
        from_urdf("/dev/zero")


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_floating_and_planar_joints_are_read_and_named_when_on_the_path(kind):
    description = from_urdf(robot(joint(kind=kind), TAIL))
    with pytest.raises(UrdfError, match=f"joint 'j': {kind} joints are unsupported"):
        description.chain()
    assert description.chain(base="b").tip == "c"


def test_limits_are_only_just_exceeded():
    deepest = "<a>" * (urdf.MAX_DEPTH - 1) + "</a>" * (urdf.MAX_DEPTH - 1)
    from_urdf(f"<robot name='r'><link name='a'/>{deepest}</robot>")
    with pytest.raises(UrdfError, match="nested"):
        from_urdf(f"<robot name='r'><link name='a'/><a>{deepest}</a></robot>")


def many(count: int, parent=lambda i: i, inside=lambda i: LIMIT) -> str:
    """A robot of `count` joints; `parent` of link i + 1 and the `inside` of joint i are given."""
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = (joint(f"j{i}", parent=f"l{parent(i)}", child=f"l{i + 1}", inside=inside(i)) for i in range(count))
    return robot(*joints, links=links)


# Files that cost the square of their length where each joint looks at all others. There is no clock here: with such a
# mistake these tests take minutes, or all memory, instead of a second or two.
LARGE = {
    "a long chain": (many(15_000), "joint 'j2000': is behind 2000 moving joints"),
    "a long chain of followers": (
        many(15_000, inside=lambda i: LIMIT + (f'<mimic joint="j{i - 1}"/>' if i else "")),
        "joint 'j2000': is behind 2000 moving joints",
    ),
    "a bush": (many(15_000, parent=lambda i: i // 2), "several chains fit"),
    "a cycle far down": (
        robot(
            *(
                joint(f"j{i}", parent=f"l{i}", child=f"l{i + 1 if i < 14_000 else 7000}")
                for i in range(14_001)
                if i != 6999
            ),
            links="".join(f'<link name="l{i}"/>' for i in range(14_001)),
        ),
        "is part of a cycle",
    ),
    "no such parent among many": (
        robot(
            *(joint(f"j{i}", parent="a" * 900 + str(i), child="a" * 900) for i in range(1)),
            links="".join(f'<link name="{"a" * 900}{i or ""}"/>' for i in range(10_000, 0, -1)),
        ),
        "is not a link",
    ),
    "many meshes": (
        robot(
            links="".join(
                f'<link name="l{i}"><visual><geometry><mesh filename="package://p/{i}.stl"/></geometry></visual></link>'
                for i in range(10_000)
            )
        ),
        "has 10000 roots",
    ),
}


@pytest.mark.parametrize("case", LARGE)
def test_large_files_take_no_square_of_their_length(case):
    text, message = LARGE[case]
    with pytest.raises(PieperError, match=message):
        default_chain(text)


def default_chain(text: str) -> Chain:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PieperWarning)
        return from_urdf(text).chain()


def test_a_thousand_links_are_no_problem():
    links = "".join(f'<link name="l{i}"/>' for i in range(1000))
    joints = "".join(joint(f"j{i}", parent=f"l{i}", child=f"l{i + 1}") for i in range(999))
    assert from_urdf(robot(joints, links=links)).chain().dof == 999


# --- whatever comes in


def read(what: str | bytes) -> None:
    """Only a robot or `UrdfError` comes out; an accepted robot can be cut, written and read again."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", PieperWarning)
        try:
            description = from_urdf(what)
        except UrdfError as fault:
            if not (fault.source and fault.element and fault.reason):
                raise
            return
        try:
            chain = description.chain()
        except (AmbiguousError, UrdfError):
            chain = None
        again = from_urdf(as_urdf(description))
        assert [link.name for link in again.links] == [link.name for link in description.links]
        if chain is not None:
            size = max(1.0, float(np.abs(chain.home).max()))
            home = again.chain(chain.base, chain.tip).home
            np.testing.assert_allclose(home, chain.home, rtol=0, atol=1e-12 * size)


@given(st.text(max_size=300))
def test_any_text(text):
    read("<" + text)


@given(st.text(alphabet="<>/=\"'&;![]-?: robotlinkjn012", max_size=200))
def test_any_text_of_xml_characters(text):
    read("<robot name='r'>" + text + "</robot>")


@given(st.binary(max_size=300))
def test_any_bytes(data):
    read(data)


@given(st.binary(max_size=20))
def test_any_bytes_in_a_robot(data):
    read(b"<robot name='r'><link name='" + data + b"'/></robot>")


@given(st.text(max_size=40))
def test_any_name_of_a_file(name):
    try:
        from_urdf(name)
    except PieperError:
        return


@given(urdf_trees(max_links=5), st.integers(0, 2**31), st.integers(1, 4))
def test_mutated_robots(text, seed, changes):
    """Cut, doubled, swapped and replaced pieces of a valid robot."""
    rng = random.Random(seed)
    pieces = [
        "nan",
        "1e400",
        "-",
        "",
        "<",
        ">",
        '"',
        "l0",
        "j1",
        "<link/>",
        "</joint>",
        "\0",
        "&",
        "\u2028",
        "0 0 0",
        "-1e-320",
    ]
    for _ in range(changes):
        i, j = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        j = min(j, i + rng.choice([0, 1, 5, 40, 400]))
        part = rng.choice([rng.choice(pieces), text[i:j] * 2, text[i:j][::-1], ""])
        text = text[:i] + part + text[j:]
    read("<" + text.lstrip("<"))


@given(
    urdf_trees(max_links=5),
    st.integers(0, 2**31),
    st.sampled_from(["l0", "l1", "l2", "j1", "j2", "", "nan", "1e308", "-4"]),
)
def test_exchanged_attributes(text, seed, value):
    """One attribute of a valid robot gets another value: the XML stays well-formed, the checks behind it are met."""
    parts = text.split('"')
    inside = range(1, len(parts), 2)
    parts[random.Random(seed).choice(inside)] = value
    read('"'.join(parts))
