"""Expand the templates of a paper's file to experiments: replace variables, tables and words by their values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import ScenarioError, did_you_mean
from wsnsim.papers.document import ClaimTemplate, ExperimentTemplate, PaperDocument
from wsnsim.papers.reproduction import BASES, Claim, Experiment, Variant
from wsnsim.scenario.documents import Document
from wsnsim.scenario.located_values import Keys

NAME: Final = re.compile(r"<(\w+)>")
BETWEEN_WORDS: Final = re.compile(r", |: ")
LESS_THAN: Final = " < "
STRUCTURE: Final = ("each", "claims", "use")


class UnknownName(Exception):
    """A text of a template names something that the file does not have. The argument is the message."""


class PlacedClaim(NamedTuple):
    """A claim and the path of its template in the file."""

    claim: Claim
    path: Keys


@dataclass(frozen=True)
class TemplateScope:
    """The values of `<name>`, and the keys that select an entry of a table: the first key that the table has."""

    names: Mapping[str, Any]
    keys: tuple[str, ...] = ()

    def value(self, template: Any) -> Any:
        """A template with every name and table replaced by its value; None where a table has no entry."""
        if isinstance(template, str):
            whole = NAME.fullmatch(template)
            return self._named(whole[1]) if whole else NAME.sub(lambda name: str(self._named(name[1])), template)
        if isinstance(template, Mapping):
            found = next((key for key in (*self.keys, "else") if key in template), None)
            return None if found is None else self.value(template[found])
        return [self.value(item) for item in template] if isinstance(template, list) else template

    def _named(self, name: str) -> Any:
        if name not in self.names:
            raise UnknownName(f"'<{name}>' is not defined ({did_you_mean(name, self.names)})")
        return self.value(self.names[name])

    def each(self, variables: Mapping[str, Any]) -> Iterator[TemplateScope]:
        """A scope for every combination of the variables' values; 'a, b' are variables whose values come in pairs."""
        if not variables:
            yield self
            return
        (names, values), *rest = variables.items()
        for value in self.value(values):
            pairs = dict(zip(names.split(", "), value if ", " in names else [value], strict=True))
            inner = TemplateScope({**self.names, **pairs}, (*map(str, pairs.values()), *self.keys))
            yield from inner.each(dict(rest))


def experiment_of(document: Document[PaperDocument], index: int) -> tuple[Experiment, list[PlacedClaim]]:
    """An experiment of a paper, and its claims with the paths of their templates.

    Raises:
        ScenarioError: a text names something that the file does not have.
    """
    content = document.content
    own = content.experiments[index]
    path: Keys = ("experiments", index)
    given = own.model_dump(exclude_unset=True)
    if own.like is not None:
        others = {each.name: each for each in content.experiments}
        if own.like not in others:
            raise _error(
                document, (*path, "like"), f"unknown experiment '{own.like}', {did_you_mean(own.like, others)}"
            )
        given = others[own.like].model_dump(exclude_unset=True) | given
        # the path of the claims' templates: those of the other experiment if this one has none
        path = path if "claims" in own.model_fields_set else ("experiments", [*others].index(own.like))
    whole = ExperimentTemplate(**given)
    scope = TemplateScope({**content.published, **content.texts, "experiment": whole.name}, (whole.name,))
    try:
        words = {word: scope.value(text) for word, text in (content.words | (whole.words or {})).items()}
        also = whole.also or {}
        variants = {name: _variant(name, words, also.get(name, ())) for name in _names(scope.value([*whole.variants]))}
    except UnknownName as unknown:
        raise _error(document, (*path, "variants"), str(unknown)) from None
    scope = TemplateScope({**scope.names, "variants": list(variants)}, scope.keys)
    runs = content.published_runs if whole.published_runs is None else whole.published_runs
    defaults = {"basis": whole.basis, "published_runs": runs}
    parser = _ClaimParser(document, words, whole.repairs, defaults, whole.bases or {})
    placed = [*parser.expand(whole.claims, (*path, "claims"), {}, scope)]
    assert whole.runs is not None, f"{whole.name} has no runs"
    settings = whole.model_dump(include={"name", "title", "record", "sets", "quick_sets", "summary", "literal"})
    claims = tuple(each.claim for each in placed)
    experiment = Experiment(variants=variants, claims=claims, figures=whole.figures, **settings, **vars(whole.runs))
    return experiment, placed


def _error(document: Document[PaperDocument], path: Keys, message: str) -> ScenarioError:
    return ScenarioError([document.issue(path, message)])


