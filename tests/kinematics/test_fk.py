"""Forward kinematics against Pinocchio, the textbook product of exponentials, and the reference rows."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper._native import kernels
from pieper.errors import ArrayError, UnknownNameError
from pieper.kinematics.fk import fk, fk_frames
from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as textbook
from tests.robots import NAMES, chain

GOLDEN = Path(__file__).parents[1] / "golden"
SAME_POSE = 1e-12  # [m, -]: a dozen products of numbers of a few metres, rounded in double
FROM_URDF = [name for name in NAMES if name != "mh12-report"]  # that one is given by screws


def some_joints(arm: Chain, count: int, seed: int = 0) -> np.ndarray:
    """Random joint values, inside the limits and a full turn beyond."""
    rng = np.random.default_rng(seed)
    lower = np.maximum(arm.limits[:, 0], -7.0) - 2.0
    upper = np.minimum(arm.limits[:, 1], 7.0) + 2.0
    return rng.uniform(lower, upper, (count, arm.dof))


@pytest.mark.parametrize("name", NAMES)
def test_reference_rows(name):
    with (GOLDEN / "fk.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["robot"] == name]
    arm = pieper.load(name)
    if name == "mh12-report":
        assert not rows  # its rows are in mh12_seed.yaml, see test_catalog
        return
    assert len(rows) == 21
    for row in rows:
        T = arm.fk([float(row[f"q{i + 1}"]) for i in range(arm.dof)])
        assert np.abs(T[:3, 3] - [float(row[k]) for k in ("px", "py", "pz")]).max() < SAME_POSE
        x, y, z, w = (float(row[k]) for k in ("qx", "qy", "qz", "qw"))
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        assert np.abs(T[:3, :3] - R).max() < SAME_POSE


@pytest.mark.parametrize("nominal", [False, True])
@pytest.mark.parametrize("name", FROM_URDF)
def test_equals_pinocchio(name, nominal, instruction_set):
    pinocchio_model = pytest.importorskip("tests.reference.pinocchio_model", exc_type=ImportError)
    truth, arm = pinocchio_model.PinocchioArm(name, nominal=nominal), chain(name, nominal)
    q = some_joints(arm, 101)
    expected = np.array([truth.fk(row) for row in q])
    assert np.abs(fk(arm, q) - expected).max() < SAME_POSE
    assert max(np.abs(fk(arm, row) - T).max() for row, T in zip(q, expected, strict=True)) < SAME_POSE


@pytest.mark.parametrize("name", NAMES)
def test_every_frame_equals_the_textbook(name):
    arm = chain(name)
    for q in some_joints(arm, 3):
        expected = np.array([textbook.fk_frame(arm, q, frame) for frame in arm.frames])
        assert np.abs(fk_frames(arm, q) - expected).max() < SAME_POSE
        for frame, T in zip(arm.frames, expected, strict=True):
            assert np.abs(fk(arm, q, up_to=frame.name) - T).max() < SAME_POSE
        assert np.array_equal(fk(arm, q, up_to=0), np.eye(4))


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


@st.composite
def random_chains(draw):
    """Chains of 0 to 9 axes whose neighbours are often parallel, anti-parallel, coincident, nearly so, or sliding."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    screws, direction, point = [], np.array([0.0, 0.0, 1.0]), np.zeros(3)
    for kind in draw(
        st.lists(st.sampled_from(["any", "same", "opposite", "near", "square", "here", "slide"]), max_size=9)
    ):
        if kind in ("any", "slide", "here"):
            direction = unit(rng.normal(size=3))
        elif kind == "opposite":
            direction = -direction
        elif kind == "near":
            direction = unit(direction + 10.0 ** rng.uniform(-16, -1) * rng.normal(size=3))
        elif kind == "square":
            direction = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        if kind != "here":
            point = rng.normal(size=3) if rng.random() < 0.8 else point
        screws.append(np.r_[direction, 0, 0, 0] if kind == "slide" else np.r_[np.cross(point, direction), direction])
    home = np.eye(4)
    if rng.random() < 0.7:
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        home[:3, :3] = Q * np.sign(np.linalg.det(Q))
        home[:3, 3] = rng.normal(size=3)
    n = len(screws)
    return Chain(
        name="random",
        screws=np.array(screws).reshape(-1, 6),
        home=home,
        limits=np.tile([-np.inf, np.inf], (n, 1)),
        joint_names=tuple(f"joint_{i + 1}" for i in range(n)),
    )


