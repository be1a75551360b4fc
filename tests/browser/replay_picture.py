"""Takes the picture of a replay that the README and the documentation show.

python -m tests.browser.replay_picture     runs pso_mhpf and writes docs/replay.png
"""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path

import wsnsim
from tests.browser.chromium import Browser

PICTURE = Path(__file__).parents[2] / "docs" / "replay.png"
STEP, WIDTH, MARGIN = 320, 1100, 12
REPLAY = """(() => { const section = document.getElementById('drawing').closest('section');
    const box = section.getBoundingClientRect();
    const end = section.querySelector('input[type=range]').getBoundingClientRect();
    return [box.x + scrollX, box.y + scrollY, box.width, end.bottom - box.y]; })()"""
"""The box from the heading of the replay to its slider."""


def main() -> None:
    """Run the scenario, open its page at a step, and write the part that holds the replay."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "pso_mhpf.html")
        wsnsim.simulate("pso_mhpf").report(page)
        browser = Browser()
        try:
            browser.open(f"{page.as_uri()}#frame={STEP}", width=WIDTH, height=1000, reduced=True)
            x, y, width, height = browser.value(REPLAY)
            clip = {
                "x": x - MARGIN, "y": y - MARGIN, "width": width + 2 * MARGIN, "height": height + 2 * MARGIN,
                "scale": 1,
            }  # fmt: skip
            taken = browser.order("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        finally:
            browser.close()
    PICTURE.write_bytes(base64.b64decode(taken["data"]))
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
