"""The command line of wsnsim with one run of each variant in a quick reproduction, and bounds over a few truths.

few_runs.py reproduce frontier
"""

from __future__ import annotations

import sys
from dataclasses import replace

from wsnsim.cli import main
from wsnsim.papers import measures, reproduce
from wsnsim.papers.reproduction import Experiment

experiments = reproduce.experiments
TRUTHS = 3


def with_few_runs(paper: str) -> tuple[Experiment, ...]:
    """The experiments of a paper with one run of each variant."""
    return tuple(replace(one, quick=1) for one in experiments(paper))


if __name__ == "__main__":
    reproduce.experiments, measures.TRUTHS = with_few_runs, TRUTHS
    sys.exit(main())
