"""Habits of published URDFs that are not in the format but say nothing about the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pieper.errors import PieperWarning, UrdfError
from pieper.model.urdf import from_urdf

ROBOT = """<?xml version="1.0"?>
<robot name="crank" {root}>
  <material name="steel">{material}</material>
  <link name="base"><visual><geometry><sphere radius="0.1"/></geometry><material name="steel"/></visual></link>
  <link name="tip"/>
  <joint name="turn" type="revolute">
    <parent link="base"/> <child link="tip"/> <origin xyz="0 0 1"/> <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="2" {limit}/>
  </joint>
  {end}
</robot>"""


def crank(*, root: str = "", material: str = '<color rgba="1 0 0 1"/>', limit: str = "", end: str = "") -> str:
    return ROBOT.format(root=root, material=material, limit=limit, end=end)


def limits(what: object) -> np.ndarray:
    return from_urdf(what).chain().limits  # type: ignore[arg-type]


def test_blank_lines_before_the_header(tmp_path: Path) -> None:
    path = tmp_path / "late.urdf"
    path.write_text("\n \r\n\t" + crank())
    for what in (path, path.read_bytes(), path.read_text()):
        np.testing.assert_array_equal(limits(what), [[-1.0, 1.0]])


def test_texture_without_a_file() -> None:
    robot = from_urdf(crank(material='<texture/><color rgba="1 0 0 1"/>'))
    material = robot.link("base").visuals[0].material
    assert material is not None
    assert material.texture is None
    assert material.rgba == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("encode", [str, lambda text: text.encode(), lambda text: text.encode("latin-1")])
def test_foreign_tags_whose_prefix_is_not_declared(encode: object) -> None:
    text = crank(
        limit='drake:acceleration="2.5" lower2="x"',
        end='<drake:group name="g"><drake:member link="tip"/></drake:group><other-tool:joint name="turn"/>',
    )
    np.testing.assert_array_equal(limits(encode(text)), [[-1.0, 1.0]])  # type: ignore[operator]
    declared = crank(root='xmlns:drake="http://drake.mit.edu"', limit='drake:acceleration="2.5" sdf:a="1"')
    np.testing.assert_array_equal(limits(declared), [[-1.0, 1.0]])


def test_a_foreign_prefix_is_no_way_around_the_checks() -> None:
    with pytest.raises(UrdfError, match="DOCTYPE"):
        from_urdf("<!DOCTYPE robot [<!ENTITY a 'b'>]>" + crank(limit='drake:a="1"').partition("?>")[2])
    with pytest.raises(UrdfError, match="not well-formed"):
        from_urdf("<!-- <robot > -->" + crank(limit='drake:a="1"').partition("?>")[2])
    with pytest.raises(UrdfError, match="expand a xacro file first"):
        from_urdf(crank(end="<xacro:arm/>"))
    with pytest.raises(UrdfError, match=r"unknown type 'other'"):
        from_urdf(crank(limit='drake:a="1"').replace('type="revolute"', 'type="other"'))


def test_a_mass_without_inertia_is_left_out_with_a_warning() -> None:
    text = crank(end='<link name="extra"><inertial><mass value="2"/></inertial></link>').replace(
        "</robot>",
        '<joint name="fix" type="fixed"><parent link="tip"/><child link="extra"/></joint></robot>',
    )
    with pytest.warns(PieperWarning, match="a mass without <inertia> in link 'extra'; its inertial is left out"):
        robot = from_urdf(text)
    assert robot.link("extra").inertial is None
    for wrong in ("-1", "nan", "heavy"):
        with pytest.raises(UrdfError, match="link 'extra'"):
            from_urdf(text.replace('mass value="2"', f'mass value="{wrong}"'))
