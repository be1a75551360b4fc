"""The commands of scenarios, studies and results: check, list, info, new, schema, trace, diff, verify and recover."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import keyword
from dataclasses import asdict
from pathlib import Path
from typing import Final

import click

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.cli import shared
from wsnsim.cli.shared import PATH, echo, echo_answer, echo_json_text, group, reading


@group.command()
@click.argument("sources", metavar="SCENARIO...", nargs=-1, required=True)
@shared.overrides_option
@shared.plugins_option
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.1),
    default=20.0,
    show_default=True,
    metavar="SECONDS",
    help="Time limit of a scenario's plug-ins, which run in a process of their own.",
)
@shared.quiet_option
def check(sources: tuple[str, ...], overrides: tuple[str, ...], plugins: bool, timeout: float, quiet: bool) -> int:
    """Check scenarios without running them, and report every error.

    Notes name values that are allowed but probably not intended.
    """
    from wsnsim.cli import checking

    code = 0
    for source in sources:
        found = checking.check((source, overrides, plugins), timeout)
        for line in found.errors:
            echo(line, err=True)
        for line in found.lines:
            echo(line)
        code = max(code, found.code)
    return code


@group.command("list")
@click.argument("role", required=False)
@shared.json_option
def list_(role: str | None, as_json: bool) -> None:
    """List kinds of components, scenarios, sweeps or datasheets.

    ROLE is the role of the kinds (trackers, motions, ...), or `scenarios`, `sweeps` or `datasheets` (of radios and
    processors) for what comes with wsnsim. Without it, the kinds of all roles are listed.
    """
    from wsnsim.cli import listing

    echo_answer(listing.listed(role, as_json))


@group.command()
def schema() -> None:
    """Print the JSON Schema of scenarios, with installed plug-ins."""
    from wsnsim.scenario.parameter_info import json_schema

    echo_json_text(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@group.command()
@shared.result_argument
@shared.plugins_option
@shared.json_option
def verify(result: Path, plugins: bool, as_json: bool) -> int:
    """Run the scenario of a result again and compare all tables.

    The fingerprints and the source text of the scenario are compared, too.
    """
    import wsnsim.verification as verification

    answer = verification.verify(result, plugins)
    echo_answer({key: value for key, value in asdict(answer).items() if key != "text"} if as_json else answer.text)
    return 0 if answer.ok else 1


@group.command()
@shared.result_argument
@click.option("--step", type=click.IntRange(min=0), metavar="K", help="Step; default that of the largest error.")
@click.option(
    "--replicate", type=click.IntRange(min=0), default=0, show_default=True, metavar="R", help="Run to describe."
)
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target to describe; default all.")
@click.option(
    "--limit",
    type=click.IntRange(min=0),
    default=4,
    show_default=True,
    metavar="N",
    help="Number of similar messages that are shown one by one; more are summed up.",
)
@shared.json_option
def trace(result: Path, step: int | None, replicate: int, target: int | None, limit: int, as_json: bool) -> None:
    """Describe one step of a run: measurements, frames and energy.

    The text says who sensed the target, who sent what to whom, what was lost, and what energy was spent.
    """
    from wsnsim.analysis import trace as tracing
    from wsnsim.analysis.plot_data import telling_step
    from wsnsim.recording import attributes

    with reading(result):
        if step is None and not attributes(result)["states"]:
            raise UsageError(f"{result} has no target, and no largest error: give --step K")
        step = telling_step(result, replicate, target or 0) if step is None else step
        picked = tracing.trace(result, step, replicate, target, limit)
        answer = tracing.as_json(picked) if as_json else tracing.text(picked)
    echo_answer(answer)


@group.command()
@click.argument("a", metavar="A", type=PATH)
@click.argument("b", metavar="B", type=PATH)
@shared.json_option
def diff(a: Path, b: Path, as_json: bool) -> int:
    """Find the first difference between two results.

    The exit code is 1 if they differ, and 2 if one of them cannot be read.
    """
    from wsnsim.analysis import difference

    try:
        with reading(a, b):
            found = difference.differ(a, b)
    except ResultError as error:
        raise UsageError(str(error)) from error
    echo_answer(difference.as_json(found) if as_json else difference.text(found))
    return 0 if found.same else 1


@group.command()
@click.argument("unfinished", metavar="X.tmp", type=PATH)
@click.option("--out", "-o", type=PATH, metavar="FILE.h5", help="Result file; default the name that the run had.")
def recover(unfinished: Path, out: Path | None) -> None:
    """Recover the rows in the temporary file of a killed run."""
    import wsnsim.recording as recording

    echo(f"{recording.recover(unfinished, out)}: recovered, with the status partial")


@group.command()
@click.argument("words", metavar="[ROLE] KIND|FILE|NAME", nargs=-1)
@click.option(
    "--cite", is_flag=True, help="Print what to cite, as BibTeX: wsnsim and the papers of the methods that FILE uses."
)
@shared.plugins_option
@shared.json_option
def info(words: tuple[str, ...], cite: bool, plugins: bool, as_json: bool) -> None:
    """Describe a kind: method, parameters, sources and an example.

    KIND is a name of `wsnsim list` (coordinated_turn, motion.coordinated_turn) or a plug-in (mylab.trackers:Mine).
    Other things can be described, too. FILE is a result, the folder of a campaign, or a scenario, whose radio is
    described. NAME is a datasheet (`wsnsim list datasheets`), a table or a column of results (estimates, rmse), or a
    parameter (reach).
    """
    if not 1 <= len(words) <= 2:
        raise UsageError(f"expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf), got {len(words)} words")
    if not all(word.strip() for word in words):
        raise UsageError("the name is empty: expected KIND, ROLE KIND, FILE or NAME (such as: wsnsim info ekf)")
    if cite and (as_json or len(words) > 1):
        raise UsageError("--cite takes one result, campaign or scenario, and cannot be combined with --json")
    from wsnsim.cli import describe

    echo_answer(describe.citing(words[0]) if cite else describe.answer(words, plugins, as_json))


PLUGIN_ROLES: Final = ("tracker", "sensor", "motion", "mac")
"""The roles for which there is a plug-in to start from."""
STUDY: Final = "study"


@group.command()
@click.argument("name")
@click.option("--bench", is_flag=True, help="Write a scenario of a standalone filter, without a network.")
@click.option("--like", metavar="SCENARIO", help="Start from this scenario, whose values are listed to be changed.")
@click.option("--for", "role", type=click.Choice((*PLUGIN_ROLES, STUDY)),
              help="Also write a plug-in of this role, NAME.py; or a study, the folder NAME.")  # fmt: skip
def new(name: str, bench: bool, like: str | None, role: str | None) -> None:
    """Write a commented scenario; with --for, a plug-in or a study.

    All are starting points. The scenario is NAME.yaml; the plug-in is NAME.py, and the scenario uses it. A study is a
    folder with study.yaml (experiments, hypotheses, thresholds) and study.py (measures, figures).
    """
    from wsnsim.scenario.load import text_like
    from wsnsim.scenario.schema import unsafe_name
    from wsnsim.scenario.texts import template

    stem = name.removesuffix(".yaml").removesuffix(".py" if role else ".yaml")
    if reason := unsafe_name(stem, "a file"):
        raise UsageError(f"'{name}' {reason}, such as {shared.file_name(stem) or 'mine'}")
    if role is None:
        if bench and like is not None:
            raise UsageError("--bench cannot be combined with --like")
        _write({Path(f"{stem}.yaml"): template(stem, bench) if like is None else text_like(like, stem)})
        echo(f"{stem}.yaml: written; run it with: wsnsim run {stem}.yaml")
        return
    if bench or like is not None:
        raise UsageError(f"{'--bench' if bench else '--like'} cannot be combined with --for")
    if role == STUDY:
        _write_study(stem)
        return
    if reason := _no_module(stem):
        raise UsageError(f"'{stem}' {reason}")
    module, scenario = (_starter(role, suffix, stem) for suffix in ("py", "yaml"))
    _write({Path(f"{stem}.py"): module, Path(f"{stem}.yaml"): scenario})
    echo(f"{stem}.py and {stem}.yaml: written")
    echo(f"check its rules:  python {stem}.py")
    echo(f"run it:           wsnsim run {stem}.yaml")


def _write_study(name: str) -> None:
    """Write the folder of a study, with its two files."""
    from wsnsim.scenario.texts import shipped_studies

    folder = Path(name)
    if name in shipped_studies():
        raise UsageError(f"'{name}' is the name of a study that comes with wsnsim: choose another name")
    _demand_new(folder)
    _write({folder / f"{STUDY}.{suffix}": _starter(STUDY, suffix, name) for suffix in ("yaml", "py")})
    echo(f"{name}/{STUDY}.yaml and {name}/{STUDY}.py: written")
    echo(f"run it: wsnsim reproduce {name}")


def _no_module(name: str) -> str:
    """Return why a name cannot be that of a plug-in's module; '' if it can."""
    if not name.isidentifier() or keyword.iskeyword(name):
        return "cannot name a module of Python: use letters, digits and '_'"
    if Path(f"{name}.py").exists():
        return ""  # which is reported when the file is written
    if importlib.util.find_spec(name) is not None:
        return "is the name of an installed module, which Python would import instead: choose another name"
    return ""


