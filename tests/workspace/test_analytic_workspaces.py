"""Maps of arms whose workspace is known on paper (Kumar and Waldron, The workspaces of a mechanical manipulator, J. Mech. Design
103 (1981) 665-672; Craig, Introduction to robotics, section 4.2)."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.workspace.map import WorkspaceMap
from pieper.workspace.run import run
from pieper.workspace.survey import survey
from tests.workspace.arms import elbow_arm, planar, scara

ROUNDING = 1e-9  # [m] a centre this near to a boundary may count either way
FLOAT32 = 1e-6  # of the stored measures, relative
SPREAD = 0.02  # by how much a share of 500 evenly spread orientations may miss the share of all
PIXELS = 0.01  # by how much the area of a disc in voxels of 1/30 of its radius may differ


def radius(found: WorkspaceMap) -> np.ndarray:
    """Distance of each centre from the origin [m]."""
    axes = np.meshgrid(*(found.grid.axis(name) for name in "xyz"), indexing="ij")
    return np.sqrt(sum(axis * axis for axis in axes))


def test_two_links_in_a_plane_reach_an_annulus_twice() -> None:
    found = run(survey(planar(1.0, 0.6), voxel=0.05))
    r, count = radius(found), found.array("most_solutions")
    inside = (r > 0.4 + ROUNDING) & (r < 1.6 - ROUNDING)
    assert (count[inside] == 2).all()
    assert (count[(r < 0.4 - ROUNDING) | (r > 1.6 + ROUNDING)] == 0).all()
    # on the boundary the elbow is stretched or folded: the two become one
    on_it = (np.abs(r - 0.4) < ROUNDING) | (np.abs(r - 1.6) < ROUNDING)
    assert on_it.sum() >= 8
    assert (count[on_it] <= 1).all()
    assert found.record["kind"] == "position"
    assert found.summary().reachable == pytest.approx(np.pi * (1.6**2 - 0.4**2), rel=PIXELS)


def test_two_links_in_a_plane_have_the_manipulability_of_the_textbook() -> None:
    found = run(survey(planar(1.0, 0.6), voxel=0.05))
    r, measure = radius(found), found.array("manipulability")
    inside = (r > 0.4 + ROUNDING) & (r < 1.6 - ROUNDING)
    cosine = (r[inside] ** 2 - 1.0 - 0.36) / 1.2
    assert np.allclose(measure[inside], 0.6 * np.sqrt(1.0 - cosine**2), rtol=FLOAT32, atol=1e-6)
    assert np.isnan(measure[found.array("reached") == 0]).all()


def test_limits_take_one_of_two_elbows_away() -> None:
    limits = [[-np.pi, np.pi], [0.0, np.pi]]
    found = run(survey(planar(1.0, 0.6, limits=limits), voxel=0.05))
    r, count = radius(found), found.array("most_solutions")
    assert (count[(r > 0.4 + ROUNDING) & (r < 1.6 - ROUNDING)] == 1).all()


def test_three_links_in_a_plane_turn_freely_in_a_narrower_annulus() -> None:
    found = run(survey(planar(1.0, 0.6, 0.2), voxel=0.05, orientations=60))
    r, share = radius(found), found.array("dexterity")
    assert found.record["kind"] == "turns"
    # the last joint has to lie between 0.4 and 1.6 for every turn of the last link
    assert (share[(r > 0.6 + ROUNDING) & (r < 1.4 - ROUNDING)] == 1.0).all()
    assert (share[(r < 0.6 - 0.01) | (r > 1.4 + 0.01)] < 1.0).all()
    assert (share[(r < 0.2 - ROUNDING) | (r > 1.8 + ROUNDING)] == 0.0).all()


def test_an_elbow_arm_is_dexterous_where_its_wrist_can_go_all_round_the_tip() -> None:
    upper, fore, tool = 0.5, 0.3, 0.15
    found = run(survey(elbow_arm(upper, fore, tool), voxel=0.1, orientations=500, layer=("y", 0.0)))
    r, share = radius(found), found.array("dexterity")
    inner, outer = upper - fore, upper + fore
    full = (r > inner + tool + ROUNDING) & (r < outer - tool - ROUNDING)
    assert full.sum() > 20
    assert (share[full] == 1.0).all()
    assert (share[r > outer + tool + ROUNDING] == 0.0).all()
    # Between: the wrist centre is on a sphere of radius `tool` about the tip, which is cut by the spheres of the two boundaries, and of
    # evenly spread orientations the share that is left is the height of the cap over the diameter (Archimedes).
    some = (r > ROUNDING) & ~full
    nearest, farthest = (((r[some] ** 2 + tool**2 - edge**2) / (2.0 * r[some] * tool)) for edge in (inner, outer))
    expected = 0.5 * (np.clip(nearest, -1.0, 1.0) - np.clip(farthest, -1.0, 1.0))
    assert np.abs(share[some] - expected).max() < SPREAD


def test_an_elbow_arm_has_eight_solutions_inside() -> None:
    found = run(survey(elbow_arm(0.5, 0.3, 0.15), voxel=0.1, orientations=50, box=[[0.3, 0.2, 0.1], [0.4, 0.3, 0.2]]))
    assert (found.array("most_solutions") == 8).all()
    assert (found.array("mean_solutions") == 8.0).all()


def test_a_scara_turns_freely_wherever_its_two_links_reach() -> None:
    found = run(survey(scara(0.4, 0.3), voxel=0.05, orientations=12))
    assert found.record["kind"] == "turns"
    x, y, z = np.meshgrid(*(found.grid.axis(name) for name in "xyz"), indexing="ij")
    r = np.hypot(x, y)
    inside = (r > 0.1 + ROUNDING) & (r < 0.7 - ROUNDING) & (z >= 0.0) & (z <= 0.2)
    assert (found.array("dexterity")[inside] == 1.0).all()
    assert (found.array("reached")[(r < 0.1 - ROUNDING) | (r > 0.7 + ROUNDING)] == 0).all()
