"""What the guard lets pass: a page on this machine that has the token, and its own websocket."""

from __future__ import annotations

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.viewer.guard import Guard

HOST = "127.0.0.1:8080"
PAGE = "http://127.0.0.1:8080"


class Request:
    """Headers as a list of pairs, as they come over the wire."""

    def __init__(self, *pairs):
        self.pairs = pairs

    def get_all(self, key):
        return [value for name, value in self.pairs if name.lower() == key.lower()]


@pytest.fixture
def guard():
    return Guard("the-token", cookie_name="pieper-8080")


@pytest.fixture
def cookie(guard):
    return guard.judge("/?token=the-token", Request(("Host", HOST))).cookie.partition(";")[0]


def websocket(*pairs):
    return Request(("Upgrade", "websocket"), *pairs)


def test_the_token_is_answered_with_a_cookie_that_scripts_and_other_sites_cannot_use(guard):
    verdict = guard.judge("/?token=the-token", Request(("Host", HOST)))
    assert verdict.refusal is None
    assert verdict.cookie.startswith("pieper-8080=")
    assert "; HttpOnly" in verdict.cookie
    assert "; SameSite=Strict" in verdict.cookie
    assert "the-token" not in verdict.cookie


def test_the_cookie_opens_the_page_and_its_websocket(guard, cookie):
    assert guard.judge("/", Request(("Host", HOST), ("Cookie", cookie))).refusal is None
    mine = websocket(("Host", HOST), ("Origin", PAGE), ("Cookie", f"other=1; {cookie}; more=2"))
    assert guard.judge("/", mine).refusal is None


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LocalHost:9999", "localhost"])
def test_this_machine_by_any_of_its_names_and_through_any_forwarded_port(guard, cookie, host):
    mine = websocket(("Host", host), ("Origin", f"http://{host}"), ("Cookie", cookie))
    assert guard.judge("/", mine).refusal is None


@pytest.mark.parametrize(
    "target",
    [
        "/",
        "/?token=",
        "/?token=wrong",
        "/?token=the-token&token=the-token",
        "/?Token=the-token",
        "/the-token",
        "/?" + "&" * 100,
        "/?token=the-toke\udcff",
        "/?token=the-token%00",
    ],
)
def test_no_token_no_page(guard, target):
    assert "needs the token" in guard.judge(target, Request(("Host", HOST))).refusal


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1.evil.example",
        "127.0.0.1:8080@evil",
        "evil.example:8080",
        "[::1]:8080",
        "localhost.:80",
        "0.0.0.0",
        "",
        "127.0.0.1:",
        "127.0.0.1:٣",
        "localhost\n",
    ],
)
def test_a_foreign_host_is_refused_with_the_token_and_the_cookie(guard, cookie, host):
    for request in (Request, websocket):
        verdict = guard.judge(
            "/?token=the-token", request(("Host", host), ("Origin", f"http://{host}"), ("Cookie", cookie))
        )
        assert verdict.refusal == "this viewer answers to 127.0.0.1 and localhost alone"
        assert verdict.cookie is None


@pytest.mark.parametrize("pairs", [(), (("Host", HOST), ("Host", HOST))])
def test_a_host_is_named_once(guard, pairs):
    assert guard.judge("/?token=the-token", Request(*pairs)).refusal is not None


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "https://127.0.0.1:8080",
        "http://127.0.0.1:8081",
        "http://localhost:8080",
        PAGE + "/",
        "file://",
    ],
)
def test_a_foreign_origin_is_refused_with_the_token_and_the_cookie(guard, cookie, origin):
    for request in (Request, websocket):
        verdict = guard.judge("/?token=the-token", request(("Host", HOST), ("Origin", origin), ("Cookie", cookie)))
        assert verdict.refusal == "this viewer answers to its own page alone"


def test_a_websocket_needs_its_origin_once(guard, cookie):
    for origins in [(), (("Origin", PAGE), ("Origin", PAGE))]:
        assert "own page" in guard.judge("/", websocket(("Host", HOST), *origins, ("Cookie", cookie))).refusal


def test_a_websocket_needs_the_cookie_and_the_token_is_not_enough(guard):
    verdict = guard.judge("/?token=the-token", websocket(("Host", HOST), ("Origin", PAGE)))
    assert "open the address that the viewer printed" in verdict.refusal


def test_the_cookie_of_another_viewer_is_not_enough(guard):
    other = Guard("the-token", cookie_name="pieper-8080")
    cookie = other.judge("/?token=the-token", Request(("Host", HOST))).cookie.partition(";")[0]
    assert guard.judge("/", Request(("Host", HOST), ("Cookie", cookie))).refusal is not None


@given(st.text(string.printable, max_size=60))
def test_nothing_but_the_token_opens(text):
    guard = Guard()
    assert guard.judge(f"/?token={text}", Request(("Host", HOST))).refusal is not None
    assert guard.judge(text, Request(("Host", HOST), ("Cookie", text))).refusal is not None


def test_tokens_are_long_and_never_the_same():
    tokens = {Guard().token for _ in range(50)}
    assert len(tokens) == 50
    assert min(map(len, tokens)) >= 43  # 256 bits, six in a letter
