"""Requests to a server of this machine, byte by byte where a library would correct them."""

from __future__ import annotations

import http.client
from urllib.parse import urlsplit

import pytest


@pytest.fixture
def ask():
    """(status, headers, body) of a request to an address."""

    def asked(url, name="", method="GET", **headers):
        parts = urlsplit(url)
        connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
        try:
            connection.request(method, parts.path + name, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    return asked
