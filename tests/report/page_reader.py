"""Readers of a page: its elements, and the header and columns of its replays."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser

import numpy as np

VOID = ("meta", "link", "input", "img", "br", "wbr")
KINDS = {"u1": "u1", "u2": "<u2", "u4": "<u4", "i4": "<i4", "f4": "<f4"}


class PageReader(HTMLParser):
    """The elements and texts of a page; fails if an element is not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.ids = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.ids += [value for name, value in attributes if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        self.texts.append((self.open[-1] if self.open else "", text))


def decoded(text):
    """(header, columns) of a replay, decoded by the description of its format."""
    raw = zlib.decompress(base64.b64decode(text))
    size = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4 : 4 + size])
    columns = {name: np.frombuffer(raw, KINDS[kind], count, 4 + size + offset)
          for name, (kind, offset, count) in header["columns"].items()}  # fmt: skip
    return header, columns


def no_figures(path, replicate, plugins):
    """Stands in for `svg_figures`, which takes time."""
    return [], []


def replays_in(page):
    """The encoded replays of a page."""
    return re.findall(r'<script type="text/plain" class="replay-data"[^>]*>([^<]*)</script>', page)


def rows_at(columns, name, frame):
    """The slice of the rows that belong to a frame."""
    ends = np.cumsum(columns[f"{name}_count"])
    return slice(ends[frame] - columns[f"{name}_count"][frame], ends[frame])
