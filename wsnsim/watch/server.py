"""A server on the loopback interface that shows pages to whoever knows its address, and takes nothing.

    with WatchServer(answer, port) as server: print(server.url)

The address holds a random token. What is asked without it, under another host name, or by the page of another site, is
refused. Only GET is answered, from memory: no file is looked up.
"""

from __future__ import annotations

import contextlib
import hmac
import json
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final, final
from urllib.parse import parse_qsl, urlsplit

from wsnsim.base.errors import UsageError

HOST: Final = "127.0.0.1"
MOST_REQUESTS: Final = 32
"""Requests that are answered at a time; further ones are closed at once."""
IDLE: Final = 20.0
"""Seconds after which a connection that sends or takes nothing is closed."""
POLICY: Final = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
COMMON: Final = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


@dataclass(frozen=True)
class HttpAnswer:
    """What is sent: bytes, their type, and a page's Content-Security-Policy."""

    body: bytes
    kind: str = "text/html; charset=utf-8"
    policy: str = POLICY
    status: HTTPStatus = field(default=HTTPStatus.OK)

    @classmethod
    def json(cls, value: Any) -> HttpAnswer:
        """A JSON value."""
        return cls(json.dumps(value, ensure_ascii=False, allow_nan=False).encode(), "application/json")


Answers = Callable[[str, Mapping[str, str]], HttpAnswer | None]
"""Gives the answer to a name below the token and its parameters, None if there is none."""


@final
class WatchServer:
    """The server, which answers in threads of its own until it is closed.

    Args:
        answers: what is answered.
        port: port of the loopback interface; 0 chooses a free one.

    Raises:
        UsageError: the port is taken or not allowed.
    """

    def __init__(self, answers: Answers, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(24)
        try:
            self._server = _Server((HOST, port), _Handler)
        except OSError as error:
            raise UsageError(f"--port {port}: cannot be used: {error.strerror or error}") from None
        self.port = int(self._server.server_address[1])
        self._server.gate = _Gate(self._token, self.port, answers)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="watch", daemon=True)

    @property
    def url(self) -> str:
        """The address with its token."""
        return f"http://{HOST}:{self.port}/{self._token}/"

    def __enter__(self) -> WatchServer:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@dataclass(frozen=True)
class _Gate:
    """Decides what is answered."""

    token: str
    port: int
    answers: Answers

    def answer(self, target: str, headers: Mapping[str, str]) -> HttpAnswer:
        if not self._is_own(headers):
            return _refusal(HTTPStatus.FORBIDDEN)
        address = urlsplit(target)
        token, slash, name = address.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.token.encode()) or not slash:
            return _refusal(HTTPStatus.NOT_FOUND)
        found = self.answers(name, dict(parse_qsl(address.query, max_num_fields=10)))
        return found or _refusal(HTTPStatus.NOT_FOUND)

    def _is_own(self, headers: Mapping[str, str]) -> bool:
        """Whether the request names this server as its host, and no page of another site has made it."""
        hosts = [f"{name}:{self.port}" for name in (HOST, "localhost")]
        origins = [None, *(f"http://{host}" for host in hosts)]
        is_ours = headers.get("Host") in hosts and headers.get("Origin") in origins
        return is_ours and headers.get("Sec-Fetch-Site", "none") in ("same-origin", "none")


def _refusal(status: HTTPStatus) -> HttpAnswer:
    return HttpAnswer(f"{status.value} {status.phrase}\n".encode(), "text/plain; charset=utf-8", status=status)


class _Server(ThreadingHTTPServer):
    """The sockets, with a limited number of threads."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 2 * MOST_REQUESTS
    gate: _Gate

    def __init__(self, *where: Any) -> None:
        super().__init__(*where)
        self._free = threading.BoundedSemaphore(MOST_REQUESTS)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Drop the connection: a tab that goes away concerns nobody."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version = "wsnsim"
    sys_version = ""
    timeout = IDLE

    def do_GET(self) -> None:
        try:
            answer = self.server.gate.answer(self.path, dict(self.headers.items()))
        except ValueError:  # an address that is none
            answer = _refusal(HTTPStatus.BAD_REQUEST)
        with contextlib.suppress(OSError):  # the tab was closed
            self._send(answer)

    def _send(self, answer: HttpAnswer) -> None:
        self.send_response(answer.status)
        for name, value in COMMON.items():
            self.send_header(name, value)
        self.send_header("Content-Security-Policy", answer.policy)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.body)))
        self.end_headers()
        self.wfile.write(answer.body)

    def log_message(self, format: str, *values: Any) -> None:
        """Print nothing."""
