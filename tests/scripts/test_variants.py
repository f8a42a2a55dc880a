"""The comparison of answers from several builds sees what differs, and lets pass what does not matter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scripts.variants import VARIANTS, Variant, compare

q = np.array([[[0.1, 3.1], [1.0, -2.0]], [[0.5, 0.5], [np.nan, np.nan]]])
ANSWERS: dict[str, Any] = {
    "ur5e pose": np.eye(4)[None],
    "ur5e jacobian": np.ones((1, 6, 6)),
    "ur5e closed q": q,
    "ur5e closed valid": np.isfinite(q).all(axis=-1),
    "ur5e closed position_error": np.full((2, 2), 1e-15),
    "ur5e closed rotation_error": np.full((2, 2), 1e-15),
    "ur5e closed least": np.array([[0.1, 0.2], [0.3, np.inf]]),
    "frame0 area": np.array([12.0]),
    "frame0 centroid": np.array([[3.0, 4.0]]),
}


def changed(name: str, value: Any) -> dict[str, Any]:
    return {**ANSWERS, name: value}


@pytest.mark.parametrize(
    "other",
    [
        ANSWERS,
        changed("ur5e pose", np.eye(4)[None] + 1e-15),
        changed("ur5e closed q", q[:, ::-1]) | {"ur5e closed valid": np.isfinite(q[:, ::-1]).all(axis=-1)},
        changed("ur5e closed q", q + 2e-12),
        changed("ur5e closed q", q - np.array([0.0, 2 * np.pi])),
    ],
    ids=["the same", "rounding", "another order", "rounding of joints", "a whole turn"],
)
def test_the_same(other) -> None:
    assert compare(ANSWERS, other).wrong == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ur5e pose", np.eye(4)[None] + 1e-12, "ur5e pose: 1e-12 is more than 1e-14"),
        ("ur5e jacobian", np.ones((1, 6, 5)), "ur5e jacobian: inf is more than"),
        ("ur5e closed q", q + np.array([0.0, 1e-6]), "ur5e closed, pose 0: 1e-06 is more than 1e-08"),
        ("ur5e closed valid", np.array([[True, False], [True, False]]), "ur5e closed, pose 0: 2 answers and 1"),
        ("ur5e closed valid", np.zeros((2, 2), bool), "poses with an answer and without"),
        ("ur5e closed position_error", np.full((2, 2), 1e-8), "position_error: 1e-08 is more than 1e-09"),
        ("frame0 area", np.array([12.0 + 2e-15]), "frame0 area: 1 is more than 0"),
        ("frame0 centroid", np.array([[3.0, 4.0 + 1e-6]]), "frame0 centroid: 1e-06 is more than 1e-09"),
        ("frame0 more", np.array([1.0]), "asked differently: ['frame0 more']"),
    ],
)
def test_not_the_same(name, value, words) -> None:
    assert any(words in wrong for wrong in compare(ANSWERS, changed(name, value)).wrong)


def test_near_a_singular_pose_answers_may_come_and_go() -> None:
    first = changed("ur5e closed least", np.array([[1e-6, 0.2], [0.3, np.inf]]))
    assert compare(first, changed("ur5e closed valid", np.array([[True, False], [True, False]]))).wrong == []


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_what_its_name_says(name) -> None:
    variant = Variant(name)
    assert variant.compiler in ("g++", "clang++")
    assert variant.settings["PIEPER_PORTABLE"] == ("ON" if "portable" in name else "OFF")
    assert ("-stdlib=libc++" in variant.settings.get("CMAKE_CXX_FLAGS", "")) == name.endswith("libc++")
