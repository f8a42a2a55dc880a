"""Segmentation against a slow reference on frames of any shape, stride and order, and against discs whose place is known exactly."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper._native import kernels
from pieper.errors import ArrayError, PieperError, UnknownNameError
from pieper.perception.color_table import ColorTable
from pieper.perception.segment import LARGEST_SIDE, color_image, label_image, luma_chroma_labels, segment
from tests.perception.check_segment import check, covariances_hold
from tests.perception.discs import BACKGROUND, RED, TWO_COLORS, coverage, disc_frame

ORDERS = ("bgr", "rgb", "i420", "nv12", "yuyv")
VIEWS = {
    "as it is": lambda frame: frame,
    "a part of a wider frame": lambda frame: np.pad(frame, [(1, 2), (3, 1), *[(0, 0)] * (frame.ndim - 2)])[1:-2, 3:-1],
    "upside down": lambda frame: frame[::-1],
    "mirrored": lambda frame: frame[:, ::-1],
    "every second row": lambda frame: np.repeat(frame, 2, axis=0)[::2],
    "every second column": lambda frame: np.repeat(frame, 2, axis=1)[:, ::2],
    "in columns": np.asfortranarray,
    "one row again and again": lambda frame: np.broadcast_to(frame[:1], frame.shape),
    "read-only": lambda frame: np.frombuffer(frame.tobytes(), np.uint8).reshape(frame.shape),
}


def random_table(rng: np.random.Generator, bits: int, colors: int, filled: float) -> ColorTable:
    labels = rng.integers(1, colors + 1, (2**bits,) * 3) * (rng.random((2**bits,) * 3) < filled)
    return ColorTable(tuple(f"color {k}" for k in range(colors)), labels.astype(np.uint8))


def random_frame(rng: np.random.Generator, order: str, height: int, width: int, shades: int) -> np.ndarray:
    """Patches of few shades, or noise."""
    shape = {"i420": (height // 2 * 3, width // 2 * 2), "nv12": (height // 2 * 3, width // 2 * 2)}.get(
        order, (height, width, 3) if order in ("bgr", "rgb") else (height, width // 2 * 2, 2)
    )
    return rng.choice(rng.integers(0, 256, shades), shape).astype(np.uint8)


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    order=st.sampled_from(ORDERS),
    view=st.sampled_from(sorted(VIEWS)),
    height=st.one_of(st.integers(0, 8), st.integers(1, 60)),
    width=st.one_of(st.integers(0, 8), st.integers(25, 140)),
    shades=st.sampled_from([2, 3, 5, 256]),
    bits=st.integers(1, 8),
    colors=st.integers(1, 9),
    filled=st.sampled_from([0.0, 0.002, 0.05, 0.5, 1.0]),
    min_area=st.sampled_from([1, 2, 9]),
    max_area=st.sampled_from([9, 50, 10**9]),
    instruction_set=st.sampled_from(kernels.instruction_sets()),
)
def test_equal_to_the_reference(
    seed, order, view, height, width, shades, bits, colors, filled, min_area, max_area, instruction_set
):
    rng = np.random.default_rng(seed)
    frame = random_frame(rng, order, height, width, shades)
    if frame.size:
        frame = VIEWS[view](frame)
    before = kernels.instruction_set()
    kernels.use_instruction_set(instruction_set)
    try:
        check(frame, random_table(rng, min(bits, 7), colors, filled), order, min_area, max_area)
    finally:
        kernels.use_instruction_set(before)


def test_the_table_of_eight_bits_is_exact(instruction_set):
    rng = np.random.default_rng(1)
    check(random_frame(rng, "bgr", 40, 70, 256), random_table(rng, 8, 3, 0.4), "bgr", 1, 10**9)


@pytest.mark.parametrize("shape", ["spiral", "comb", "checkers", "rings", "stairs"])
def test_shapes_that_join_late(shape, instruction_set):
    y, x = np.mgrid[:61, :97]
    mask = {
        "spiral": (np.maximum(abs(x - 48), abs(y - 30)) + (x > 48) * (y == 30)) % 2 == 0,
        "comb": (x % 2 == 0) | (y == 60),
        "checkers": (x + y) % 2 == 0,
        "rings": ((x - 48) ** 2 + (y - 30) ** 2) // 60 % 2 == 0,
        "stairs": (x - y) % 7 == 0,
    }[shape]
    frame = np.where(mask[..., None], np.uint8(255), np.uint8(0)).repeat(3, axis=-1)
    labels = np.zeros((2, 2, 2), np.uint8)
    labels[1, 1, 1] = 1
    check(frame, ColorTable(("white",), labels), "bgr", 1, 10**9)


def test_blobs_past_a_word_of_columns(instruction_set):
    # refinement works on words of 64 columns: blobs of 1, 2, 3 and 4 words, at every border of the image, and one that is left alone
    for width in (54, 55, 70, 120, 190, 240, 241):
        frame = np.full((40, width + 30, 3), BACKGROUND, np.uint8)
        frame[9:30, 14 : 14 + width] = RED
        blobs = segment(frame, TWO_COLORS)
        assert blobs.extent.tolist() == [[14, 9, width, 21]]
        assert np.abs(blobs.centroid[0] - [14 + (width - 1) / 2, 19.0]).max() <= ROUND
        check(frame[9:30, 14 : 14 + width], TWO_COLORS, "bgr", 1, 10**9)


ROUND = 1e-3  # px; a box between whole pixels has no soft edge, and coverage says so up to rounding


def test_orders_of_bytes_agree():
    image, centers = disc_frame(np.random.default_rng(5), 12)
    plain = segment(image, TWO_COLORS, min_area=50)
    mirrored = segment(image[..., ::-1].copy(), TWO_COLORS, order="rgb", min_area=50)
    for name in ("color", "centroid", "covariance", "area", "extent"):
        assert np.array_equal(getattr(plain, name), getattr(mirrored, name))
    for order in ("i420", "nv12", "yuyv"):
        found = segment(luma_and_chroma(image, order), TWO_COLORS, order=order, min_area=50)
        assert sorted(found.color) == sorted(plain.color)
        assert nearest(found.centroid, centers).max() <= SHARED_CHROMA


def luma_and_chroma(image: np.ndarray, order: str) -> np.ndarray:
    """A frame of blue, green, red by BT.601 with luma from 16 to 235; chroma is the mean over the pixels that share it."""
    b, g, r = np.moveaxis(image / 255.0, -1, 0)
    y = 16 + 65.481 * r + 128.553 * g + 24.966 * b
    u = 128 - 37.797 * r - 74.203 * g + 112.0 * b
    v = 128 + 112.0 * r - 93.786 * g - 18.214 * b
    height, width = y.shape
    if order == "yuyv":
        half = [plane.reshape(height, width // 2, 2).mean(axis=2) for plane in (u, v)]
        frame = np.stack([y, np.stack(half, axis=-1).reshape(height, width)], axis=-1)
    else:
        half = [plane.reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)) for plane in (u, v)]
        chroma = np.stack(half, axis=0 if order == "i420" else -1)
        frame = np.concatenate([y, chroma.reshape(height // 2, width)])
    return np.rint(frame).astype(np.uint8)


SHARED_CHROMA = 0.15  # px; the colour of an edge pixel is that of two or four


def test_luma_and_chroma_are_those_of_opencv():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(2)
    coarse = rng.integers(0, 6, (4, 4, 4)).astype(np.uint8)
    table = ColorTable(tuple("abcde"), np.kron(coarse, np.ones((16, 16, 16), np.uint8)))
    cells = rng.integers(0, 64, (4000, 3))
    y, u, v = (cells * 4 + rng.integers(1, 3, cells.shape)).astype(np.uint8).T  # beside the middle, which is no byte
    frame = np.stack([np.stack([y, u], axis=-1), np.stack([y, v], axis=-1)], axis=1).reshape(1, -1, 2)
    bgr = cv2.cvtColor(frame, cv2.COLOR_YUV2BGR_YUY2)[:, ::2]
    agree = luma_chroma_labels(table)[tuple(cells.T)] == table.classify(bgr)[0]
    assert agree.mean() >= 0.96  # the rest lies within half a grey level of a border between colours


def nearest(points: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Distance of each point to its nearest centre."""
    return np.linalg.norm(points[:, None] - centers[None], axis=-1).min(axis=1)


