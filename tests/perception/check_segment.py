"""What segmentation says of a frame, against the slow reference; shared by the tests and by fuzz/fuzz_segment.py."""

from __future__ import annotations

import numpy as np

from pieper.perception.color_table import ColorTable
from pieper.perception.segment import Order, color_image, label_image, luma_chroma_labels, segment
from tests.reference.blobs import labels_of, patches, planes_of

# The sums are integers; what is left is the rounding of one division, relative to coordinates of at most a few hundred pixels.
ROUNDING = 1e-11


def expected_labels(image: np.ndarray, table: ColorTable, order: Order) -> np.ndarray:
    """The label of each pixel."""
    if order in ("bgr", "rgb"):
        return labels_of(image if order == "bgr" else image[..., ::-1], table.labels)
    return labels_of(planes_of(image, order), luma_chroma_labels(table))


def check(image: np.ndarray, table: ColorTable, order: Order, min_area: int, max_area: int) -> None:
    """Everything about the blobs of one frame."""
    blobs = segment(image, table, order=order, min_area=min_area, max_area=max_area, refine=False)
    labels = expected_labels(image, table, order)
    assert np.array_equal(color_image(image, table, order=order), labels)
    expected = patches(labels, min_area, max_area)
    assert blobs.names == table.names
    assert len(blobs) == len(expected)
    assert [int(color) + 1 for color in blobs.color] == [patch.label for patch in expected]
    assert blobs.area.tolist() == [len(patch.pixels) for patch in expected]
    assert blobs.extent.tolist() == [patch.extent for patch in expected]
    numbers = label_image(image, table, order=order, min_area=min_area, max_area=max_area)
    drawn = np.zeros_like(labels, dtype=np.int32)
    for k, patch in enumerate(expected):
        assert np.abs(blobs.centroid[k] - patch.centroid).max() <= ROUNDING
        assert abs(blobs.circularity[k] - patch.circularity) <= ROUNDING
        drawn[tuple(patch.pixels.T)] = k + 1
    assert np.array_equal(numbers, drawn)
    assert covariances_hold(blobs.covariance)

    refined = segment(image, table, order=order, min_area=min_area, max_area=max_area)
    for name in ("color", "area", "extent", "circularity"):
        assert np.array_equal(getattr(refined, name), getattr(blobs, name))
    assert covariances_hold(refined.covariance)
    # the edge is sought two pixels around the label
    left, top, width, height = refined.extent.T
    x, y = refined.centroid.T
    assert ((x > left - 2.5) & (x < left + width + 1.5) & (y > top - 2.5) & (y < top + height + 1.5)).all()


def covariances_hold(covariance: np.ndarray) -> bool:
    """Symmetric, finite and positive."""
    if not len(covariance):
        return covariance.shape == (0, 2, 2)
    finite = np.isfinite(covariance).all() and np.array_equal(covariance, covariance.swapaxes(1, 2))
    return bool(finite and (np.linalg.eigvalsh(covariance) > 0).all())
