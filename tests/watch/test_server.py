"""The server of a live view answers whoever knows its address, on this machine, and nobody else."""

from __future__ import annotations

import socket
import struct
import threading

import pytest

from wsnsim.base.errors import UsageError
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


def test_more_connections_than_it_serves_are_closed_and_do_not_stop_it(server, ask):
    silent = [socket.create_connection((HOST, server.port), timeout=20) for _ in range(MOST_REQUESTS + 4)]
    assert [each.recv(10) for each in silent[MOST_REQUESTS:]] == [b""] * 4
    for each in silent:
        each.close()
    served = threading.Event()
    for _ in range(200):
        try:
            served.set() if ask(server.url)[0] == 200 else None
            break
        except OSError:  # the threads of the closed connections are just ending
            served.wait(0.05)
    assert served.is_set()


def test_a_closed_server_answers_no_more(ask):
    with WatchServer(answers) as server:
        url = server.url
    with pytest.raises(ConnectionRefusedError):
        ask(url)