# Pass marks of the issue, and what a sharp edge leaves: the discs are exact to 1/16 of a pixel.
CENTER = {0: 0.01, 12: 0.04}
PLAIN = 0.09
ASKED = {0: 0.06, 12: 0.09}


@pytest.mark.parametrize("noise", [0, 12])
@pytest.mark.parametrize("blurred", [False, True])
def test_centers_of_discs(noise, blurred):
    rng = np.random.default_rng(noise)
    errors, plain_errors, nees, plain_nees = [], [], [], []
    for _ in range(12):
        image, centers = disc_frame(rng, 12, noise=noise, blurred=blurred)
        for refine, e, chi in ((True, errors, nees), (False, plain_errors, plain_nees)):
            blobs = segment(image, TWO_COLORS, min_area=50, refine=refine)
            assert len(blobs) == len(centers)
            which = np.linalg.norm(blobs.centroid[:, None] - centers[None], axis=-1).argmin(axis=1)
            assert sorted(which) == list(range(len(centers)))
            left = blobs.centroid - centers[which]
            e.extend((left**2).sum(axis=1))
            chi.extend(np.einsum("ki,kij,kj->k", left, np.linalg.inv(blobs.covariance), left))
    rms, plain_rms = np.sqrt(np.mean(errors)), np.sqrt(np.mean(plain_errors))
    assert rms <= CENTER[noise] <= ASKED[noise]
    assert rms < plain_rms <= PLAIN
    # two degrees of freedom: 2 on average, 95 % below 5.99. The noise of clamped coverage is bounded from above, so that a sharp edge gives less.
    for chi, least in ((nees, 0.8 if noise else 0.0), (plain_nees, 1.2)):
        assert least <= np.mean(chi) <= 2.8
        assert np.mean(np.array(chi) <= 5.99) >= 0.90


