"""`wsnsim info`: describe a kind, a role, a result, a campaign's folder, a datasheet or a scenario's radio."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.cli.shared import echo, echo_answer, group, is_campaign, json_option, plugins_option, reading


@group.command()
@click.argument("words", metavar="[ROLE] KIND|FILE|NAME", nargs=-1)
@plugins_option
@json_option
def info(words: tuple[str, ...], plugins: bool, as_json: bool) -> None:
    """Describe a kind: method, parameters, sources and an example.

    KIND is a name of `wsnsim list` (coordinated_turn, motion.coordinated_turn) or a plug-in (mylab.trackers:Mine).
    Other things can be described, too. FILE is a result, the folder of a campaign, or a scenario, whose radio is
    described. NAME is a datasheet (`wsnsim list parts`), a table or a column of results (estimates, rmse), or a
    parameter (reach).
    """
    if not 1 <= len(words) <= 2:
        raise UsageError(f"expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf), got {len(words)} words")
    if not all(word.strip() for word in words):
        raise UsageError("the name is empty: expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf)")
    if len(words) == 2 and words[0] not in ("scenario", "part"):
        _kinds(words, as_json)
    else:
        _what(words[-1], plugins, as_json, only_files=len(words) == 2)


def _what(word: str, plugins: bool, as_json: bool, only_files: bool) -> None:
    from wsnsim.scenario.files import is_result

    if is_campaign(word):
        from wsnsim.analysis import campaign_info

        echo_answer(campaign_info.info(word) if as_json else campaign_info.info_text(word))
    elif word.endswith(".h5") or is_result(word):
        from wsnsim.analysis import result_info

        with reading(Path(word)):
            path = Path(word)
            answer = result_info.info(path, plugins) if as_json else result_info.info_text(path, plugins)
        echo_answer(answer)
    elif only_files or not _kinds((word,), as_json):
        _file(word, plugins, as_json, only_files)


def _kinds(words: tuple[str, ...], as_json: bool) -> bool:
    """Describe the kinds or the role that words name; False if there are none."""
    if _is_path(words[-1]):
        return False
    from wsnsim.cli import component_info, kind_text

    if len(words) == 1 and kind_text.is_role(words[0]):
        echo_answer(kind_text.role_text(words[0], as_json))
        return True
    found = kind_text.described(words)
    if not found:
        return False
    other = len(words) == 1 and component_info.is_described(words[0])
    if as_json:
        more = component_info.describe(words[0]).as_json() if other else {}
        echo_answer({"kinds": [kind.as_json() for kind in found]} | more)
        return True
    echo(kind_text.kinds_text(found))
    if other:
        what = component_info.what_it_is(words[0])
        echo(f"\nThere is also a {what} of this name: wsnsim info {what} {words[0]}")
    return True


def _is_path(word: str) -> bool:
    return "/" in word or word.endswith((".yaml", ".yml"))


def _file(word: str, plugins: bool, as_json: bool, only_files: bool) -> None:
    from wsnsim.cli import component_info, kind_text, word_info
    from wsnsim.scenario.files import shipped, shipped_parts
    from wsnsim.scenario.registry import ROLES, kinds

    if component_info.is_described(word):
        found = component_info.describe(word, plugins)
        echo_answer(found.as_json() if as_json else found.text())
        return
    if text := "" if _is_path(word) else word_info.word_text(word):
        echo_answer({"word": word, "text": text} if as_json else text)
        return
    names = [kind for role in ROLES for kind in kinds(role)]
    names += [*shipped(), *shipped_parts(), *ROLES, *word_info.words_known()]
    if (known := kind_text.in_known_case(word, [*names, *_longer_names()])) != word:
        _what(known, plugins, as_json, only_files)
        return
    nearest = did_you_mean(Path(word).stem, names, "see `wsnsim list`")
    raise UsageError(f"unknown kind, scenario, datasheet or result '{word[:80]}' ({nearest})")


def _longer_names() -> Iterator[str]:
    """Yield the other names of kinds and roles: 'role.kind', the names of classes, and plurals."""
    from wsnsim.scenario.registry import ROLES, kinds

    for role in ROLES.values():
        yield role.plural
        for row in kinds(role.name).values():
            yield f"{role.name}.{row.kind}"
            yield row.path.rpartition(":")[2]
