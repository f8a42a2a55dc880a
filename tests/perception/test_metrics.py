"""The figures against two programs that others wrote, on random scenes, and against cases that can be counted by hand."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from pieper.errors import ArrayError
from pieper.perception import metrics
from pieper.perception.metrics import Moment

REACH = 0.05
SAME = 1e-12  # the same sums in another order


@pytest.fixture(scope="module")
def trackeval():
    """Its metric classes alone: its own front page asks for a second OpenCV, which clashes with the one that is here."""
    found = importlib.util.find_spec("trackeval")
    if found is None:
        pytest.skip("trackeval is not installed; scripts/setup.sh brings it")
    folder = Path(found.submodule_search_locations[0])
    before = {name: module for name, module in sys.modules.items() if name.split(".")[0] == "trackeval"}
    for name, path in (("trackeval", folder), ("trackeval.metrics", folder / "metrics")):
        package = types.ModuleType(name)
        package.__path__ = [str(path)]
        sys.modules[name] = package
    yield {
        "hota": importlib.import_module("trackeval.metrics.hota").HOTA(),
        "clear": importlib.import_module("trackeval.metrics.clear").CLEAR({"THRESHOLD": 0.5, "PRINT_CONFIG": False}),
        "identity": importlib.import_module("trackeval.metrics.identity").Identity(
            {"THRESHOLD": 0.5, "PRINT_CONFIG": False}
        ),
    }
    for name in [name for name in sys.modules if name.split(".")[0] == "trackeval"]:
        del sys.modules[name]
    sys.modules.update(before)


@st.composite
def scenes(draw, ambiguous=True):
    """Things that wander, and tracks that follow them with error, miss, swap and invent."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    things, frames = draw(st.integers(1, 5)), draw(st.integers(1, 12))
    sigma = draw(st.sampled_from([0.0, 0.01, 0.04]))
    gap = draw(st.sampled_from([0.03, 0.1])) if ambiguous else 1.0
    miss, swap, clutter = draw(st.floats(0, 0.5)), draw(st.floats(0, 0.3)), draw(st.integers(0, 2))
    name = np.arange(things)
    moments = []
    for _ in range(frames):
        there = np.flatnonzero(random.random(things) > 0.1)
        place = np.stack([there * gap, np.zeros(len(there))], axis=-1)
        if random.random() < swap:
            name = random.permutation(things + 2)[:things]
        seen = random.random(len(there)) >= miss
        noise = np.minimum(np.abs(random.normal(0, sigma, (len(there), 2))), 0.1)
        tracks = np.concatenate([name[there[seen]], things + 2 + random.permutation(5)[:clutter]])
        said = np.concatenate([(place + noise)[seen], random.uniform(0, things * gap, (clutter, 2))])
        distance = np.linalg.norm(place[:, None] - said[None], axis=-1)
        moments.append(Moment(there, tracks, distance))
    return moments


def for_trackeval(moments):
    things = {n: k for k, n in enumerate(sorted({int(n) for m in moments for n in m.things}))}
    tracks = {n: k for k, n in enumerate(sorted({int(n) for m in moments for n in m.tracks}))}
    return {
        "num_gt_dets": sum(len(m.things) for m in moments),
        "num_tracker_dets": sum(len(m.tracks) for m in moments),
        "num_gt_ids": len(things),
        "num_tracker_ids": len(tracks),
        "num_timesteps": len(moments),
        "gt_ids": [np.array([things[int(n)] for n in m.things], int) for m in moments],
        "tracker_ids": [np.array([tracks[int(n)] for n in m.tracks], int) for m in moments],
        "similarity_scores": [m.similarity(REACH) for m in moments],
    }


@given(scenes())
def test_hota_is_that_of_trackeval(trackeval, moments):
    data = for_trackeval(moments)
    theirs, ours = trackeval["hota"].eval_sequence(data), metrics.hota(moments, reach=REACH)
    if not data["num_tracker_dets"] or not data["num_gt_dets"]:
        assert ours.hota == 0
        return
    for field, value in (
        ("HOTA", ours.hota),
        ("DetA", ours.detection),
        ("AssA", ours.association),
        ("LocA", ours.location),
    ):
        assert value == pytest.approx(np.mean(theirs[field]), abs=SAME)


@given(scenes())
def test_idf1_is_that_of_trackeval(trackeval, moments):
    theirs, ours = trackeval["identity"].eval_sequence(for_trackeval(moments)), metrics.identity(moments, reach=REACH)
    assert (ours.agreed, ours.false, ours.missed) == (theirs["IDTP"], theirs["IDFP"], theirs["IDFN"])
    if ours.agreed:
        assert ours.idf1 == pytest.approx(theirs["IDF1"], abs=SAME)


