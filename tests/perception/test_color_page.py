"""The page for picking boxes answers its own page on this machine, and nobody else."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from pieper.errors import PieperError
from pieper.perception.color_page import LARGEST_BODY, ColorPage
from pieper.perception.color_regions import Region
from tests.perception.color_scenes import box, frame

PATIENCE = 20.0  # [s]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("frames")
    for n in range(3):
        assert cv2.imwrite(str(path / f"{n}.png"), frame(seed=n))
    return path


@pytest.fixture
def page(folder):
    with ColorPage(folder, names=["red"], regions=[box("blue")]) as page:
        yield page


def ask(page, path, *, body=None, method=None, host=None, origin="own", token=True, length=None, raw=None):
    """Status and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE)
    connection.putrequest(method or ("GET" if body is None and raw is None else "POST"), path, skip_host=True)
    connection.putheader("Host", f"127.0.0.1:{page.port}" if host is None else host)
    if origin is not None and (body is not None or raw is not None or origin != "own"):
        connection.putheader("Origin", f"http://127.0.0.1:{page.port}" if origin == "own" else origin)
    if token:
        connection.putheader("X-Pieper-Token", urlsplit(page.url).query.partition("=")[2] if token is True else token)
    payload = raw if raw is not None else b"" if body is None else json.dumps(body).encode()
    if length is not None or body is not None or raw is not None:
        connection.putheader("Content-Length", str(len(payload)) if length is None else length)
    connection.endheaders()
    if length is None:
        connection.send(payload)
    answer = connection.getresponse()
    text = answer.read()
    connection.close()
    return answer.status, text, answer.headers


def row(region):
    return {
        "color": region.color,
        "frame": region.frame,
        "x": region.x,
        "y": region.y,
        "width": region.width,
        "height": region.height,
    }


def test_the_page_comes_with_its_token_and_asks_nothing_from_elsewhere(page):
    target = urlsplit(page.url)
    status, text, headers = ask(page, f"/?{target.query}", token=False)
    assert status == 200
    assert b"http://" not in text
    assert b"https://" not in text
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["Cache-Control"] == "no-store"
    assert page._server.server_address[0] == "127.0.0.1"


def test_state_and_frames(page):
    status, text, _ = ask(page, "/state")
    state = json.loads(text)
    assert status == 200
    assert state["names"] == ["red", "blue"]
    assert state["frames"] == 3
    assert state["regions"] == [row(box("blue"))]
    status, raw, _ = ask(page, "/frame?n=1")
    shown = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)
    assert status == 200
    assert np.abs(shown.astype(int) - frame(seed=1)).mean() < 10


@pytest.mark.parametrize("path", ["/", "/state", "/frame?n=0"])
@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"token": False}, b"needs the token"),
        ({"token": "guess"}, b"needs the token"),
        ({"host": "evil.example:80"}, b"127.0.0.1 and localhost alone"),
        ({"host": "127.0.0.1:1"}, b"127.0.0.1 and localhost alone"),
        ({"origin": "http://evil.example"}, b"to itself alone"),
        ({"origin": "null"}, b"to itself alone"),
    ],
)
def test_strangers_are_refused(page, path, asked, reason):
    status, text, _ = ask(page, path, **asked)
    assert status == 403
    assert reason in text


@pytest.mark.parametrize("path", ["/done", "/preview"])
def test_strangers_cannot_write(page, path):
    body = {"regions": [row(box("red"))], "frame": 0}
    for asked in ({"token": False}, {"origin": None}, {"origin": "http://evil.example"}, {"host": "evil.example"}):
        assert ask(page, path, body=body, **asked)[0] == 403
    with pytest.raises(PieperError, match="no boxes were picked"):
        page.wait(0.01)


