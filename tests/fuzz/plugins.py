"""Trackers of somebody else's, most of them with a fault."""

from __future__ import annotations

import random
from typing import Final

RIGHT: Final = '''\
"""A tracker that predicts."""
import numpy as np
from wsnsim import Compute, part


@part
class Theirs:
    """Predicts."""

    def start(self, prior, scene):
        yield from ()
        return prior

    def step(self, belief, scene):
        yield Compute(10.0)
        return belief

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return belief.mean[[0, 2]]

    def hand_over(self, belief, scene, successor):
        yield from ()
        return belief

    def particles(self, belief, members):
        return iter(())

    member_cycles = 0.0
'''
WRONG: Final = (
    ("import numpy as np", "import numpy as np\nraise RuntimeError('no \\x1b[31m luck')"),
    ("import numpy as np", "import no_such_package_of_theirs"),
    ("import numpy as np", "import numpy as np\nraise SystemExit(0)"),
    ("import numpy as np", "import numpy as np\n)"),
    ("@part\n", ""),
    ("class Theirs:", "class Others:"),
    ("class Theirs:", "def Theirs():"),
    ("def step(self, belief, scene):", "def step(self):"),
    ("def step(self, belief, scene):", "def steps(self, belief, scene):"),
    ("def start(self, prior, scene):", "def start(self, prior, scene, more):"),
    ("yield Compute(10.0)", "yield None"),
    ("yield Compute(10.0)", "yield 'a request'"),
    ("yield Compute(10.0)", "yield Compute('many')"),
    ("yield Compute(10.0)", "yield Compute(float('nan'))"),
    ("yield Compute(10.0)", "yield Compute(-1.0)"),
    ("yield Compute(10.0)", "raise KeyError('a key \\x9b of theirs')"),
    ("yield Compute(10.0)", "return 1 / 0"),
    ("yield Compute(10.0)", "raise SystemExit(7)"),
    ("yield Compute(10.0)", "raise StopIteration"),
    ("yield Compute(10.0)", "raise Exception"),
    ("yield Compute(10.0)", "raise ValueError('many\\nlines\\n' * 50)"),
    ("yield Compute(10.0)", "yield Compute(10.0); belief.mean[:] = np.nan"),
    ("return belief\n\n    def forecast", "return None\n\n    def forecast"),
    ("return belief\n\n    def forecast", "return np.zeros(3)\n\n    def forecast"),
    ("return belief\n\n    def forecast", "return type(belief)(belief.mean[:2], belief.cov)\n\n    def forecast"),
    ("return belief\n\n    def forecast", "return type(belief)(belief.mean, belief.cov[:1])\n\n    def forecast"),
    ("return belief\n\n    def forecast", "return type(belief)(belief.mean * np.nan, belief.cov)\n\n    def forecast"),
    ("return belief\n\n    def forecast", "return type(belief)(['a'] * 4, belief.cov)\n\n    def forecast"),
    ('    """Predicts."""\n', '    """Predicts."""\n    more: object\n'),
    ('    """Predicts."""\n', '    """Predicts."""\n    more: float\n'),
    ('    """Predicts."""\n', '    """Predicts."""\n    more: "NoSuchType" = 1\n'),
    ('    """Predicts."""\n', '    """Predicts."""\n    kind: str = "x"\n'),
    ("    yield from ()\n        return prior", "    return 1 / 0"),
    ("    yield from ()\n        return prior", "    return prior"),
)  # fmt: skip


def plugin(rng: random.Random) -> str:
    """The text of a module with one fault, seldom with two or none."""
    text = RIGHT
    for _ in range(rng.choice([0, 1, 1, 1, 1, 1, 1, 2])):
        text = text.replace(*rng.choice(WRONG), 1)
    return text