@settings(max_examples=300, deadline=None)
@given(arm=random_chains(), seed=st.integers(0, 1000))
def test_any_chain_equals_the_textbook(arm, seed):
    for isa in kernels.instruction_sets():
        kernels.use_instruction_set(isa)
        q = np.random.default_rng(seed).uniform(-7, 7, (11, arm.dof))
        expected = np.array([textbook.fk(arm, row) for row in q])
        scale = 1.0 + np.abs(expected).max()
        assert np.abs(fk(arm, q) - expected).max() < SAME_POSE * scale
        assert np.abs(fk(arm, q[0]) - expected[0]).max() < SAME_POSE * scale


def test_coupled_axes_move_together(instruction_set):
    arm = Chain(
        name="scissors",
        screws=[[0, 0, 0, 0, 0, 1], [0, -1, 0, 0, 0, 1], [0, -2, 0, 0, 0, 1]],
        home=np.eye(4) + np.eye(4, k=3) * 3.0,
        limits=[[-1, 1], [-1, 1]],
        joint_names=("drive", "wrist"),
        coupling=[[1, 0], [-2, 0], [0, 1]],
    )
    q = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    expected = np.array([textbook.fk(arm, row) for row in q])
    assert np.abs(fk(arm, q) - expected).max() < SAME_POSE


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,), (2, 0), (9,)])
def test_leading_axes(shape):
    arm = pieper.load("panda")
    q = np.random.default_rng(1).uniform(-1, 1, (*shape, 7))
    T = arm.fk(q)
    assert T.shape == (*shape, 4, 4)
    for index in np.ndindex(shape):
        assert np.abs(T[index] - arm.fk(q[index])).max() < SAME_POSE


def test_a_batch_equals_its_parts_in_any_order(instruction_set):
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 1003)
    T = arm.fk(q)
    order = np.random.default_rng(2).permutation(len(q))
    assert np.array_equal(arm.fk(q[order]), T[order])  # one lane never looks at another
    assert np.array_equal(arm.fk(q[:5]), T[:5])


def test_threads_change_nothing():
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 40_003)
    assert np.array_equal(arm.fk(q, threads=3), arm.fk(q))


def test_large_batches_pass_the_cache_unharmed(instruction_set):
    """Results beyond 8 MB are written past the cache: same numbers, aligned or not."""
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 70_001)
    T = arm.fk(q)
    room = np.full(70_001 * 16 + 16, np.nan)
    for offset in range(9):
        out = room[offset : offset + 70_001 * 16].reshape(70_001, 4, 4)
        assert np.array_equal(arm.fk(q, out=out), T)
        assert np.isnan(room[offset + 70_001 * 16]), "wrote behind the end"
        room[:] = np.nan


@pytest.mark.parametrize("turns", [1, 1e3, 1e6, 1e9])
def test_whole_turns_change_nothing_but_rounding(turns, instruction_set):
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 9)
    far = q + 2 * np.pi * turns
    moved = np.spacing(np.abs(far)).max()  # the sum is rounded, and so is 2 pi times turns
    assert np.abs(arm.fk(far) - arm.fk(far - 2 * np.pi * turns)).max() < 8 * moved + SAME_POSE


@pytest.mark.parametrize(
    "convert",
    [
        list,
        tuple,
        lambda q: q.tolist(),
        np.asfortranarray,
        lambda q: q.astype(object).tolist(),
        lambda q: q[::1].copy()[:],
    ],
)
def test_takes_what_numpy_takes(convert):
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 8)
    assert np.array_equal(arm.fk(convert(q)), arm.fk(q))


