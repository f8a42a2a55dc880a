"""Random robots for Hypothesis: trees with every joint type of a serial arm, as URDF text and as joint values."""

from __future__ import annotations

from math import pi

from hypothesis import strategies as st

LENGTH = st.one_of(st.sampled_from([0.0, 0.1, -0.25]), st.floats(-2.0, 2.0))
ANGLE = st.one_of(st.sampled_from([0.0, pi / 2, -pi / 2, pi, 1.5707963, pi / 4]), st.floats(-4.0, 4.0))
AXIS = st.one_of(
    st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (1, 1, 0)]),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda a: sum(x * x for x in a) > 1e-4),
)
TYPES = ("revolute", "continuous", "prismatic", "fixed")


@st.composite
def urdf_trees(draw, *, max_links: int = 9, mimic: bool = True) -> str:
    """URDF text of a tree of 2 to `max_links` links named l0 (the root), l1, ... and joints j1, j2, ..."""
    count = draw(st.integers(2, max_links))
    parts = ['<robot name="random">', *(f'<link name="l{i}"/>' for i in range(count))]
    moving: list[int] = []
    for child in range(1, count):
        parent = draw(st.integers(max(0, child - 2), child - 1))
        kind = draw(st.sampled_from(TYPES))
        xyz = " ".join(repr(draw(LENGTH)) for _ in range(3))
        rpy = " ".join(repr(draw(ANGLE)) for _ in range(3))
        axis = " ".join(repr(float(x)) for x in draw(AXIS))
        parts.append(f'<joint name="j{child}" type="{kind}"><parent link="l{parent}"/><child link="l{child}"/>')
        parts.append(f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>')
        if kind in ("revolute", "prismatic"):
            parts.append('<limit lower="-1.5" upper="2" effort="3" velocity="4"/>')
        if mimic and kind != "fixed" and moving and draw(st.integers(0, 3)) == 0:
            master = draw(st.sampled_from(moving))
            factor, offset = draw(st.floats(-2, 2)), draw(st.floats(-1, 1))
            parts.append(f'<mimic joint="j{master}" multiplier="{factor!r}" offset="{offset!r}"/>')
        if kind != "fixed":
            moving.append(child)
        parts.append("</joint>")
    parts.append("</robot>")
    return "\n".join(parts)
