"""A headless Chromium, controlled through its DevTools pipe with JSON messages that end with a zero byte."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOUND = next(filter(None, map(shutil.which, NAMES)), None)
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--remote-debugging-pipe",
)  # fmt: skip
LAUNCH = (
    "import fcntl, os, sys; r, w = (fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]);"
    "os.dup2(r, 3); os.dup2(w, 4); os.execv(sys.argv[3], sys.argv[3:])"
)
"""Chromium reads commands from file descriptor 3 and answers on 4."""
REPLAY_IS_READY = "document.documentElement?.dataset.ready !== undefined"
LOADED = "document.readyState === 'complete'"


class Browser:
    """A headless Chromium with an empty profile, and one page at a time."""

    def __init__(self) -> None:
        self.profile = tempfile.mkdtemp(prefix="wsnsim-browser-")
        (orders, self.out), (self.inn, answers) = os.pipe(), os.pipe()
        words = [sys.executable, "-c", LAUNCH, str(orders), str(answers), FOUND, *QUIET]
        self.process = subprocess.Popen(
            [*words, f"--user-data-dir={self.profile}"],
            pass_fds=(orders, answers),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(orders)
        os.close(answers)
        self.number, self.rest, self.target, self.session, self.said = 0, b"", None, None, []

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.out)
        os.close(self.inn)
        shutil.rmtree(self.profile, ignore_errors=True)

    def order(self, method, **parameters):
        """Send a command and wait for its result; events of the open page in between are kept in `said`."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session and not method.startswith("Target."):
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            if answer.get("sessionId") == self.session:
                self.said.append(answer)

    def _next(self):
        until = time.monotonic() + 60
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.inn], [], [], max(0.0, until - time.monotonic()))
            assert ready, "the browser does not answer"
            self.rest += os.read(self.inn, 1 << 16) or pytest.fail("the browser has ended")
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, address, width=1200, height=900, reduced=False, ready=REPLAY_IS_READY):
        """Close the page that is open, open a new one and wait until it is ready."""
        before = self.target
        self.target = self.order("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.order("Target.attachToTarget", targetId=self.target, flatten=True)["sessionId"]
        self.said = []
        if before:
            self.order("Target.closeTarget", targetId=before)
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.order(f"{domain}.enable")
        self.order(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
        )
        if reduced:
            feature = {"name": "prefers-reduced-motion", "value": "reduce"}
            self.order("Emulation.setEmulatedMedia", features=[feature])
        self.order("Page.navigate", url=address)
        self.until(ready)
        return self

    def value(self, expression):
        """The value of a JavaScript expression in the page."""
        answer = self.order("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression):
        until = time.monotonic() + 30
        while not self._value_after_navigation(expression):
            assert time.monotonic() < until, f"the page never came to: {expression}"
            time.sleep(0.02)

    def _value_after_navigation(self, expression):
        """The value of an expression; None while the page changes."""
        try:
            return self.value(expression)
        except AssertionError as error:
            if "navigated" in str(error) or "context" in str(error):
                return None
            raise

    def press(self, key):
        text = {"text": key} if len(key) == 1 else {}
        self.order("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.order("Input.dispatchKeyEvent", type="keyUp", key=key)

    def frame(self):
        return int(self.value("document.documentElement.dataset.frame"))

    def complaints(self):
        """The messages in the console."""
        kinds = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        return [said["params"] for said in self.said if said.get("method") in kinds]

    def requests(self):
        """The requests of the page, without itself and embedded data."""
        asked = [
            said["params"]["request"]["url"] for said in self.said if said.get("method") == "Network.requestWillBeSent"
        ]
        return [url for url in asked if not url.startswith(("file://", "data:", "blob:"))] + (
            ["a second file"] if sum(url.startswith("file://") for url in asked) > 1 else []
        )
