"""Triangles: what is done to a surface keeps what it encloses."""

from __future__ import annotations

import numpy as np
import pytest

from pieper.model.description import Box, Cylinder, Sphere
from pieper.model.shape import as_mesh
from pieper.viewer.surface import Surface, creased, merged, shrunk, thinned, welded


def volume(surface):
    """By the divergence theorem; of a closed surface turned outwards it is positive."""
    a, b, c = np.moveaxis(surface.vertices.astype(np.float64)[surface.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def solid(shape, sections=32):
    mesh = as_mesh(shape, sections=sections)
    return Surface(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))


SOLIDS = [Box([0.2, 0.3, 0.4]), Cylinder(0.1, 0.5), Sphere(0.2)]


@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: type(shape).__name__)
def test_creases_change_no_triangle(shape):
    before = solid(shape)
    after = creased(before)
    np.testing.assert_array_equal(after.vertices[after.faces], before.vertices[before.faces])
    np.testing.assert_array_equal(len(welded(after).vertices), len(before.vertices))


def test_round_surfaces_stay_round_and_edges_become_sharp():
    assert len(creased(solid(Sphere(0.2))).vertices) == len(solid(Sphere(0.2)).vertices)
    can = solid(Cylinder(0.1, 0.5))
    assert len(creased(can).vertices) == len(can.vertices) + 2 * 32  # both rims twice


@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: type(shape).__name__)
def test_what_is_shrunk_is_inside(shape):
    before = creased(solid(shape))
    after = shrunk(before, 0.001)
    assert 0.95 * volume(before) < volume(after) < volume(before)
    assert np.linalg.norm(after.vertices - before.vertices, axis=1) == pytest.approx(0.001, rel=1e-3)


def test_what_is_thinned_out_keeps_its_form():
    before = solid(Sphere(0.2), sections=400)
    after = thinned(before, 3000)
    assert 500 < len(after.faces) <= 3000
    assert volume(after) == pytest.approx(volume(before), rel=0.03)
    assert thinned(after, 3000) is after


def test_merged_surfaces_are_both():
    both = merged([solid(shape) for shape in SOLIDS])
    assert volume(both) == pytest.approx(sum(volume(solid(shape)) for shape in SOLIDS), rel=1e-6)
    assert merged([]).faces.shape == (0, 3)
