"""xacro: what expands, and that a hostile file ends in `XacroError` soon, having read nothing that is not its own."""

from __future__ import annotations

import sys

import pytest

from pieper.errors import MissingExtraError, UrdfError, XacroError
from pieper.model import xacro
from pieper.model.xacro import expand, from_xacro, is_xacro

pytest.importorskip("xacrodoc", reason="xacrodoc (pip install 'pieper[xacro]') expands xacro files")

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
SOON = 2.0  # [s] for files that never end; the others get the default, however busy the machine is
DOUBLED = "".join(f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>' for i in range(60))

ARM = f"""<?xml version="1.0" encoding="utf-8"?>
{HEAD}
  <xacro:arg name="length" default="1.0"/>
  <xacro:arg name="long" default="false"/>
  <xacro:include filename="$(find parts)/urdf/parts.xacro"/>
  <xacro:include filename="own.xacro"/>
  <xacro:property name="sizes" value="${{xacro.load_yaml('sizes.yaml')}}"/>
  <xacro:body name="base"/> <xacro:body name="tip"/>
  <xacro:if value="$(arg long)"><xacro:property name="extra" value="10"/></xacro:if>
  <xacro:unless value="$(arg long)"><xacro:property name="extra" value="0"/></xacro:unless>
  <joint name="${{joint_name}}" type="revolute">
    <parent link="base"/> <child link="tip"/>
    <origin xyz="0 0 ${{2 * $(arg length) + sizes['foot'] + extra}}" rpy="0 0 ${{pi / 2}}"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""


@pytest.fixture
def workspace(tmp_path):
    """Two packages beside each other: `arm` with the file above, `parts` with a macro."""
    arm, parts = tmp_path / "src" / "arm", tmp_path / "src" / "parts"
    for package in (arm, parts):
        (package / "urdf").mkdir(parents=True)
        (package / "package.xml").write_text(f"<package><name>{package.name}</name></package>")
    (arm / "urdf" / "arm.urdf.xacro").write_text(ARM)
    (arm / "urdf" / "own.xacro").write_text(f'{HEAD}<xacro:property name="joint_name" value="turn"/></robot>')
    (arm / "urdf" / "sizes.yaml").write_text("foot: 0.5\n")
    macro = '<xacro:macro name="body" params="name"><link name="${name}"/></xacro:macro>'
    (parts / "urdf" / "parts.xacro").write_text(f"{HEAD}{macro}</robot>")
    (tmp_path / "secret.yaml").write_text("password: xyzzy\n")
    (tmp_path / "secret.xacro").write_text(f'{HEAD}<link name="xyzzy"/></robot>')
    return tmp_path / "src"


def test_files_with_includes_packages_yaml_and_arguments(workspace):
    file = workspace / "arm" / "urdf" / "arm.urdf.xacro"
    robot = from_xacro(file)
    assert robot.source == str(file)
    assert robot.chain().joint_names == ("turn",)
    assert robot.chain().home[2, 3] == 2.5
    assert from_xacro(str(file), args={"length": 3, "long": True}).chain().home[2, 3] == 16.5


def test_packages_given_by_the_caller(workspace, tmp_path):
    (workspace / "parts").rename(tmp_path / "elsewhere")
    file = workspace / "arm" / "urdf" / "arm.urdf.xacro"
    with pytest.raises(XacroError) as caught:
        from_xacro(file)
    assert caught.value.element == "package 'parts'"
    assert "give its folder, packages={name: folder}" in caught.value.reason
    for packages in ({"parts": tmp_path / "elsewhere"}, [tmp_path / "elsewhere"], str(tmp_path)):
        assert from_xacro(file, packages=packages).chain().dof == 1


def test_packages_on_the_ros_path(workspace, tmp_path, monkeypatch):
    (tmp_path / "ros").mkdir()
    (workspace / "parts").rename(tmp_path / "ros" / "parts")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert from_xacro(workspace / "arm" / "urdf" / "arm.urdf.xacro").chain().dof == 1


def test_linked_workspaces(workspace, tmp_path):
    """A ROS 2 workspace installed with links: the files lie elsewhere."""
    share = tmp_path / "install" / "share"
    for package in ("arm", "parts"):
        (share / package / "urdf").mkdir(parents=True)
        for file in (workspace / package).rglob("*.*"):
            if file.is_file():
                (share / package / file.relative_to(workspace / package)).symlink_to(file)
    assert from_xacro(share / "arm" / "urdf" / "arm.urdf.xacro").chain().dof == 1


def test_text():
    urdf = expand(f'{HEAD}<xacro:property name="n" value="base"/><link name="${{n}}"/></robot>')
    assert '<link name="base"/>' in urdf
    assert from_xacro(f'{HEAD}<link name="a"/></robot>').source == "<string>"


def test_what_is_xacro(tmp_path):
    assert is_xacro("arm.urdf.xacro")
    assert is_xacro(tmp_path / "arm.xacro")
    assert is_xacro(ARM)
    assert is_xacro(ARM.encode())
    assert not is_xacro("arm.urdf")
    assert not is_xacro("<robot name='r'/>")
    assert not is_xacro(f"{HEAD}<link name='a'/></robot>"), "an expanded file often keeps the namespace"
    assert not is_xacro(3)


def test_what_comes_out_is_checked():
    with pytest.raises(UrdfError, match="has 2 roots"):
        from_xacro(f'{HEAD}<link name="a"/><link name="b"/></robot>')


def test_without_xacrodoc_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(xacro, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"xacrodoc is not installed; .* pip install 'pieper\[xacro\]'"):
        expand(ARM)


# what is written: (inside of the robot, element, part of the reason)
FAULTS = {
    "infinite macro": ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', "macro 'm'", "does not end"),
    "exponential growth": (DOUBLED + '<xacro:macro name="m60"/><xacro:m0/>', "expansion", "took longer than"),
    "endless number": ('<link name="${10**10**10}"/>', "expansion", "took longer than"),
    "much memory": ("<link name=\"${'x' * 10**10}\"/>", "expansion", "needs more than 1024 MiB of memory"),
    "much output": (f"<link name=\"${{'x' * {17 * 2**20}}}\"/>", "expansion", "gives more than 16 MiB"),
    "yaml of the system": (
        "<link name=\"${xacro.load_yaml('/etc/passwd')}\"/>",
        "expansion",
        "reads the file '/etc/passwd', which is refused",
    ),
    "include of the system": ('<xacro:include filename="/etc/passwd"/>', "expansion", "reads the file '/etc/passwd'"),
    "optional include": (
        '<xacro:include filename="/etc/passwd" optional="true"/><link name="a"/>',
        "expansion",
        "reads the file",
    ),
    "pattern": ('<xacro:include filename="/etc/*"/><link name="a"/>', "expansion", "lists the folder '/etc/*'"),
    "system folder as package": (
        "<link name=\"${xacro.load_yaml('$(find etc)/passwd')}\"/>",
        "package 'etc'",
        "not found",
    ),
    "document type": ('<link name="a"/>', "document type", "<!DOCTYPE> and entities are refused"),
    "unknown property": ('<link name="${nothing}"/>', "expansion", "name 'nothing' is not defined"),
    "unknown macro": ('<link name="a"/><xacro:nothing/>', "expansion", "unknown macro name: xacro:nothing"),
    "unknown argument": ('<link name="$(arg nothing)"/>', "expansion", "nothing"),
    "python builtins": ("<link name=\"${open('/etc/passwd')}\"/>", "expansion", "name 'open' is not defined"),
    "python classes": ('<link name="${().__class__}"/>', "expansion", "__"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_and_attacks(fault):
    if fault == "much memory" and not sys.platform.startswith("linux"):
        pytest.skip("only Linux bounds the address space")
    inside, element, reason = FAULTS[fault]
    head = '<!DOCTYPE r [<!ENTITY a "b">]>' + HEAD if fault == "document type" else HEAD
    timeout = SOON if reason == "took longer than" else xacro.DEFAULT_TIMEOUT
    with pytest.raises(XacroError) as caught:
        expand(head + inside + "</robot>", timeout=timeout)
    assert (caught.value.source, caught.value.element) == ("<string>", element)
    assert reason in caught.value.reason
    assert len(str(caught.value)) < 3000


ESCAPES = {
    "include": '<xacro:include filename="../../../secret.xacro"/>',
    "include by package": '<xacro:include filename="$(find arm)/../../secret.xacro"/>',
    "yaml": "<link name=\"${xacro.load_yaml('../../../secret.yaml')['password']}\"/>",
    "pattern": '<xacro:include filename="../../../*.xacro"/>',
    "link": '<xacro:include filename="linked.xacro"/>',
    "linked folder": '<xacro:include filename="up/secret.xacro"/>',
}


@pytest.mark.parametrize("way", ESCAPES)
def test_files_outside_the_packages_are_not_read(way, workspace):
    folder = workspace / "arm" / "urdf"
    (folder / "linked.xacro").symlink_to(workspace.parent / "secret.xacro")
    (folder / "up").symlink_to(workspace.parent)
    file = folder / "escape.xacro"
    file.write_text(f"{HEAD}<link name='a'/>{ESCAPES[way]}</robot>")
    with pytest.raises(XacroError) as caught:
        expand(file)
    assert "which is refused; readable folders are: " in caught.value.reason
    assert "xyzzy" not in str(caught.value)
    assert "xyzzy" in expand(file, packages=[workspace.parent]), "the caller may open the folder"


def test_a_file_that_includes_itself(tmp_path):
    file = tmp_path / "loop.xacro"
    file.write_text(f'{HEAD}<xacro:include filename="loop.xacro"/></robot>')
    with pytest.raises(XacroError, match="does not end: a macro calls itself, or a file includes itself"):
        expand(file)


@pytest.mark.parametrize("text", ["", "<robot", "\0\1\2", "<robot xmlns:xacro='x'><xacro:a/></robot>"])
def test_broken_files(text, tmp_path):
    file = tmp_path / "broken.xacro"
    file.write_text(text)
    with pytest.raises((XacroError, UrdfError)) as caught:
        from_xacro(file)
    assert caught.value.source == str(file)


def test_missing_files(tmp_path):
    for what in (tmp_path / "nowhere.xacro", tmp_path, "a\0b.xacro"):
        with pytest.raises(XacroError, match="cannot be read: no such file"):
            expand(what)