def _starter(role: str, suffix: str, name: str) -> str:
    """Return the text of a plug-in's module ('py') or scenario ('yaml'), with the names that the user chose."""
    text = (Path(__file__).parent / "starters" / f"{role}.{suffix}").read_text(encoding="utf-8")
    return text.replace(f"Plugin{role.capitalize()}", class_name(name)).replace("plugin_name", name)


def class_name(name: str) -> str:
    """Return the name of a plug-in's class: 'NearestNode' for 'nearest_node'."""
    found = "".join(piece[:1].upper() + piece[1:] for piece in name.split("_"))
    return found if found.isidentifier() else f"Plugin{found}"


def _demand_new(path: Path) -> None:
    if path.exists() or path.is_symlink():
        raise UsageError(f"{path} exists already: choose another name, or remove it")


def _write(texts: dict[Path, str]) -> None:
    """Write files that do not exist, in a folder that may be new; none of them if one cannot be written."""
    for path in texts:
        _demand_new(path)
    undo = contextlib.ExitStack()
    try:
        for path, text in texts.items():
            if not path.parent.exists():
                path.parent.mkdir()
                undo.callback(path.parent.rmdir)
            with path.open("x", encoding="utf-8") as file:
                undo.callback(path.unlink, missing_ok=True)
                file.write(text)
    except OSError as error:
        undo.close()
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
