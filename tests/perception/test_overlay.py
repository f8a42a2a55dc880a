"""What is drawn over a frame: the marks of the report at the sizes it gives, where the tracker says, and nothing of before."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pieper.perception import overlay
from pieper.perception.blobs import Blobs
from pieper.perception.camera import Camera
from pieper.perception.estimate import Estimate
from pieper.perception.field_view import FieldView
from pieper.perception.frame import Frame
from pieper.perception.overlay import Overlay
from pieper.perception.sighting import Sighting

GREY = 120
AT = np.array([150.0, 100.0])


def blank() -> np.ndarray:
    return np.full((200, 320, 3), GREY, np.uint8)


def estimate(state="seen", *, track=1, name="Red", at=AT, heading=None, spread=1.0, kind="marker") -> Estimate:
    n = 4 if heading is None else 6
    return Estimate(
        track, kind, name, 0.0, np.array(at, float), heading, np.zeros(2), None, spread * np.eye(n), state, 0.0, 1.0
    )


def blobs(*centroids, radius=12.0, names=("Red",)) -> Blobs:
    k = len(centroids)
    return Blobs(
        names,
        np.arange(k) % len(names),
        np.array(centroids, float).reshape(k, 2),
        np.zeros((k, 2, 2)),
        np.full(k, np.pi * radius**2),
        np.zeros((k, 4), int),
        np.ones(k),
    )


NOTHING = blobs()


def step(*estimates, blobs=NOTHING, sightings=()):
    return SimpleNamespace(blobs=blobs, sightings=sightings, estimates=estimates)


def drawn(*estimates, options=None, **found) -> np.ndarray:
    return Overlay(**(options or {})).draw(Frame(blank(), 0, 0.0), step(*estimates, **found))


def changed(image: np.ndarray) -> np.ndarray:
    return (image != GREY).any(axis=-1)


def box(mask: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right, bottom."""
    rows, columns = np.nonzero(mask)
    return columns.min(), rows.min(), columns.max(), rows.max()


def like(image, bgr, tolerance=60):
    return (np.abs(image.astype(int) - bgr) <= tolerance).all(axis=-1)


def texts(monkeypatch):
    """Every text that is written, with its place, font scale and colour; rims left out."""
    written = []
    real = cv2.putText

    def put(image, text, at, font, scale, color, *rest):
        if color != (0, 0, 0):
            written.append((text, at, font, scale, color))
        return real(image, text, at, font, scale, color, *rest)

    monkeypatch.setattr(cv2, "putText", put)
    return written


def test_A12_a_detection_has_a_circle_of_its_radius_and_a_label_beside_it(monkeypatch):
    written = texts(monkeypatch)
    image = blank()
    overlay.draw_blobs(image, blobs(AT, radius=12.0), [0])
    assert written == [("Red", (160, 100), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 255))]
    ring = like(image, (0, 0, 255), 120)
    ring[:, 159:] = False  # the label
    y, x = np.nonzero(ring)
    assert len(x) > 20
    assert np.abs(np.hypot(x - AT[0], y - AT[1]) - 12.0).max() < 1.5  # width of the line, and its soft edge


def test_A12_only_detections_are_circled(monkeypatch):
    written = texts(monkeypatch)
    sighting = Sighting("marker", "Red", AT, None, np.eye(2), (1,))
    drawn(blobs=blobs([30, 30], AT), sightings=(sighting,))
    assert [(text, at) for text, at, *_ in written] == [("Red", (160, 100))]


def test_A14_a_hidden_marker_has_a_red_text_and_a_cross_of_20_pixels(monkeypatch):
    written = texts(monkeypatch)
    image = drawn(estimate("hidden", spread=0.01), options={"colors": {"Red": (255, 0, 255)}})
    assert written == [("Red P(Ocuido)", (160, 100), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 255))]
    cross = (image == (255, 0, 255)).all(axis=-1)
    assert box(cross) == (140, 90, 160, 110)  # 10 px to each side
    assert cross[100, 140:161].sum() > 15
    assert cross[90:111, 150].sum() > 15


