"""The server of a live view answers whoever knows its address, on this machine, and nobody else."""

from __future__ import annotations

import socket
import struct
import threading

import pytest

from wsnsim.base.errors import UsageError
from wsnsim.watch import server as module
from wsnsim.watch.server import HOST, MOST_REQUESTS, HttpAnswer, WatchServer

LARGE = b"x" * 20_000_000


def answers(name, given):
    return {"": HttpAnswer(b"page"), "large": HttpAnswer(LARGE), "given": HttpAnswer.json(dict(given))}.get(name)


@pytest.fixture
def server():
    with WatchServer(answers) as made:
        yield made


def test_the_address_with_its_token_is_answered_and_no_other(server, ask):
    status, headers, body = ask(server.url)
    assert (status, body) == (200, b"page")
    assert headers["Content-Security-Policy"].startswith("default-src 'none'")
    assert (headers["Cache-Control"], headers["Referrer-Policy"]) == ("no-store", "no-referrer")
    assert ask(server.url, "given?run=3")[2] == b'{"run": "3"}'
    root = f"http://{HOST}:{server.port}/"
    for path in (
        "",
        "state",
        "favicon.ico",
        "../etc/passwd",
        server.url[len(root) : -2] + "/",
        server.url[len(root) : -1],
    ):
        assert ask(root, path)[0] == 404, path
    for name in ("unknown", "../", "%2e%2e/%2e%2e/etc/passwd", "/etc/passwd"):
        assert ask(server.url, name)[0] == 404, name


def test_each_server_has_another_long_token():
    with WatchServer(answers) as one, WatchServer(answers) as other:
        tokens = [each.url.split("/")[3] for each in (one, other)]
    assert len(set(tokens)) == 2 and all(len(token) >= 32 for token in tokens)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_another_host_name_and_the_pages_of_other_sites_are_refused(server, ask, headers):
    assert ask(server.url, **headers)[0] == 403


def test_its_own_page_and_the_name_localhost_are_allowed(server, ask):
    own = f"http://{HOST}:{server.port}"
    for headers in ({"Origin": own}, {"Host": f"localhost:{server.port}"}, {"Sec-Fetch-Site": "same-origin"}):
        assert ask(server.url, **headers)[0] == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "HEAD"])
def test_only_get_is_answered(server, ask, method):
    assert ask(server.url, method=method)[0] == 501


def test_it_listens_on_the_loopback_interface_only(server):
    assert server._server.server_address[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_named(server):
    with pytest.raises(UsageError, match=f"--port {server.port}: cannot be used"):
        WatchServer(answers, server.port)


def test_tabs_that_are_closed_in_the_middle_of_an_answer_trouble_nobody(server, ask, capfd):
    for _ in range(3):
        raw = socket.create_connection((HOST, server.port))
        path, host = server.url.split(str(server.port))[1], f"{HOST}:{server.port}"
        raw.sendall(f"GET {path}large HTTP/1.0\r\nHost: {host}\r\n\r\n".encode())
        assert raw.recv(100)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closed with a reset
        raw.close()
    assert ask(server.url)[2] == b"page"
    assert capfd.readouterr() == ("", "")


def test_bytes_that_are_no_request_are_refused(server, ask):
    for sent in (b"\x16\x03\x01\x02\x00\x01\r\n\r\n", b"GET //[ HTTP/1.0\r\nHost: x\r\n\r\n", b"\r\n"):
        with socket.create_connection((HOST, server.port), timeout=20) as raw:
            raw.sendall(sent)
            raw.shutdown(socket.SHUT_WR)
            assert b"Traceback" not in raw.recv(10_000)
    assert ask(server.url)[0] == 200


def connected(server, request=b"", **options):
    raw = socket.create_connection((HOST, server.port), timeout=20)
    for name, value in options.items():
        raw.setsockopt(socket.SOL_SOCKET, getattr(socket, name), value)
    raw.sendall(request)
    return raw


def request_of(server, name):
    path, host = server.url.split(str(server.port))[1], f"{HOST}:{server.port}"
    return f"GET {path}{name} HTTP/1.0\r\nHost: {host}\r\n\r\n".encode()


def test_connections_that_ask_nothing_give_way_to_a_request(server, ask):
    """The page was blocked for 18 s."""
    idle = [connected(server, sent) for sent in (b"", b"GET / HTTP", b"GET / HTTP/1.0\r\nA: ") for _ in range(34)]
    assert ask(server.url)[2] == b"page"
    assert len(server._server.open) <= MOST_REQUESTS
    for each in idle:
        each.close()


def test_slow_readers_give_way_to_a_request_and_idle_connections_to_both(server, ask):
    """The page was blocked for good."""
    slow = [connected(server, request_of(server, "large"), SO_RCVBUF=4096) for _ in range(MOST_REQUESTS)]
    assert all(each.recv(10) == b"HTTP/1.0 2" for each in slow)
    assert ask(server.url)[2] == b"page"
    idle = [connected(server) for _ in range(2 * MOST_REQUESTS)]
    assert ask(server.url)[2] == b"page"
    assert sum(asked for asked, _ in server._server.open.values()) >= MOST_REQUESTS - 4  # most still read
    for each in [*slow, *idle]:
        each.close()


@pytest.mark.parametrize(("name", "seconds"), [("", "TIME_TO_ASK"), ("large", "TIME_TO_ANSWER")])
def test_a_whole_request_has_a_time_in_which_it_is_made_and_its_answer_taken(monkeypatch, name, seconds):
    monkeypatch.setattr(module, seconds, -1.0)
    before = threading.active_count() + 1  # with that of the server
    with WatchServer(answers) as server:
        raw = connected(server, request_of(server, name) if name else b"GET")  # and takes nothing
        assert name == "" or raw.recv(10)
        for _ in range(600):  # its thread ends; the time is only that of a machine that is busy
            if not server._server.open and threading.active_count() <= before:
                break
            threading.Event().wait(0.05)
        assert not server._server.open and threading.active_count() <= before
        raw.close()


def test_a_closed_server_answers_no_more(ask):
    with WatchServer(answers) as server:
        url = server.url
    with pytest.raises(ConnectionRefusedError):
        ask(url)