@given(scenes())
def test_mota_and_its_parts_are_those_of_trackeval(trackeval, moments):
    moments = [
        m for m in moments if len(m.things) and len(m.tracks)
    ]  # elsewhere it keeps pairs of the frame before last
    theirs, ours = trackeval["clear"].eval_sequence(for_trackeval(moments)), metrics.clear(moments, reach=REACH)
    if not moments:
        return
    assert (ours.found, ours.false, ours.missed) == (theirs["CLR_TP"], theirs["CLR_FP"], theirs["CLR_FN"])
    assert ours.switches == theirs["IDSW"]
    assert ours.mota == pytest.approx(theirs["MOTA"], abs=SAME)
    assert ours.precision == pytest.approx(theirs["CLR_Pr"], abs=SAME)
    assert ours.recall == pytest.approx(theirs["CLR_Re"], abs=SAME)


@settings(max_examples=25)  # it builds tables of text for each scene
@given(scenes(ambiguous=False))
def test_mota_and_idf1_are_those_of_motmetrics(moments):
    # Things further apart than twice the reach: with a choice between pairs, motmetrics remembers them longer than CLEAR says.
    import motmetrics

    moments = [m for m in moments if len(m.things)]
    if not moments:
        return
    book = motmetrics.MOTAccumulator(auto_id=True)
    for m in moments:
        book.update(m.things, m.tracks, np.where(m.distance <= REACH, m.distance, np.nan))
    names = ["mota", "idf1", "num_switches", "num_false_positives", "num_misses", "motp", "idtp"]
    theirs = motmetrics.metrics.create().compute(book, metrics=names, name="it").loc["it"]
    ours, same = metrics.clear(moments, reach=REACH), metrics.identity(moments, reach=REACH)
    assert (ours.false, ours.missed) == (theirs["num_false_positives"], theirs["num_misses"])
    assert ours.switches == theirs["num_switches"]
    assert ours.mota == pytest.approx(theirs["mota"], abs=SAME)
    assert same.agreed == theirs["idtp"]
    if same.agreed:
        assert same.idf1 == pytest.approx(theirs["idf1"], abs=SAME)
        assert ours.distance == pytest.approx(theirs["motp"], abs=SAME)


@given(scenes())
def test_the_names_of_the_tracks_do_not_matter(moments):
    renamed = [Moment(m.things, 17 - m.tracks, m.distance) for m in moments]
    assert repr(metrics.clear(renamed)) == repr(metrics.clear(moments))  # by its text: NaN is not equal to itself
    assert metrics.identity(renamed) == metrics.identity(moments)
    assert metrics.hota(renamed).hota == pytest.approx(metrics.hota(moments).hota, abs=SAME)


def test_perfect_tracking_has_perfect_figures():
    moments = [Moment([0, 1], [5, 3], [[0, 1], [1, 0]])] * 4
    assert metrics.clear(moments).mota == metrics.identity(moments).idf1 == metrics.hota(moments).hota == 1


def test_a_pair_is_kept_while_it_is_within_reach_though_another_comes_nearer():
    moments = [Moment([0], [0, 1], [[0.01, 0.04]]), Moment([0], [0, 1], [[0.04, 0.01]])]
    assert metrics.clear(moments, reach=REACH).switches == 0


def test_one_thing_twice_in_a_frame_is_refused():
    with pytest.raises(ArrayError, match="twice in one frame"):
        Moment([1, 1], [0], [[0.0], [0.0]])
    with pytest.raises(ArrayError, match="must be 0 or more"):
        Moment([1], [0], [[np.nan]])


@pytest.mark.parametrize("freedom", [1, 2, 3])
def test_honest_covariances_are_found_honest(freedom):
    random = np.random.default_rng(3)
    root = random.standard_normal((4000, freedom, freedom)) + 2 * np.eye(freedom)
    errors = (root @ random.standard_normal((4000, freedom, 1)))[..., 0]
    result = metrics.consistency(errors, root @ root.transpose(0, 2, 1))
    # Binomial: 0.95 +- 4 sqrt(0.95 * 0.05 / 4000)
    assert result.inside == pytest.approx(0.95, abs=0.014)
    assert result.mean == pytest.approx(1, abs=4 * np.sqrt(2 / freedom / 4000))
    assert result.band == pytest.approx(tuple(chi2.interval(0.95, freedom)))


def test_too_sure_and_too_shy_are_told_apart():
    errors = np.random.default_rng(4).standard_normal((2000, 2))
    sure, shy = (metrics.consistency(errors, np.broadcast_to(np.eye(2) * k, (2000, 2, 2))) for k in (0.1, 10))
    assert sure.mean > 5 > 0.2 > shy.mean
    assert max(sure.inside, shy.inside) < 0.9


def test_the_covariances_must_fit_the_errors():
    with pytest.raises(ArrayError, match=r"must have shape \(2, 2, 2\), got \(2, 3, 3\)"):
        metrics.nees(np.zeros((2, 2)), np.zeros((2, 3, 3)))


def test_nothing_gives_no_figures():
    assert np.isnan(metrics.spread([]).rms)
    assert np.isnan(metrics.consistency(np.zeros((0, 2)), np.zeros((0, 2, 2))).inside)
    assert np.isnan(metrics.clear([]).mota)