def test_float32_integers_and_strides_are_converted():
    arm = pieper.load("ur5e")
    q = some_joints(arm.chain, 8)
    assert np.array_equal(arm.fk(q.astype(np.float32)), arm.fk(q.astype(np.float32).astype(np.float64)))
    assert np.array_equal(arm.fk([0, 1, 0, -1, 0, 2]), arm.fk([0.0, 1.0, 0.0, -1.0, 0.0, 2.0]))
    wide = np.repeat(q, 2, axis=1)
    assert np.array_equal(arm.fk(wide[:, ::2]), arm.fk(q))


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0.0] * 5, r"q must have shape \(\.\.\., 6\), got \(5,\); the joints of 'ur5e' are: shoulder_pan_joint"),
        (np.zeros((6, 5)), r"got \(6, 5\)"),
        (0.0, r"got \(\)"),
        ([0.0, 1.0, np.nan, 0.0, 0.0, 0.0], r"q must be finite, got q\[2\] = nan \(joint 'elbow_joint'\)"),
        (np.full((2, 6), np.inf), r"got q\[0, 0\] = inf"),
        ([0.0, 0.0, 0.0, -2e15, 0.0, 0.0], r"must not exceed 1e\+15, .* got q\[3\] = -2000000000000000.0"),
        (["a"] * 6, "q must be real numbers, got dtype <U1"),
        ([1j] * 6, "got dtype complex128"),
        ([None] * 6, "got dtype object"),
        ([True] * 6, "got dtype bool"),
        ([[0.0] * 6, [0.0] * 5], "rows of different lengths"),
        ("ur5e", "got dtype"),
    ],
)
def test_bad_joints_are_named(q, message):
    with pytest.raises(ArrayError, match=message):
        pieper.load("ur5e").fk(q)


@pytest.mark.parametrize(
    ("out", "message"),
    [
        (np.zeros((2, 4, 4)), r"out must be a float64 array of shape \(4, 4\), got float64 array of shape \(2, 4, 4\)"),
        (np.zeros((4, 4), dtype=np.float32), "got float32 array"),
        ([[0.0] * 4] * 4, "got list"),
        (np.zeros((4, 8))[:, ::2], r"C-contiguous and writeable; make it with np.empty\(\(4, 4\)\)"),
    ],
)
def test_bad_out_is_named(out, message):
    with pytest.raises(ArrayError, match=message):
        pieper.load("ur5e").fk([0.0] * 6, out=out)


def test_read_only_out_is_refused():
    out = np.zeros((4, 4))
    out.setflags(write=False)
    with pytest.raises(ArrayError, match="writeable"):
        pieper.load("ur5e").fk([0.0] * 6, out=out)


def test_out_is_filled_and_returned():
    arm, out = pieper.load("ur5e"), np.zeros((3, 4, 4))
    q = some_joints(arm.chain, 3)
    assert arm.fk(q, out=out) is out
    assert np.array_equal(out, arm.fk(q))


def test_bad_frames_are_named():
    arm = pieper.load("ur5e")
    with pytest.raises(UnknownNameError, match="did you mean 'forearm_link'"):
        arm.fk([0.0] * 6, up_to="forarm_link")
    for wrong in (7, -1, True, 2.5):
        with pytest.raises(ArrayError, match="joint count from 0 to 6"):
            arm.fk([0.0] * 6, up_to=wrong)


@pytest.mark.parametrize("threads", [0, -1, 1.5, None])
def test_bad_threads_are_named(threads):
    with pytest.raises(ArrayError, match="threads must be a whole number of at least 1"):
        pieper.load("ur5e").fk(np.zeros((2, 6)), threads=threads)


@settings(max_examples=200, deadline=None)
@given(
    st.one_of(
        st.none(), st.booleans(), st.text(max_size=3), st.floats(), st.binary(max_size=8),
        st.lists(st.one_of(st.floats(), st.none(), st.integers(), st.text(max_size=2)), max_size=8),
        st.lists(st.lists(st.floats(), max_size=8), max_size=4),
        st.dictionaries(st.text(max_size=2), st.floats(), max_size=2),
    )
)  # fmt: skip
def test_any_object_is_converted_or_refused(q):
    arm = pieper.load("ur5e")
    try:
        T = arm.fk(q)
    except ArrayError:
        return
    assert np.isfinite(T).all()
    assert T.shape[-2:] == (4, 4)
