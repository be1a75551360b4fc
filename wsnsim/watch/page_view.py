"""A finished page, such as that of a result, served to this machine.

with page_server(page) as server: print(server.url)
"""

from __future__ import annotations

import html
import re
from typing import Final

from wsnsim.watch.server import POLICY, HttpAnswer, WatchServer

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