@pytest.mark.parametrize(
    ("asked", "status", "reason"),
    [
        ({"raw": b"", "length": str(LARGEST_BODY + 1)}, 413, b"may have"),
        ({"raw": b"", "length": "9" * 30}, 413, b"may have"),
        ({"raw": b"", "length": "-1"}, 411, b"how long"),
        ({"raw": b"["}, 400, b"an object in JSON"),
        ({"raw": b"[" * 100_000}, 400, b"an object in JSON"),
        ({"raw": b"\xff"}, 400, b"an object in JSON"),
        ({"body": []}, 400, b"an object in JSON"),
        ({"body": {}}, 400, b"regions must be a list"),
        ({"body": {"regions": []}}, 400, b"no boxes yet"),
        ({"body": {"regions": [{}] * 1001}}, 400, b"at most 1000"),
        ({"body": {"regions": [1]}}, 400, b"must have whole numbers"),
        ({"body": {"regions": [{**row(box("red")), "x": True}]}}, 400, b"must have whole numbers"),
        ({"body": {"regions": [{**row(box("red")), "x": 1e99}]}}, 400, b"must have whole numbers"),
        ({"body": {"regions": [{**row(box("red")), "color": ""}]}}, 400, b"must have a colour"),
        ({"body": {"regions": [{**row(box("red")), "color": "\ud800"}]}}, 400, b"must have a colour"),
        ({"body": {"regions": [{**row(box("red")), "color": "a\nb"}]}}, 400, b"must have a colour"),
        ({"body": {"regions": [{**row(box("red")), "width": 0}]}}, 400, b"is empty"),
        ({"body": {"regions": [{**row(box("red")), "x": 5000}]}}, 400, b"reaches beyond"),
        ({"body": {"regions": [{**row(box("red")), "frame": 3}]}}, 400, b"not valid frame number: 3"),
    ],
)
def test_malformed_requests_are_refused_and_the_page_lives_on(page, asked, status, reason):
    got, text, _ = ask(page, "/done", **asked)
    assert (got, reason in text) == (status, True), text
    assert ask(page, "/state")[0] == 200


@pytest.mark.parametrize("number", ["3", "-1", "x", "", "9" * 5000])
def test_A3_frame_numbers_that_are_none_are_refused(page, number):
    status, text, _ = ask(page, f"/frame?n={number}")
    assert status == 400
    assert b"not valid frame number" in text


def test_there_is_nothing_else(page):
    assert ask(page, "/../../etc/passwd")[0] == 404
    assert ask(page, "/other", body={})[0] == 404


def test_a_preview_is_a_picture_and_remarks(page):
    body = {"frame": 2, "regions": [row(box("red")), row(Region("crimson", 1, 85, 65, 11, 11))]}
    status, text, _ = ask(page, "/preview", body=body)
    found = json.loads(text)
    assert status == 200
    assert found["image"].startswith("data:image/png;base64,")
    assert any("overlap" in remark for remark in found["remarks"])


def test_A4_done_gives_the_boxes_to_who_waits(page):
    threading.Timer(
        0.05, ask, (page, "/done"), {"body": {"regions": [row(box("red")), row(box("blue", 1, 2))]}}
    ).start()
    assert page.wait(PATIENCE) == [box("red"), box("blue", 1, 2)]


def test_of_two_windows_the_first_that_is_done_counts(page):
    assert ask(page, "/done", body={"regions": [row(box("red"))]})[0] == 200
    status, text, _ = ask(page, "/done", body={"regions": [row(box("blue", 1, 2))]})
    assert (status, b"taken already" in text) == (400, True)
    assert page.wait(PATIENCE) == [box("red")]


def test_a_window_that_is_closed_before_its_answer_is_passed_over(page, capsys):
    where = urlsplit(page.url)
    for _ in range(5):
        with socket.create_connection((where.hostname, where.port)) as line:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # reset when closed
            line.sendall(f"GET /?{where.query} HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode())
    assert ask(page, "/state")[0] == 200
    page.close()
    assert "Traceback" not in capsys.readouterr().err


def test_frames_of_a_video_are_those_of_their_number_in_any_order(tmp_path):
    path = tmp_path / "x.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, (180, 100))
    for n in range(8):
        writer.write(np.full((100, 180, 3), 20 + 25 * n, np.uint8))
    writer.release()
    with ColorPage(path) as page:
        for n in (5, 2, 3, 7, 0):
            assert abs(float(page._frames[n].mean()) - (20 + 25 * n)) < 8


@pytest.mark.parametrize("target", ["http://[::1", "//[", "?" + "&".join("n=1" for _ in range(99))])
def test_an_address_that_is_none_is_refused_without_noise(page, target, capsys):
    with socket.create_connection(("127.0.0.1", page.port), timeout=PATIENCE) as line:
        line.sendall(f"GET {target} HTTP/1.0\r\nHost: 127.0.0.1:{page.port}\r\n\r\n".encode())
        answer = b"".join(iter(lambda: line.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.0 403")
    assert ask(page, "/state")[0] == 200
    assert capsys.readouterr().err == ""