def test_a_neighbor_of_another_color_pulls_no_center():
    rng = np.random.default_rng(7)
    errors = []
    for gap in (2.0, 2.5, 3.0, 4.0, 6.0):
        for _ in range(6):
            image, centers = disc_frame(rng, 2, noise=6, gap=gap)
            blobs = segment(image, TWO_COLORS, min_area=50)
            assert len(blobs) == 2
            errors.extend(nearest(blobs.centroid, centers) ** 2)
    assert np.sqrt(np.mean(errors)) <= ASKED[0]


@pytest.mark.parametrize("beside", [(25, 25, 25), (220, 220, 220), (110, 150, 110)])
def test_two_backgrounds_pull_no_center(beside):
    # the disc lies on one thing, and another begins one to three pixels from it
    rng = np.random.default_rng(4)
    errors, plain_errors = [], []
    for gap in (1.0, 2.0, 3.0):
        for _ in range(8):
            center = 40 + rng.uniform(-0.5, 0.5, 2)
            angle = rng.uniform(-np.pi, np.pi)
            y, x = np.mgrid[:80, :80]
            away = (x - center[0]) * np.cos(angle) + (y - center[1]) * np.sin(angle)
            other = np.clip(away - 11.5 - gap + 0.5, 0, 1)[..., None]
            frame = np.array(BACKGROUND) * (1 - other) + other * np.array(beside)
            cover = coverage(*center, 11.5, 80)[..., None]
            image = np.rint(frame * (1 - cover) + cover * np.array(RED)).astype(np.uint8)
            for refine, all_errors in ((True, errors), (False, plain_errors)):
                blobs = segment(image, TWO_COLORS, min_area=50, refine=refine)
                assert len(blobs) == 1
                all_errors.append(np.linalg.norm(blobs.centroid[0] - center))
    assert np.sqrt(np.mean(np.square(errors))) <= CENTER[0] < np.sqrt(np.mean(np.square(plain_errors)))


def test_a_disc_cut_by_the_border_says_so():
    image, _ = disc_frame(np.random.default_rng(3), 1)
    blob = segment(image, TWO_COLORS, min_area=50)
    x, y = np.rint(blob.centroid[0]).astype(int)
    whole = np.sqrt(np.trace(blob.covariance[0]))
    cut = segment(image[:, x - 4 :], TWO_COLORS, min_area=50)
    assert cut.extent[0, 0] == 0
    off = abs(cut.centroid[0, 0] - (blob.centroid[0, 0] - (x - 4)))
    assert off > 1.0
    assert off <= 2.5 * np.sqrt(cut.covariance[0, 0, 0])
    assert cut.covariance[0, 1, 1] < 0.01  # the other direction is known as before
    corner = segment(image[y - 3 :, x - 4 :], TWO_COLORS, min_area=50)
    assert corner.covariance[0].diagonal().min() > whole


def test_areas_choose():
    frame = np.full((40, 60, 3), BACKGROUND, np.uint8)
    for k, side in enumerate((1, 2, 3, 4, 6)):
        frame[5 : 5 + side, 10 * k + 2 : 10 * k + 2 + side] = RED
    assert segment(frame, TWO_COLORS, min_area=1).area.tolist() == [1, 4, 9, 16, 36]
    assert segment(frame, TWO_COLORS).area.tolist() == [9, 16, 36]
    assert segment(frame, TWO_COLORS, min_area=4, max_area=16).area.tolist() == [4, 9, 16]
    assert label_image(frame, TWO_COLORS, min_area=36).max() == 1


