"""The variants of the frontier whose settings a sweep has chosen, and those of the sweeps.

filled(document) -> the document with these texts:

    swept_ideal, swept_slots        every setting of a sweep
    all_ideal, all_realistic        the variants of the frontier on a radio, those with chosen settings last
    with_twin                       every variant of the frontier whose twin is one, too: that without its last word

'RADIO: STRATEGY, fair' is a variant if the fair setting is not the default one, 'RADIO: STRATEGY, frugal' if the frugal
one is neither. On a network that sleeps, 'fair' is the setting that the sweep has chosen for the radio, nodes awake.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from wsnsim.papers.document import PaperDocument
from wsnsim.papers.frontier.settings import SWEPT_RADIOS, StoredSweep, stored, swept
from wsnsim.scenario.documents import Document

FAIR: Final = "fair"
CHOSEN: Final = (FAIR, "frugal")
"""The last words of the variants whose settings a sweep has chosen."""
ASLEEP: Final = ("10 % awake", "2 % awake")
"""Networks that sleep, with the radio `slots`."""
WITH_CHOSEN: Final = ("frontier", "asleep")
"""The experiments that have such variants."""


def filled(
    document: Document[PaperDocument], sweeps: Mapping[str, StoredSweep] | None = None
) -> Document[PaperDocument]:
    """The document with the settings that were stored, or with these."""
    content = document.content
    sweeps = stored() if sweeps is None else sweeps
    texts: dict[str, Any] = {}
    also: dict[str, list[str]] = {}
    for panel, radio in SWEPT_RADIOS.items():
        named = settings_of(sweeps[radio], radio, content.words) if radio in sweeps else {}
        texts |= {
            f"swept_{radio}": [*swept(content.published["sweep"], radio)],
            f"all_{panel}": [*content.texts[panel], *named],
        }
        also |= named
        if radio == "slots":
            also |= {f"{air}: {name.partition(': ')[2]}": sets for air in ASLEEP for name, sets in named.items()}
    names = [name for panel in SWEPT_RADIOS for name in texts[f"all_{panel}"]]
    texts["with_twin"] = [name for name in names if twin(name) in names]
    experiments = [
        each.model_copy(update={"also": {**(each.also or {}), **also}}) if each.name in WITH_CHOSEN else each
        for each in content.experiments
    ]
    new = {"texts": content.texts | texts, "experiments": experiments}
    return replace(document, content=content.model_copy(update=new))


def settings_of(sweep: StoredSweep, radio: str, words: Mapping[str, str | Sequence[str]]) -> dict[str, list[str]]:
    """{variant: settings} of the chosen settings of all strategies; a default setting is a variant already."""
    found: dict[str, list[str]] = {}
    for strategy, choice in sweep.choices.items():
        usual = f"{radio}: {strategy}"
        for word, name in zip(CHOSEN, choice, strict=True):
            if name != usual and (word == FAIR or name != choice.fair):
                texts = [words[each] for each in name.removeprefix(f"{usual}, ").split(", ")]
                found[f"{usual}, {word}"] = [
                    one for text in texts for one in ([text] if isinstance(text, str) else text)
                ]
    return found


def twin(variant: str) -> str:
    """The variant without its last word."""
    return variant.rpartition(", ")[0]
