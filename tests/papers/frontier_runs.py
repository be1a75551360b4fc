"""Runs variants of the frontier study that its page lacks, beside what it has.

python -m tests.papers.frontier_runs EXPERIMENT                 the variants that the page does not have
python -m tests.papers.frontier_runs EXPERIMENT 'VARIANT' ...   these

`wsnsim reproduce frontier --full` runs all variants of an experiment as one campaign. Where a variant was added to an
experiment whose rows are in docs/frontier.json, this runs the new one alone, in a folder of its own, resumably;
`python -m tests.papers.frontier_page --new` then merges its rows.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tests.papers.studies import module
from wsnsim.campaign import CampaignProgress
from wsnsim.papers import reproduce
from wsnsim.papers.reproduction import Experiment
from wsnsim.papers.study import study

_settings = module("frontier", "settings")
stored = _settings.stored

HOME = Path(__file__).parents[2]
ROWS = HOME / "docs/frontier.json"
ADDED = HOME / "results/reproduce/added"
"""The campaigns of variants that were added: ADDED/frontier/EXPERIMENT."""


def experiment_of(name: str) -> Experiment:
    """The experiment of a name."""
    return next(one for one in study("frontier").experiments if one.name == name)


def shown(name: str) -> set[str]:
    """The variants of an experiment that docs/frontier.json, or a stored sweep, has."""
    if name.startswith("settings_"):
        sweep = stored().get(name.removeprefix("settings_"))
        return {one.variant for one in sweep.results} if sweep else set()
    part = json.loads(ROWS.read_text(encoding="utf-8")).get(name, {})
    return set(part.get("rows", ())) | {one["variant"] for one in part.get("strategies", ())}


def missing(name: str) -> list[str]:
    """The variants of an experiment that have not been run."""
    return [one for one in experiment_of(name).variants if one not in shown(name)]


def of_variants(name: str, variants: Sequence[str]) -> Experiment:
    """An experiment with these of its variants alone, without claims and figures."""
    whole = experiment_of(name)
    return replace(whole, variants={one: whole.variants[one] for one in variants}, claims=(), figures=(), summary="")


def main() -> None:
    """Run the variants that are named, or those that are missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("experiment")
    parser.add_argument("variants", nargs="*")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    variants = given.variants or missing(given.experiment)
    if not variants:
        print("no variant is missing")
        return
    small = of_variants(given.experiment, variants)
    done: set[int] = set()

    def watch(now: CampaignProgress) -> None:
        if now.done not in done:
            print(f"{now.done} of {now.total} runs, {now.failed} failed, {now.wall:.0f} s", flush=True)
        done.add(now.done)

    outcome = reproduce.resume(reproduce.begin("frontier", small, ADDED, full=True), given.jobs, watch=watch)
    print("complete" if outcome.complete else outcome)


if __name__ == "__main__":
    main()
