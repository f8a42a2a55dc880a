"""URDF in and out: a strict reader on a hardened XML parser, and a writer that loses no digit.

The reader takes nothing on trust. Document types and entities are refused, size, depth and counts are limited, every
number has to be a finite number, and the links and joints have to form one tree. Each fault is a `UrdfError` that
names the source, the element and the reason; nothing is repaired in silence.

The format is described at http://wiki.ros.org/urdf/XML. Two points differ from it, both so that a gap in the file does
not turn into a stiff joint: a revolute or prismatic joint without a limit is taken as unlimited on that side, with a warning, and a
limit beyond 1e30 in size, which some exporters write for *none*, counts as none. Three habits of published files that say
nothing about the robot are let pass: blank lines before the XML header, an empty ``<texture/>``, and tags or attributes
of another program (``drake:acceleration``) whose prefix is not declared.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pieper.errors import DescriptionError, UrdfError
from pieper.model._urdf_reader import UrdfReader
from pieper.model._urdf_writer import UrdfWriter
from pieper.model._urdf_xml import MAX_ATTRIBUTES, MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS, parse, text_of
from pieper.model.chain import Chain
from pieper.model.description import (
    Description,
)

if TYPE_CHECKING:
    import os

    from pieper.model.package import PackageFolders

__all__ = ["MAX_ATTRIBUTES", "MAX_BYTES", "MAX_DEPTH", "MAX_ELEMENTS", "as_urdf", "from_urdf"]


def from_urdf(
    what: str | bytes | os.PathLike[str],
    *,
    packages: PackageFolders | None = None,
    source: str | None = None,
    beside: str | os.PathLike[str] | None = None,
) -> Description:
    """Read a URDF.

    Parameters
    ----------
    what : str, bytes or path
        URDF text (a str that starts with ``<``, with or without an encoding header), its bytes, or a file name.
    packages : mapping or iterable, optional
        Folders for ``package://``, see `pieper.model.package.find_package`.
    source : str, optional
        Name for messages; the file name or ``<string>``.
    beside : path, optional
        The file that text came from, so that its meshes are found; a file name as `what` implies it.

    Returns
    -------
    Description

    Raises
    ------
    UrdfError
        Anything malformed, hostile or too large, with source, element and reason.

    Warns
    -----
    PieperWarning
        Mesh files that were not found (kinematics needs none), and joints without limits.

    Examples
    --------
    >>> robot = from_urdf('''<?xml version="1.0" encoding="utf-8"?>
    ... <robot name="slider">
    ...   <link name="rail"/> <link name="cart"/>
    ...   <joint name="slide" type="prismatic">
    ...     <parent link="rail"/> <child link="cart"/>
    ...     <axis xyz="0 0 2"/> <limit lower="0" upper="0.5" effort="10" velocity="1"/>
    ...   </joint>
    ... </robot>''')
    >>> robot.joint("slide").axis
    array([0., 0., 1.])
    >>> robot.chain().limits
    array([[0. , 0.5]])
    """
    text, name, file = text_of(what, source)
    if file is None and beside is not None:
        file = Path(beside)
    reader = UrdfReader(name, packages, file)
    description = reader.description(parse(text, name))
    reader.warn()
    return description


def as_urdf(robot: Chain | Description) -> str:
    """Write a URDF.

    Numbers are printed so that they read back as the same number; poses go through roll, pitch and yaw, which costs
    rounding only. A chain becomes the links of `Chain.frames`; coupled axes become mimic joints.

    Parameters
    ----------
    robot : Chain or Description

    Returns
    -------
    str

    Raises
    ------
    UrdfError
        The chain has an axis that depends on several joints, a name holds a character that XML cannot carry, or a
        number is so large that `from_urdf` would refuse it.
    DescriptionError
        What is given is neither.

    Notes
    -----
    Consumers that ask for every limit (urdfdom) can read the result: an effort or velocity that is not limited is
    written as the largest float, which `from_urdf` reads as none.

    Examples
    --------
    >>> import numpy as np
    >>> chain = Chain("turner", [[0, 0, 0, 0, 0, 1]], np.eye(4), [[-1, 1]], ("turn",), base="floor", tip="top")
    >>> print(as_urdf(chain))  # doctest: +ELLIPSIS
    <?xml version="1.0"?>
    <robot name="turner">
      <link name="floor"/>
    ...
      <joint name="turn" type="revolute">
    ...
    >>> from_urdf(as_urdf(chain)).chain("floor", "top").screws
    array([[0., 0., 0., 0., 0., 1.]])
    """
    if isinstance(robot, Chain):
        try:
            robot = Description.from_chain(robot)
        except UrdfError:
            raise
        except DescriptionError as fault:
            raise UrdfError(fault.source, fault.element, fault.reason) from None
    if not isinstance(robot, Description):
        raise DescriptionError(
            type(robot).__name__, "robot", "expected a Chain or a Description, as `arm.chain` and `arm.description` are"
        )
    return UrdfWriter(robot).text()
