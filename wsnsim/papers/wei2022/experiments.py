"""Wei, Guo (2022): what is run for its tables and figures."""

from __future__ import annotations

from typing import Final

from wsnsim.papers.reproduction import Experiment
from wsnsim.papers.wei2022 import growth, line

EXPERIMENTS: Final[tuple[Experiment, ...]] = (*growth.EXPERIMENTS, *line.EXPERIMENTS)