def _names(given: Any) -> list[str]:
    """The names of variants that a template lists; a list within it gives all combinations of its words."""
    if not isinstance(given, list):
        return [str(given)]
    return [
        name
        for item in given
        for name in (
            [", ".join(words) for words in product(*(_names(part) for part in item))]
            if isinstance(item, list)
            else [str(item)]
        )
    ]


def _words_in(name: str, words: Mapping[str, Any]) -> list[str]:
    """The words of a variant's name, each as long as possible. Raises UnknownName."""
    starts = [0, *(mark.end() for mark in BETWEEN_WORDS.finditer(name))]
    ends = [*(mark.start() for mark in BETWEEN_WORDS.finditer(name)), len(name)]
    found, at = [], 0
    while at < len(starts):
        last = next((i for i in reversed(range(at, len(ends))) if name[starts[at] : ends[i]] in words), None)
        if last is None:
            word = name[starts[at] : ends[at]]
            raise UnknownName(f"unknown word '{word}' in the variant '{name}' ({did_you_mean(word, words)})")
        found.append(name[starts[at] : ends[last]])
        at = last + 1
    return found


def _variant(name: str, words: Mapping[str, Any], also: Sequence[str]) -> Variant:
    """The scenario and the settings of a variant: those of its words, then the settings `also`."""
    given = [*(words[word] for word in _words_in(name, words)), list(also)]
    texts = [text for one in given for text in (one if isinstance(one, list) else [one])]
    scenarios = [text for text in texts if "=" not in text]
    if len(scenarios) != 1:
        raise UnknownName(f"the words of the variant '{name}' name {len(scenarios)} scenarios instead of one")
    return Variant(scenarios[0], tuple(text for text in texts if "=" in text))


@dataclass(frozen=True)
class _ClaimParser:
    """Expands the templates of an experiment's claims."""

    document: Document[PaperDocument]
    words: Mapping[str, Any]
    repairs: tuple[str, ...]
    defaults: Mapping[str, Any]
    bases: Mapping[str, str]

    def expand(
        self, templates: Sequence[ClaimTemplate], path: Keys, inherited: Mapping[str, Any], scope: TemplateScope
    ) -> Iterator[PlacedClaim]:
        """The claims that templates stand for, each with its template's path."""
        for index, template in enumerate(templates):
            yield from self._expand_one(template, (*path, index), inherited, scope)

    def _expand_one(
        self, template: ClaimTemplate, path: Keys, inherited: Mapping[str, Any], scope: TemplateScope
    ) -> Iterator[PlacedClaim]:
        own = template.model_dump(exclude_unset=True, exclude=set(STRUCTURE))
        given = {**inherited, **own}
        try:
            for inner in scope.each(template.each or {}):
                if template.use is not None:
                    shared = self.document.content.shared or {}
                    if template.use not in shared:
                        raise UnknownName(
                            f"no shared claims are called '{template.use}' ({did_you_mean(template.use, shared)})"
                        )
                    yield from self.expand(shared[template.use], ("shared", template.use), given, inner)
                elif template.claims is not None:
                    yield from self.expand(template.claims, (*path, "claims"), given, inner)
                else:
                    among = inner.value(given.get("among"))
                    for name in _names(inner.value(given.get("order") or given.get("variant"))):
                        if among is None or name in among:
                            yield PlacedClaim(self._claim(given, name, inner), path)
        except UnknownName as unknown:
            raise _error(self.document, path, str(unknown)) from None

    def _claim(self, given: Mapping[str, Any], name: str, scope: TemplateScope) -> Claim:
        variant, _, other = name.partition(LESS_THAN)
        words = [word for each in filter(None, (variant, other)) for word in _words_in(each, self.words)]
        here = TemplateScope(scope.names, (name, *scope.keys, *(() if other else reversed(words))))
        allowed = {field.name for field in fields(Claim)}
        found = {key: here.value(value) for key, value in given.items() if key in allowed}
        found = {key: value for key, value in found.items() if value is not None}
        if isinstance(published := found.get("published"), list):
            found["published"] = published[0] / published[1]
        found["basis"] = self._basis(found.get("basis"), words)
        found["literal"] = found.get("literal", True) and not set(words) & set(self.repairs)
        return Claim(**{**self.defaults, **found, "variant": variant, "other": other})

    def _basis(self, given: str | None, words: Sequence[str]) -> str:
        """A claim's own basis, or that of the first of its words that has one, or the experiment's."""
        basis = str(given or next((self.bases[word] for word in words if word in self.bases), self.defaults["basis"]))
        if basis not in BASES:
            raise UnknownName(f"basis: '{basis}' ({did_you_mean(basis, BASES)})")
        return basis
