"""Masks of colours and what is made of them, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from pieper.errors import ArrayError
from pieper.perception.masks import clean, color_masks, combined_mask, masked_frame
from pieper.perception.segment import segment
from tests.perception.discs import TWO_COLORS, disc_frame

RNG = np.random.default_rng(8)
KERNELS = {
    "ones": np.ones((3, 3)),
    "five by five": np.ones((5, 5)),
    "cross": np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]]),
    "line": np.ones((1, 7)),
}


@pytest.mark.parametrize("name", KERNELS)
def test_row_a8_erode_once_dilate_twice_with_a_kernel(name):
    kernel = KERNELS[name]
    mask = np.where(RNG.random((60, 80)) < 0.85, 255, 0).astype(np.uint8)
    mask[20:40, 30:60] = 255
    inside = ndimage.binary_erosion(
        mask > 0, kernel, border_value=1
    )  # beyond the border nothing is eroded, as in OpenCV
    expected = ndimage.binary_dilation(inside, kernel, iterations=2)
    got = clean(mask, kernel=kernel)
    assert np.array_equal(got, np.where(expected, 255, 0))
    if name == "ones":
        assert np.array_equal(clean(mask), got)
    assert not np.array_equal(clean(mask, kernel=kernel, erode=2, dilate=1), got)
    assert np.array_equal(clean(mask, kernel=kernel, erode=0, dilate=0), mask)


def test_row_a8_specks_go_and_patches_grow():
    mask = np.zeros((40, 40), np.uint8)
    mask[3, 3] = 255
    mask[10:20, 10:20] = 255
    expected = np.zeros_like(mask)
    expected[9:21, 9:21] = 255
    assert np.array_equal(clean(mask), expected)


def test_row_a9_combined_mask_and_masked_frame():
    image, _ = disc_frame(RNG, 8, noise=6)
    masks = color_masks(image, TWO_COLORS)
    assert list(masks) == ["red", "blue"]
    together = combined_mask(masks)
    assert np.array_equal(together > 0, (masks["red"] > 0) | (masks["blue"] > 0))
    assert not ((masks["red"] > 0) & (masks["blue"] > 0)).any()
    shown = masked_frame(image, together)
    assert np.array_equal(shown[together > 0], image[together > 0])
    assert not shown[together == 0].any()
    for name in masks:  # what is seen in the mask is what is found
        assert (masks[name] > 0).sum() == segment(image, TWO_COLORS, min_area=1).of(name).area.sum()


def test_masks_of_truth_values_and_of_nothing():
    truth = np.array([[True, False]])
    assert combined_mask({"red": truth}).tolist() == [[255, 0]]
    assert clean(np.zeros((0, 4), np.uint8)).shape == (0, 4)


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (lambda: clean(np.zeros((3, 3, 3), np.uint8)), r"mask must be .* got \(3, 3, 3\) of uint8"),
        (lambda: clean(np.zeros((3, 3))), "got .* of float64"),
        (lambda: clean([[0]]), "got list"),
        (lambda: clean(np.zeros((3, 3), np.uint8), kernel=np.zeros((3, 3))), "a cell that is not 0"),
        (lambda: clean(np.zeros((3, 3), np.uint8), kernel=[1, 1]), r"kernel must have shape .* got \(2,\)"),
        (lambda: clean(np.zeros((3, 3), np.uint8), erode=-1), "must not be negative, got -1 and 2"),
        (lambda: combined_mask({}), "at least one"),
        (
            lambda: combined_mask({"a": np.zeros((1, 2), np.uint8), "b": np.zeros((2, 1), np.uint8)}),
            r"one shape, got \{'a': \(1, 2\), 'b': \(2, 1\)\}",
        ),
        (
            lambda: masked_frame(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 3), np.uint8)),
            r"image must have shape \(2, 3, 3\)",
        ),
    ],
)
def test_what_is_no_mask(run, words):
    with pytest.raises(ArrayError, match=words):
        run()