@pytest.mark.parametrize("shape", [(0, 0, 3), (0, 7, 3), (7, 0, 3)])
def test_frames_without_pixels(shape):
    blobs = segment(np.zeros(shape, np.uint8), TWO_COLORS)
    assert len(blobs) == 0
    assert covariances_hold(blobs.covariance)
    assert blobs.extent.shape == (0, 4)
    assert color_image(np.zeros(shape, np.uint8), TWO_COLORS).shape == shape[:2]


@pytest.mark.parametrize(
    ("image", "order", "words"),
    [
        (
            np.zeros((4, 6), np.uint8),
            "bgr",
            r"shape \(height, width, 3\) for order 'bgr', got \(4, 6\); a grey frame has no",
        ),
        (np.zeros((4, 6, 1), np.uint8), "bgr", "a grey frame has no colours to find"),
        (np.zeros((4, 6, 4), np.uint8), "bgr", r"shape \(height, width, 3\) for order 'bgr', got \(4, 6, 4\)$"),
        (np.zeros((4, 6, 3), np.uint16), "bgr", r"must be uint8, got uint16; scale 16 bits to 8 first"),
        (np.zeros((4, 6, 3)), "rgb", "must be uint8, got float64$"),
        (np.zeros((4, 6, 3), np.int8), "rgb", "must be uint8, got int8$"),
        ([[[1, 2, 3]]], "bgr", "must be a NumPy array of shape .* got list"),
        (None, "bgr", "got NoneType"),
        (
            np.zeros((4, 6), np.uint8),
            "i420",
            r"\(height \* 3 / 2, width\), height and width even for order 'i420', got \(4, 6\)",
        ),
        (np.zeros((6, 5), np.uint8), "nv12", r"got \(6, 5\)"),
        (np.zeros((6, 6, 3), np.uint8), "i420", r"got \(6, 6, 3\)"),
        (np.zeros((6, 5, 2), np.uint8), "yuyv", r"width even for order 'yuyv', got \(6, 5, 2\)"),
        (np.zeros((1, LARGEST_SIDE + 1, 3), np.uint8), "bgr", "at most 32768 rows and columns"),
    ],
)
def test_frames_that_are_none(image, order, words):
    for run in (segment, label_image, color_image):
        with pytest.raises(ArrayError, match=words):
            run(image, TWO_COLORS, order=order)


def test_orders_and_areas_that_are_none():
    frame = np.zeros((4, 4, 3), np.uint8)
    with pytest.raises(
        UnknownNameError, match=r"no order 'grb'; did you mean .* orders are: bgr, rgb, i420, nv12, yuyv"
    ):
        segment(frame, TWO_COLORS, order="grb")
    for least, most in ((0, None), (-3, None), (5, 4)):
        with pytest.raises(ArrayError, match="1 <= min_area <= max_area"):
            segment(frame, TWO_COLORS, min_area=least, max_area=most)


def test_a_line_as_long_as_a_frame_may_be(instruction_set):
    frame = np.full((1, LARGEST_SIDE, 3), RED, np.uint8)
    blobs = segment(frame, TWO_COLORS)
    assert blobs.centroid.tolist() == [[(LARGEST_SIDE - 1) / 2, 0.0]]
    assert blobs.area.tolist() == [LARGEST_SIDE]
    down = segment(np.full((LARGEST_SIDE, 1, 3), RED, np.uint8), TWO_COLORS)
    assert down.centroid.tolist() == [[0.0, (LARGEST_SIDE - 1) / 2]]


def test_threads_see_their_own_frames():
    rng = np.random.default_rng(11)
    frames = [disc_frame(rng, 6, noise=12)[0] for _ in range(4)]
    alone = [segment(frame, TWO_COLORS) for frame in frames]
    wrong: list[int] = []

    def work(k: int) -> None:
        for _ in range(10):
            if not np.array_equal(segment(frames[k], TWO_COLORS).centroid, alone[k].centroid):
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_anything_drawn_at_random_gives_blobs_or_a_word_about_it():
    rng = np.random.default_rng(0)
    dtypes = ("u1", "u1", "u1", "u1", "i1", "u2", "f4", "?", "O", ">u2")
    heard = 0
    for _ in range(300):
        shape = tuple(rng.choice([0, 1, 2, 3, 4, 6, 33], rng.integers(0, 5)))
        image = (rng.random(shape) * 255).astype(dtypes[rng.integers(len(dtypes))])
        order = ("bgr", "rgb", "i420", "nv12", "yuyv", "grey")[rng.integers(6)]
        try:
            check(image, TWO_COLORS, order, int(rng.integers(-1, 9)), 100)
        except PieperError:
            heard += 1
    assert 0 < heard < 300
