"""Everything that pieper raises on purpose.

A message says what was expected, what came, and what to do. Unreachable targets and solvers that did not converge are
results, not exceptions; only malformed input raises.
"""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class PieperError(Exception):
    """Base of every error that pieper raises on purpose."""


class ArrayError(PieperError, ValueError):
    """An array has the wrong shape, the wrong type, or holds NaN or infinity."""


class UnknownNameError(PieperError, LookupError):
    """A robot, joint, link or frame name that is not there; the message lists near matches."""


class AmbiguousError(PieperError, ValueError):
    """More than one answer fits, for example several chains in one description; the message lists them."""


class MotionError(PieperError, ValueError):
    """A motion that the arm must not make: out of its limits, too fast, or beginning where the arm is not."""


class WorldError(PieperError, ValueError):
    """A world of obstacles, or a solid in it, is malformed."""


class DescriptionError(PieperError, ValueError):
    """A robot description is malformed.

    Attributes
    ----------
    source : str
        File name, or ``<string>``.
    element : str
        The element at fault, for example ``joint 'elbow'``.
    reason : str
        What is wrong with it, and what was expected.
    """

    def __init__(self, source: str, element: str, reason: str) -> None:
        super().__init__(f"{source}: {element}: {reason}")
        self.source = source
        self.element = element
        self.reason = reason

    def __reduce__(self) -> tuple[type[DescriptionError], tuple[str, str, str]]:
        return type(self), (self.source, self.element, self.reason)


class UrdfError(DescriptionError):
    """A URDF is malformed, hostile, or uses a joint type that has no place in a serial arm."""


class XacroError(DescriptionError):
    """A xacro file could not be expanded within its limits."""


class DhError(DescriptionError):
    """Denavit-Hartenberg rows are malformed."""


class MissingExtraError(PieperError, ImportError):
    """A package of an optional extra is not installed; the message says which extra to install."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(f"{package} is not installed; {purpose} needs it: pip install 'pieper[{extra}]'")
        self.package = package
        self.extra = extra
        self.purpose = purpose

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str]]:
        return type(self), (self.package, self.extra, self.purpose)


class MissingLibraryError(PieperError, ImportError):
    """A library of the operating system is not installed; the message names the packages that bring it."""


class VisionError(PieperError, ValueError):
    """A video, colour model, calibration or pattern is malformed, or does not suffice."""


class MapError(PieperError, ValueError):
    """A map of a workspace, the store that holds it, or a chunk of the work is not what it has to be."""


class RosError(PieperError):
    """A ROS 2 name, type, message, parameter or network setting is not what it has to be."""


class PieperWarning(UserWarning):
    """Something was missing or doubtful, and the work went on without it."""


def unknown_name(kind: str, name: str, known: Iterable[str], where: str = "") -> UnknownNameError:
    """Build the error for a name that is not there, with near matches first.

    Parameters
    ----------
    kind : str
        What it should have been the name of, in the singular: ``"joint"``.
    name : str
        What came.
    known : iterable of str
        The names that there are.
    where : str
        What they are the names in, for the message.

    Returns
    -------
    UnknownNameError
        To be raised by the caller.

    Examples
    --------
    >>> print(unknown_name("joint", "elbw", ["shoulder", "elbow"], "chain 'ur5e'"))
    no joint 'elbw' in chain 'ur5e'; did you mean 'elbow'? joints are: shoulder, elbow
    """
    names = list(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    message = f"no {kind} {name!r}"
    if where:
        message += f" in {where}"
    message += ";"
    if near:
        message += " did you mean " + " or ".join(repr(n) for n in near) + "?"
    message += f" {kind.removesuffix('y') + 'ies' if kind.endswith('ity') else kind + 's'} are: " + ", ".join(names)
    return UnknownNameError(message)
