"""The light is followed by confirmed markers, within bounds, and by nothing else."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import VisionError
from pieper.perception import adapt
from pieper.perception.adapt import LightAdaptation
from pieper.perception.color_space import LogChroma
from pieper.perception.frame import Frame
from tests.perception.color_scenes import PAINT, PLACES, RADIUS, SIZE, blobs, frame, learned, markers, share_found

FRAMES = 40
RATE = 8.0
"""Frames of the ramps below, and how many each second; the light falls as slowly as in the pass mark."""


@pytest.fixture(scope="module")
def model():
    return learned().model


def ramp(adaptation, *, light=0.4, cast=(0.85, 1.0, 1.15), shown=lambda k: markers()):
    """Share of the markers found in each frame while the light falls and takes on a cast."""
    found = []
    for k in range(FRAMES):
        u = k / (FRAMES - 1)
        image = frame(light=1 + u * (light - 1), cast=1 + u * (np.array(cast) - 1), seed=k)
        found.append(share_found(image, adaptation.table))
        adaptation.update(Frame(image, k, k / RATE), shown(k))
    return found


@pytest.mark.parametrize("cast", [(0.85, 1.0, 1.15), (1.15, 1.0, 0.85), (1.0, 1.0, 1.0)])
def test_markers_are_found_while_the_light_falls_to_two_fifths_with_a_cast(model, cast):
    """Pass mark: 99 %, and here every one of 240."""
    assert np.mean(ramp(LightAdaptation(model), cast=cast)) >= 0.99


def test_following_finds_what_the_model_alone_does_not(model):
    """At two fifths of the light the green of a marker is the green of the field as it was."""
    following, alone = LightAdaptation(model), LightAdaptation(model, enabled=False)
    assert ramp(following)[-1] == 1.0
    assert ramp(alone)[-1] < 0.7


def test_light_and_cast_are_what_the_lamps_did(model):
    adaptation = LightAdaptation(model)
    cast = np.array([0.9, 1.0, 1.1])
    for k in range(80):
        adaptation.update(Frame(frame(light=0.6, cast=cast, seed=k), k, k / RATE), markers())
    assert adaptation.light == pytest.approx(0.6, rel=0.03)
    np.testing.assert_allclose(adaptation.cast, cast, rtol=0.04)
    assert np.abs(adaptation.history[-1].shifts).max() < 0.06  # what the noise of dark channels leaves


def test_switched_off_nothing_moves(model):
    adaptation = LightAdaptation(model, enabled=False)
    before = adaptation.table
    ramp(adaptation)
    assert adaptation.table is before
    assert adaptation.light == 1.0
    assert not adaptation.history
    assert adaptation.summary() == "the light was not followed"


def test_only_log_chroma_can_be_followed():
    model = learned(space="hsv").model
    assert not LightAdaptation(model).enabled
    with pytest.raises(VisionError, match="log-chroma only, these colours are in hsv"):
        LightAdaptation(model, enabled=True)


def test_without_a_change_of_light_the_table_stays(model):
    adaptation = LightAdaptation(model)
    before = adaptation.table
    for k in range(20):
        assert not adaptation.update(Frame(frame(seed=k), k, k / RATE), markers())
    assert adaptation.table is before


def test_changes_are_logged_and_kept(model, caplog):
    adaptation = LightAdaptation(model)
    with caplog.at_level(logging.INFO, logger="pieper.perception.adapt"):
        ramp(adaptation)
    assert len(caplog.records) == len(adaptation.history) >= 3
    assert "light" in caplog.text
    assert adaptation.history[-1].light < adaptation.history[0].light
    assert f"renewed {len(adaptation.history)} times" in adaptation.summary()


def test_the_history_is_bounded_and_the_count_is_not(model, monkeypatch):
    monkeypatch.setattr(adapt, "_KEPT", 2)
    adaptation = LightAdaptation(model)
    ramp(adaptation)
    assert len(adaptation.history) == 2
    renewed = int(adaptation.summary().split("renewed ")[1].split()[0])
    assert renewed > 2


def test_the_table_is_renewed_at_most_as_often_as_allowed(model):
    adaptation = LightAdaptation(model, every=1.0)
    ramp(adaptation)
    times = [change.time for change in adaptation.history]
    assert np.diff(times).min() >= 1.0


background_paint = st.tuples(*[st.integers(0, 255)] * 3)


@given(background_paint, st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_background_that_is_taken_for_a_marker_does_not_move_the_model(paint, seed):
    """Wherever blobs are said to be, pixels that are not of the colour tell nothing."""
    adaptation = MOVABLE
    adaptation.reset()
    rng = np.random.default_rng(seed)
    image = frame(places={}, field=paint, noise=4.0, seed=seed)
    for k in range(6):
        rows = [(name, rng.uniform([0, 0], SIZE), RADIUS) for name in PAINT]
        image_labels = adaptation.table.classify(image)
        free = [row for row in rows if not (image_labels == list(PAINT).index(row[0]) + 1).any()]
        adaptation.update(Frame(image, k, k / 2), blobs(free))
    assert adaptation.light == 1.0
    assert not adaptation.history


@given(st.lists(st.tuples(background_paint, st.floats(-5, 20), st.integers(0, 2)), min_size=1, max_size=12))
@settings(max_examples=40, deadline=None)
def test_whatever_it_is_fed_it_stays_within_bounds_and_colours_stay_apart(steps):
    """Uniform images of any colour, said to be any marker, at any times: also those that the model takes for its own."""
    adaptation = MOVABLE
    adaptation.reset()
    time = 0.0
    for paint, dt, which in steps:
        time += dt
        image = np.empty((40, 40, 3), np.uint8)
        image[:] = paint
        adaptation.update(Frame(image, 0, time), blobs([(list(PAINT)[which], (20, 20), RADIUS)]))
        check_bounds(adaptation)


def check_bounds(adaptation):
    assert 0.25 - 1e-9 <= adaptation.light <= 4.0 + 1e-9
    assert np.abs(np.log(adaptation.cast)).max() <= 0.35 + 1e-9
    learned_means = adaptation._learned.means
    lit = LogChroma().lit(learned_means, np.log(adaptation.light) + np.log(adaptation.cast))
    now = adaptation._means()
    shift = np.linalg.norm(now - lit, axis=1)
    assert shift.max() <= 0.2 + 1e-9
    for i in range(len(lit)):  # each is nearer to its own place than to that of any other, so no two have crossed
        others = np.delete(np.linalg.norm(now[i] - lit, axis=1), i)
        assert shift[i] < others.min()
    first = np.linalg.norm(lit[:, None] - lit[None], axis=-1)
    apart = np.linalg.norm(now[:, None] - now[None], axis=-1)
    assert (apart >= 0.5 * first - 1e-9).all()


def test_a_marker_that_turns_into_another_colour_is_left_behind(model):
    """The worst case: paint that moves slowly from red to blue, all the while said to be red and confirmed."""
    adaptation = LightAdaptation(model, seconds=0.2)
    red, blue = np.array(PAINT["red"]), np.array(PAINT["blue"])
    for k in range(200):
        image = np.empty((40, 40, 3), np.uint8)
        image[:] = np.rint(red + (blue - red) * k / 199)
        adaptation.update(Frame(image, k, k / RATE), blobs([("red", (20, 20), RADIUS)]))
        check_bounds(adaptation)
    labels = adaptation.table.classify(frame(seed=1))
    x, y = PLACES["blue"][0]
    assert labels[y, x] == 2


def test_it_goes_back_when_nothing_is_confirmed_any_more(model):
    adaptation = LightAdaptation(model, forget=2.0)
    for k in range(40):
        adaptation.update(Frame(frame(light=0.6, seed=k), k, k / RATE), markers())
    assert adaptation.light < 0.7
    for k in range(40, 160):
        adaptation.update(Frame(frame(light=0.6), k, k / RATE), blobs([]))
    assert adaptation.light == pytest.approx(1.0, abs=0.01)
    assert (adaptation.table.labels != model.table().labels).mean() < 0.01


def test_clocks_that_jump_or_go_back_are_survived(model):
    adaptation = LightAdaptation(model)
    for k, time in enumerate([0.0, 1e9, -1e9, 5.0, 5.0, 4.0]):
        adaptation.update(Frame(frame(light=0.8, seed=k), k, time), markers())
        check_bounds(adaptation)
    assert adaptation.light > 0.75


def test_ragged_patches_tell_nothing(model):
    adaptation = LightAdaptation(model)
    ragged = replace(markers(), circularity=np.full(6, 0.4))
    for k in range(10):
        adaptation.update(Frame(frame(light=0.7), k, k / RATE), ragged)
    assert adaptation.light == 1.0


def test_blobs_at_the_border_and_names_it_does_not_know_are_passed_over(model):
    adaptation = LightAdaptation(model)
    odd = blobs([("red", (-30.0, 5.0), 3.0), ("red", (np.nan, 5.0), 3.0), ("blue", (179.4, 99.4), 0.2)])
    assert not adaptation.update(Frame(frame(), 0, 0.0), odd)


MOVABLE = LightAdaptation(learned().model)
"""One for the properties, reset each time: to make a table for every example takes long."""