def test_A14_a_seen_marker_has_a_green_tilted_cross_of_15_pixels():
    image = drawn(estimate("seen", spread=0.01))
    cross = like(image, (0, 255, 0), 120)
    left, top, right, bottom = box(cross)
    assert (left, top, right, bottom) == pytest.approx((143, 93, 157, 107), abs=1)
    assert cross[95, 145]
    assert cross[105, 145]
    assert not cross[95, 150]  # tilted: nothing above the middle


def test_A14_P4_a_mark_of_before_does_not_stay(monkeypatch):
    pen = Overlay(trail=0)
    frame = Frame(blank(), 0, 0.0)
    pen.draw(frame, step(estimate("seen")))
    written = texts(monkeypatch)
    assert not changed(pen.draw(frame, step())).any()
    assert not changed(pen.draw(frame, step(estimate("lost")))).any()
    assert not written


def test_the_frame_itself_stays_as_it_is():
    frame = Frame(blank(), 0, 0.0)
    Overlay().draw(frame, step(estimate("seen", heading=1.0, kind="robot")))
    assert (frame.image == GREY).all()


@pytest.mark.parametrize("heading", [0.0, 1.0, 3.0, -2.0])
def test_the_arrow_points_along_the_heading(heading):
    with_arrow = drawn(estimate(heading=heading, kind="robot", spread=1e-4), options={"trail": 0})
    without = drawn(estimate(kind="robot", spread=1e-4), options={"trail": 0})
    y, x = np.nonzero((with_arrow != without).any(axis=-1))
    away = np.stack([x, y], axis=-1) - AT
    ahead = np.array([np.cos(heading), np.sin(heading)])  # in pixels from right to down
    assert away.mean(axis=0) @ ahead > 10
    assert np.hypot(*away.T).max() == pytest.approx(28, abs=4)  # and half the width of the line


def test_the_ellipse_holds_95_percent():
    image = blank()
    P = np.array([[100.0, 30.0], [30.0, 50.0]])
    overlay.draw_ellipse(image, AT, P, (255, 255, 255))
    y, x = np.nonzero(changed(image))
    away = np.stack([x, y], axis=-1) - AT
    distance = np.sqrt(np.einsum("ni,ij,nj->n", away, np.linalg.inv(P), away))
    from scipy.stats import chi2

    assert (
        np.abs(distance - np.sqrt(chi2.ppf(0.95, 2))).max() < 0.4
    )  # a line of a pixel, and its soft edge, against 7 px


def test_a_trail_shows_where_a_track_was_and_ends_with_it():
    pen = Overlay(trail=10)
    frame = Frame(blank(), 0, 0.0)
    for x in range(60, 160, 4):
        image = pen.draw(frame, step(estimate("seen", at=(x, 150), spread=1e-4)))
    left, *_ = box(changed(image))
    assert left == pytest.approx(156 - 4 * 9, abs=1)
    pen.draw(frame, step())
    image = pen.draw(frame, step(estimate("seen", at=(60, 150), spread=1e-4)))
    assert box(changed(image))[2] < 80


def test_metres_are_drawn_where_the_camera_sees_them_at_their_height():
    camera = Camera([[400, 0, 160], [0, 400, 100], [0, 0, 1]], [], (320, 200))
    view = FieldView(camera, [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    at = view.to_image([0.3, 0.2], height=0.5)
    image = drawn(
        estimate("seen", at=(0.3, 0.2), heading=np.pi / 2, kind="robot", name="", spread=1e-8),
        options={"view": view, "height": {"robot": 0.5}, "trail": 0},
    )
    left, _, right, bottom = box(like(image, (0, 255, 0), 120))
    assert ((left + right) / 2, bottom) == pytest.approx((at[0], at[1] + 7), abs=1.5)
    y, _ = np.nonzero(changed(image))
    assert y.min() < at[1] - 20  # y of the field is up in the image, so is the arrow


@pytest.mark.parametrize("at", [(1e9, 0.0), (0.0, -1e12), (-500.0, -500.0)])
def test_places_that_cannot_be_drawn_are_left_out(at):
    assert not changed(drawn(estimate(at=at), options={"trail": 0})).any()


def test_names_of_any_alphabet_are_drawn():
    assert changed(drawn(estimate("hidden", name="зелёный"))).any()
