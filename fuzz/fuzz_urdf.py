"""Fuzz the URDF reader: whatever comes in, only `UrdfError` may come out, and what is accepted has to work.

    python fuzz/fuzz_urdf.py -max_total_time=600 [corpus_dir]

Half of the inputs are raw bytes; the other half are grown from a valid robot, so that the checks behind the XML parser
are reached too. An accepted robot is cut into chains and written back: the result must read as the same robot.
"""

from __future__ import annotations

import sys
import warnings
from math import pi

import atheris

with atheris.instrument_imports(include=["pieper.model", "defusedxml", "xml.etree"]):
    import numpy as np

    from pieper.errors import AmbiguousError, PieperWarning, UrdfError
    from pieper.model.description import Description  # noqa: TC001
    from pieper.model.urdf import as_urdf, from_urdf

warnings.simplefilter("error")
warnings.simplefilter("ignore", PieperWarning)

NUMBERS = [
    "0",
    "1",
    "-1",
    "0.5",
    "1e-320",
    "1e308",
    "-1e9",
    "nan",
    "inf",
    "1e999",
    "",
    "x",
    "1_0",
    "${pi}",
    "1 2",
    "3.1415926535897931",
]
NAMES = ["a", "b", "c", "d", "e", "", " ", "tool0", "tcp", "&lt;", "\u00e4", "x" * 300]
FILES = ["a.stl", "package://p/a.stl", "package://../a", "file:///a", "file://[", "http://a/b", "", "\u20ac"]
TYPES = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "", "Revolute", "spherical"]
NOISE = [
    "<link/>",
    "<origin/>",
    "<mimic/>",
    "<!-- -->",
    "<![CDATA[x]]>",
    "<a:b/>",
    "&amp;",
    "&x;",
    "<?x y?>",
    "<robot>",
    "</robot>",
]


def grown(data: atheris.FuzzedDataProvider) -> str:
    """A robot whose every part is chosen by the fuzzer, mostly well formed."""

    def rarely(share: float) -> bool:
        return data.ConsumeIntInRange(0, 255) > 255 * (1.0 - share)  # False once the data is used up

    def number() -> str:
        if not rarely(0.15):
            step = data.ConsumeIntInRange(-127, 128)  # one byte, so that short inputs make whole robots
            return repr(step * (pi / 8.0 if step % 2 else 0.01))
        return data.PickValueInList(NUMBERS)

    def numbers(count: int) -> str:
        if rarely(0.03):
            count += data.ConsumeIntInRange(-2, 2)
        return " ".join(number() for _ in range(count))

    def name(count: int) -> str:
        if rarely(0.03):
            return data.PickValueInList(NAMES)
        return f"l{data.ConsumeIntInRange(0, max(count - 1, 0))}"

    def noise() -> str:
        return data.PickValueInList(NOISE) if rarely(0.02) else ""

    def shape() -> str:
        if not rarely(0.1):
            return noise()
        shapes = [
            f'<box size="{numbers(3)}"/>',
            f'<sphere radius="{number()}"/>',
            f'<cylinder radius="{number()}" length="{number()}"/>',
            f'<mesh filename="{data.PickValueInList(FILES)}" scale="{numbers(3)}"/>',
        ]
        inertia = " ".join(f'{key}="{number()}"' for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        return (
            f'<visual><origin xyz="{numbers(3)}" rpy="{numbers(3)}"/><geometry>{data.PickValueInList(shapes)}</geometry>'
            f'<material name="m"><color rgba="{numbers(4)}"/></material></visual>'
            f'<inertial><mass value="{number()}"/><inertia {inertia}/></inertial>'
        )

    count = data.ConsumeIntInRange(0, 12)
    parts = ['<robot name="r">', *(f'<link name="l{i}">{shape()}</link>' for i in range(count))]
    for child in range(1, count):
        parent = f"l{data.ConsumeIntInRange(0, child - 1)}" if not rarely(0.03) else name(count)
        kind = TYPES[data.ConsumeIntInRange(0, 3)] if not rarely(0.05) else data.PickValueInList(TYPES)
        parts.append(f'<joint name="j{child}" type="{kind}"><parent link="{parent}"/><child link="l{child}"/>{noise()}')
        parts.append(f'<origin xyz="{numbers(3)}" rpy="{numbers(3)}"/><axis xyz="{numbers(3)}"/>')
        if data.ConsumeBool():
            parts.append(f'<limit lower="{number()}" upper="{number()}" effort="{number()}" velocity="{number()}"/>')
        if rarely(0.2):
            other = data.ConsumeIntInRange(1, max(count - 1, 1))
            parts.append(f'<mimic joint="j{other}" multiplier="{number()}" offset="{number()}"/>')
        parts.append("</joint>")
    parts.append("</robot>")
    return "".join(parts)


def check(robot: Description) -> None:
    """An accepted robot gives chains, or says which there are; and it survives being written and read."""
    try:
        chain = robot.chain()
    except (AmbiguousError, UrdfError):
        chain = None
    again = from_urdf(as_urdf(robot))
    assert [j.name for j in again.joints] == [j.name for j in robot.joints]
    assert [link.name for link in again.links] == [link.name for link in robot.links]
    if chain is not None:
        same = again.chain(chain.base, chain.tip)
        size = max(1.0, float(np.abs(chain.screws).max(initial=0.0)), float(np.abs(chain.home).max()))
        assert np.allclose(same.screws, chain.screws, rtol=0.0, atol=1e-12 * size)
        assert np.allclose(same.home, chain.home, rtol=0.0, atol=1e-12 * size)
        try:
            text = as_urdf(chain)
        except UrdfError:  # two lengths that the reader takes can add up to one that it does not
            assert max(size, float(np.abs(chain.coupling).max(initial=0.0))) > 1e8
            return
        back = from_urdf(text).chain(chain.base, chain.tip)
        assert np.allclose(back.home, chain.home, rtol=0.0, atol=1e-12 * size)
    for leaf in robot.leaves[:3]:
        try:
            robot.chain(leaf, robot.root)
        except UrdfError:  # noqa: PERF203
            continue


def one_input(data: bytes) -> None:
    """Read one input; called by the fuzzer."""
    provider = atheris.FuzzedDataProvider(data)
    choice = provider.ConsumeIntInRange(0, 3)
    what: str | bytes
    if choice == 0:
        what = provider.ConsumeBytes(sys.maxsize)
    elif choice == 1:
        what = "<" + provider.ConsumeUnicode(sys.maxsize)
    else:
        what = grown(provider)
    try:
        robot = from_urdf(what)
    except UrdfError:
        return
    check(robot)


def main() -> None:
    """Fuzz with the options and the corpus folders of the command line; the last of equal options counts."""
    atheris.Setup([sys.argv[0], "-max_len=8192", "-len_control=0", "-timeout=20", *sys.argv[1:]], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
