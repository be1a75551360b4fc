"""A server on the loopback interface that shows pages to whoever knows its address, and takes nothing.

    with WatchServer(answer, port) as server: print(server.url)
    with page_server(page) as server: print(server.url)      a finished page, such as that of a result

The address holds a random token. What is asked without it, under another host name, or by the page of another site, is
refused. Only GET is answered, from memory: no file is looked up.
"""

from __future__ import annotations

import contextlib
import hmac
import html
import json
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final, Self
from urllib.parse import parse_qsl, urlsplit

from wsnsim.base.errors import UsageError

HOST: Final = "127.0.0.1"
MOST_REQUESTS: Final = 32
"""Connections at a time. A further one ends another: the oldest that has asked nothing valid yet, else the oldest."""
TIME_TO_ASK: Final = 5.0
"""Seconds in which a request must be complete."""
TIME_TO_ANSWER: Final = 60.0
"""Seconds in which a client must have taken the whole answer."""
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


class WatchServer:
    """The server, which answers in threads of its own until it is closed.

    Args:
        answers: what is answered.
        port: port of the loopback interface; 0 chooses a free one.

    Raises:
        UsageError: the port is taken or not allowed.
    """

    def __init__(self, answers: Answers, port: int = 0) -> None:
        self._token, self._answers = secrets.token_urlsafe(24), answers
        try:
            self._server = _Server((HOST, port), _Handler)
        except OSError as error:
            raise UsageError(f"--port {port}: cannot be used: {error.strerror or error}") from None
        self.port = int(self._server.server_address[1])
        self._server.gate = self
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="watch", daemon=True)

    @property
    def url(self) -> str:
        """The address with its token."""
        return f"http://{HOST}:{self.port}/{self._token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def reply(self, target: str, headers: Mapping[str, str]) -> HttpAnswer:
        """What is sent to a request, whose address and headers may be anything."""
        if not self._is_own(headers):
            return _refusal(HTTPStatus.FORBIDDEN)
        address = urlsplit(target)
        token, slash, name = address.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self._token.encode()) or not slash:
            return _refusal(HTTPStatus.NOT_FOUND)
        found = self._answers(name, dict(parse_qsl(address.query, max_num_fields=10)))
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
    """The sockets: a limited number of them, each for a limited time. All clients are of this machine.

    Attributes:
        open: for each connection whether it has asked with the token, and when (s, monotonic) it is closed.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = 2 * MOST_REQUESTS
    gate: WatchServer

    def __init__(self, *where: Any) -> None:
        self.open: dict[Any, tuple[bool, float]] = {}
        self._lock = threading.Lock()
        super().__init__(*where)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            if len(self.open) >= MOST_REQUESTS:
                self._end(min(self.open, key=self.open.__getitem__))
            self.open[request] = (False, time.monotonic() + TIME_TO_ASK)
        super().process_request(request, client_address)

    def has_asked(self, request: Any) -> None:
        """Give a connection that asked with the token the time to take the answer."""
        with self._lock:
            if request in self.open:
                self.open[request] = (True, time.monotonic() + TIME_TO_ANSWER)

    def service_actions(self) -> None:
        """End the connections whose time is over. The server calls it several times a second."""
        now = time.monotonic()
        with self._lock:
            for request in [each for each, (_, end) in self.open.items() if end < now]:
                self._end(request)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self.open.pop(request, None)
        super().shutdown_request(request)

    def _end(self, request: Any) -> None:
        """Wake the thread of a connection, which then finds it closed."""
        del self.open[request]
        with contextlib.suppress(OSError):
            request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Drop the connection: a tab that goes away concerns nobody."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version = "wsnsim"
    sys_version = ""

    def do_GET(self) -> None:
        try:
            answer = self.server.gate.reply(self.path, dict(self.headers.items()))
        except ValueError:  # an address that is none
            answer = _refusal(HTTPStatus.BAD_REQUEST)
        if answer.status == HTTPStatus.OK:
            self.server.has_asked(self.connection)
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


META_POLICY: Final = re.compile(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">')


def answer_with_page(page: str) -> HttpAnswer:
    """The answer that holds a page. The policy that the page states becomes one of the answer."""
    found = META_POLICY.search(page)
    policy = f"{html.unescape(found[1])}; frame-ancestors 'none'" if found else POLICY
    return HttpAnswer(page.encode(), policy=policy)


def page_server(page: str, port: int = 0) -> WatchServer:
    """A server that shows one page, and nothing else.

    Args:
        page: the page as HTML.
        port: port of the loopback interface; 0 chooses a free one.

    Raises:
        UsageError: the port is taken or not allowed.
    """
    answer = answer_with_page(page)
    return WatchServer(lambda name, given: answer if name == "" else None, port)
