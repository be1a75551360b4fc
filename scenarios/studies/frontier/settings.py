"""The settings at which the strategies of the frontier run: a sweep on seeds of its own, and a rule that chooses.

    swept(sweep, radio) -> {variant: strategy}       every setting of a sweep
    chosen(results) -> Choice                        of one strategy, by the rule
    stored() -> {radio: StoredSweep}                 what a sweep found, as it comes with wsnsim

The rule [our choice]. A setting counts if at least 90 % of its steps have an estimate in time; if none does, only the
one with the greatest share counts. Of these, only those count in which the fewest runs lose the target or have an RMSE
above 20 m. `fair` is the one with the least median RMSE. `frugal` is the one with the least energy among those whose
median RMSE is at most 1.5 times that of `fair`, if it saves at least a tenth of the energy of `fair`; otherwise it is
`fair`.

'RADIO: STRATEGY, fair' is a variant of the frontier if the fair setting is not the default one, 'RADIO: STRATEGY,
frugal' if the frugal one is neither. On a network that sleeps, 'fair' is the setting that the sweep has chosen for the
radio, nodes awake.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.papers.toolkit import Data, Study, code_id

from .strategies import LEAST_IN_TIME, Strategy, strategies

STORED: Final = Path(__file__).parent / "settings.json"
SWEPT_RADIOS: Final = {"ideal": "ideal", "realistic": "slots"}
"""{panel of the frontier: radio on which its settings are swept}; a radio is the first word of its variants."""
NEAR_FAIR: Final = 1.5
"""Median RMSE of the frugal setting over that of the fair one, at most."""
SAVED: Final = 0.9
"""Energy of the frugal setting over that of the fair one, at most."""
FAIR: Final = "fair"
CHOSEN: Final = (FAIR, "frugal")
"""The last words of the variants whose settings a sweep has chosen."""


class Choice(NamedTuple):
    """The names of the settings of a strategy that the rule chooses."""

    fair: str
    frugal: str


class StoredSweep(NamedTuple):
    """The results of a sweep on one radio.

    Attributes:
        about: seed, runs and duration (s) of the sweep, the digest of its runs' fingerprints, and the digests of the
            code that made them, in their order: a change was accepted where it left the points that were there as
            they were. `commits` are those of the code, if they were named. `added` has the same of strategies that
            were swept later.
        results: of every setting, in the order of the sweep.
        choices: {strategy: Choice}
    """

    about: Mapping[str, Any]
    results: tuple[Strategy, ...]
    choices: Mapping[str, Choice]


def swept(sweep: Mapping[str, Any], radio: str) -> dict[str, str]:
    """{variant: strategy} of every setting of a sweep on one radio.

    Process noise is crossed with handover and handover fraction at the number of particles `base`, and with all other
    numbers of particles at the last handover and the first fraction.
    """
    found: dict[str, str] = {}
    for group in sweep[radio]:
        for strategy in group["strategies"]:
            found |= dict.fromkeys(_settings(f"{radio}: {strategy}", {**sweep["usual"], **group}), strategy)
    return found


def _settings(name: str, factors: Mapping[str, Any]) -> Iterator[str]:
    crossed = [
        *product(factors["noise"], [factors["base"]], factors["handover"], factors["fraction"]),
        *product(factors["noise"], factors["particles"], factors["handover"][-1:], factors["fraction"][:1]),
    ]
    return (", ".join(filter(None, (name, *words))) for words in crossed)


def chosen(found: Sequence[Strategy]) -> Choice:
    """The settings of one strategy that the rule chooses from the results of all of its settings."""
    most = max(one.in_time for one in found)
    timely = [one for one in found if one.in_time >= min(most, LEAST_IN_TIME)]
    fewest = min(one.lost for one in timely)
    left = [one for one in timely if one.lost <= fewest]
    fair = min(left, key=lambda one: one.rmse if math.isfinite(one.rmse) else math.inf)
    near = [one for one in left if one.rmse <= NEAR_FAIR * fair.rmse]
    frugal = min(near, key=lambda one: one.energy, default=fair)
    return Choice(fair.variant, frugal.variant if frugal.energy <= SAVED * fair.energy else fair.variant)


def choices(found: Sequence[Strategy], of: Mapping[str, str]) -> dict[str, Choice]:
    """{strategy: Choice} from the results of all settings and {variant: strategy}."""
    names = dict.fromkeys(of[one.variant] for one in found)
    return {name: chosen([one for one in found if of[one.variant] == name]) for name in names}


def sweep_of(data: Data, commits: Sequence[str] = ()) -> StoredSweep:
    """What a campaign of the experiment `settings_RADIO` found, with code of these commits."""
    found = tuple(strategies(data))
    radio, scenario = found[0].air, data.scenario(data.variants[0])
    about = {
        "seed": scenario["seed"],
        "runs": data.manifest.points[0].replicates,
        "duration": scenario["duration"],
        "digest": _digest(data),
        "code": _versions(data.manifest),
        "commits": list(commits),
    }
    return StoredSweep(about, found, choices(found, swept(data.published["sweep"], radio)))


def merged(before: StoredSweep, new: StoredSweep, sweep: Mapping[str, Any]) -> StoredSweep:
    """A stored sweep with strategies that were swept later, in the order of the sweep; `about` notes what was added."""
    results = {one.variant: one for one in (*before.results, *new.results)}
    of = swept(sweep, new.results[0].air)
    rows = tuple(results[name] for name in of if name in results)
    again = set(before.choices) & set(new.choices)
    assert not again, f"swept a second time: {', '.join(sorted(again))}"
    added = {"strategies": [*new.choices], **new.about}
    about = {**before.about, "added": [*before.about.get("added", ()), added]}
    return StoredSweep(about, rows, choices(rows, of))


def _digest(data: Data) -> str:
    """SHA-256 of the fingerprints of all runs, in the order of the sweep."""
    fingerprints = [data.of(variant, "runs").sort_values("replicate")["fingerprint"] for variant in data.variants]
    return hashlib.sha256("\n".join(str(one) for column in fingerprints for one in column).encode()).hexdigest()


def _versions(manifest: Any) -> list[str]:
    """The digests of the code that made the runs, in their order."""
    changes = manifest.code_changes
    return (
        [*(str(one["before"]) for one in changes), str(changes[-1]["after"])] if changes else [code_id(manifest.code)]
    )


@functools.cache
def stored(path: Path = STORED) -> dict[str, StoredSweep]:
    """The stored sweeps by radio."""
    return {
        radio: StoredSweep(
            one["about"],
            tuple(Strategy(*row) for row in one["results"]),
            {name: Choice(*pair) for name, pair in one["choices"].items()},
        )
        for radio, one in json.loads(path.read_text(encoding="utf-8")).items()
    }


def store(found: Mapping[str, StoredSweep], path: Path = STORED) -> None:
    """Write sweeps for `stored`."""
    rows = [f" {json.dumps(radio)}: {_as_text(one)}" for radio, one in found.items()]
    path.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
    stored.cache_clear()


def _as_text(one: StoredSweep) -> str:
    """A sweep as JSON, a line per result; errors and energies with six digits."""
    results = ",\n".join(f"   {json.dumps([row.variant, *map(_short, row[1:])])}" for row in one.results)
    picked = ",\n".join(f"   {json.dumps(name)}: {json.dumps(list(pair))}" for name, pair in one.choices.items())
    about = json.dumps(dict(one.about))
    return f'{{\n  "about": {about},\n  "results": [\n{results}\n  ],\n  "choices": {{\n{picked}\n  }}\n }}'


def _short(number: float) -> float:
    return float(f"{number:.6g}")


def lines(data: Data) -> list[str]:
    """A line per strategy of a sweep: its choice, and whether the frontier has the same."""
    found = sweep_of(data)
    radio = found.results[0].air
    before = stored()[radio].choices if radio in stored() else {}
    return [
        f"{radio}: {name}: {_words(pair, f'{radio}: {name}')}" + ("" if before.get(name) == pair else
        f"; the frontier has {_words(before[name], f'{radio}: {name}') if name in before else 'none'}")
        for name, pair in found.choices.items()
    ]  # fmt: skip


def _words(choice: Choice, strategy: str) -> str:
    fair, frugal = (name.removeprefix(strategy).removeprefix(", ") or "the defaults" for name in choice)
    return f"fair is {fair}" + (f"; frugal is {frugal}" if frugal != fair else "")


def variants(study: Study, radio: str) -> dict[str, Any]:
    """{variant: scenario and settings} of every setting of a sweep on one radio, as an experiment has them."""
    sweep = study.published["sweep"]
    found = {}
    for name, strategy in swept(sweep, radio).items():
        usual = f"{radio}: {strategy}"
        words = name.removeprefix(usual).split(", ")[1:]
        found[name] = [*sweep["scenarios"][usual], *(sweep["words"][word] for word in words)]
    return {"variants": found}


def twin(variant: str) -> str:
    """The variant without its last word."""
    return variant.rpartition(", ")[0]
