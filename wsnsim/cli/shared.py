"""What all commands share: the group that they belong to, common options, and how answers are written."""

from __future__ import annotations

import contextlib
import functools
import importlib
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from wsnsim.base.errors import ResultError, UsageError, did_you_mean, printable, printable_json, shortened
from wsnsim.base.files import LARGEST_NAME, LONGEST_ADDITION, is_too_long, why_not_regular
from wsnsim.base.plugin_code import TRACEBACK_HINT, plugin_fault
from wsnsim.base.process import gc_disabled
from wsnsim.base.version import __version__
from wsnsim.cli.interrupts import tell
from wsnsim.cli.progress import MODES

if TYPE_CHECKING:
    from wsnsim.scenario.schema import Scenario

SCHEMA_VERSION: Final = 1
INCOMPLETE: Final = 3
"""Exit code of a campaign with missing runs."""
METRIC: Final = "rmse"
"""The metric that is compared by default."""
PATH: Final = click.Path(path_type=Path)
MAX_NAME_LENGTH: Final = 100
"""Number of characters of a default name, which is also that of a folder."""
PURPOSES: Final = {
    "Start": dict.fromkeys(("list", "info", "new", "check", "schema"), "commands"),
    "Run": {"run": "running", "watch": "running", "lifetime": "lifetime"},
    "Look": {"plot": "exporting", "report": "exporting", "trace": "commands"},
    "Compare and publish": {"compare": "campaigns", "export": "exporting", "reproduce": "reproducing"},
    "Bring data": {"import": "importing", "fit": "fitting"},
    "Trust": dict.fromkeys(("verify", "diff", "recover"), "commands"),
    "Campaigns": dict.fromkeys(("sweep", "collect"), "campaigns"),
}
"""The commands by what they are for, each with the module of this package that adds it when it is imported."""
MODULES: Final = {name: module for commands in PURPOSES.values() for name, module in commands.items()}
Command = TypeVar("Command", bound=Callable[..., Any])


class _CommandGroup(click.Group):
    """A group that imports a command when it is asked for, and suggests the nearest one for an unknown one."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in MODULES:
            importlib.import_module(f"wsnsim.cli.{MODULES[cmd_name]}")
        return super().get_command(ctx, cmd_name)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(MODULES)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for purpose, names in PURPOSES.items():
            with formatter.section(purpose):
                formatter.write_dl(
                    [(f"{name:9}", every_command()[name].get_short_help_str(formatter.width)) for name in names]
                )

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            raise click.UsageError(
                f"unknown command '{args[0]}' ({did_you_mean(args[0], self.list_commands(ctx))})", ctx
            )
        return super().resolve_command(ctx, args)


@click.group(cls=_CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, message="wsnsim %(version)s", help="Show the version.")
def group() -> None:
    """Simulate wireless sensor networks that track moving targets, joule by joule.

    SCENARIO is a YAML file, the name of a shipped scenario (`wsnsim list scenarios`), or a result, whose scenario is
    used.
    """


def every_command() -> Mapping[str, click.Command]:
    """Return all commands by name."""
    for module in MODULES.values():
        importlib.import_module(f"wsnsim.cli.{module}")
    return group.commands


def with_options(*options: Callable[[Any], Any]) -> Callable[[Command], Command]:
    """Return a decorator that adds several options, the first one first in the help."""
    return lambda command: functools.reduce(lambda given, option: option(given), reversed(options), command)


overrides_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Change a value of the scenario: link.reach='80 m'."
)
seed_option = click.option(
    "--seed", type=click.IntRange(min=0), metavar="S", help="Seed from which all random streams are derived."
)
jobs_option = click.option(
    "--jobs", "-j", type=click.IntRange(1, 1024), metavar="N", help="Number of worker processes; default all cores."
)
batch_option = click.option(
    "--no-batch", "batch", is_flag=True, flag_value=False, default=True,
    help="Compute standalone runs one by one, instead of many at once.",
)  # fmt: skip
accept_code_option = click.option(
    "--accept-code-change", is_flag=True, help="Add to runs of other code; the campaign records which code made a run."
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object (SI units; NaN and infinity are null)."
)
quiet_option = click.option("--quiet", "-q", is_flag=True, help="Print no progress and no notes.")
progress_option = click.option(
    "--progress", type=click.Choice(MODES), default="auto", show_default=True, help="How to show progress."
)
timeout_option = click.option(
    "--timeout", metavar="TIME",
    help="Time limit of one run, such as '10 min'; standalone runs are then made one by one (campaigns: below 10 s).",
)  # fmt: skip
bounds_option = click.option(
    "--bound", "bounds", is_flag=True,
    help="Show the Cramer-Rao bounds for the measurements in range, used and arrived.",
)  # fmt: skip
plugins_option = click.option(
    "--plugins",
    is_flag=True,
    help="Import any plug-in that a result or a campaign's folder names. Only if you trust it.",
)
result_argument = click.argument("result", metavar="FILE", type=PATH)


@contextlib.contextmanager
def reading(*results: Path) -> Iterator[None]:
    """What is done with results that may be damaged: an error of their values is one of the files, not of wsnsim.

    Raises:
        ResultError: a value is none that a run gives, such as a step of which nothing else is known.
    """
    try:
        yield
    except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError, MemoryError, RecursionError) as error:
        if plugin_fault(error):
            raise
        names = " or ".join(map(str, results))
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ResultError(f"{names}: holds values that no run gives ({reason}; {TRACEBACK_HINT})") from error


def is_campaign(source: str) -> bool:
    """Whether the name is that of a campaign's folder."""
    return os.path.isfile(f"{source}/campaign.json")  # noqa: PTH113 - Path.is_file raises if a name is too long


def demand_meaning(has_meaning: Callable[[str], bool], what: str) -> None:
    """Raise UsageError if an option was given to the current command that has no meaning for what it is about."""
    context = click.get_current_context()
    for option in context.command.params:
        name = str(option.name)
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE and not has_meaning(name):
            raise UsageError(f"{option.opts[0]} has no meaning for {what}")


def demand_no_trackers(command: str, sources: Sequence[str], named: str | None) -> None:
    """Raise UsageError if trackers were given where scenarios are expected; `named`: those of --trackers."""
    from wsnsim.scenario.registry import kinds
    from wsnsim.scenario.texts import find_or_none

    trackers = [source for source in sources if find_or_none(source) is None and source in kinds("tracker")]
    if trackers:
        first = next((source for source in sources if source not in trackers), "SCENARIO")
        such = f"wsnsim {command} {first} --trackers {','.join([*filter(None, [named]), *trackers])}"
        raise UsageError(f"not scenarios but trackers: {', '.join(trackers)}; name them with --trackers: {such}")


def file_name(text: str) -> str:
    """The text with every unsafe character replaced by '_', shortened: the name of a file or folder."""
    return "".join(c if c.isalnum() or c in "_-." else "_" for c in text)[:MAX_NAME_LENGTH]


def writable(out: Path | None, default: Path, option: str = "--out") -> Path:
    """The path to write to: `out`, or the default, whose folder is created.

    Raises:
        UsageError: the path cannot be written, or has another suffix. It is checked before anything runs.
    """
    import tempfile

    path = out or default
    try:
        if out is None:
            path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise UsageError(f"{option} {path} is a folder; give a file such as {path / default.name}")
        if reason := why_not_regular(path):
            raise UsageError(f"{option} {path} {reason}")
        if path.suffix.lower() != default.suffix.lower():
            hint = "; `wsnsim export` writes tables in other formats" * (default.suffix == ".h5")
            raise UsageError(f"{option} {path}: expected a file with the suffix {default.suffix}{hint}")
        if is_too_long(path.name):
            most = LARGEST_NAME - LONGEST_ADDITION
            raise UsageError(f"{option} {shortened(path.name)}: the name of a file has at most {most} bytes")
        if not path.parent.exists():
            raise UsageError(f"{option} {path}: folder does not exist: {path.parent}")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from None
    return path


def seconds_of(option: str, text: str) -> float:
    """The seconds of a time on the command line, such as '10 min' or '600'.

    Raises:
        UsageError: it is no time.
    """
    from wsnsim.scenario.units import UnitError, si

    try:
        seconds = float(text)
    except ValueError:
        try:
            seconds = si(text, "s")
        except UnitError as error:
            raise UsageError(f"{option}: {error}") from None
    if not math.isfinite(seconds):
        raise UsageError(f"{option} {text}: give a finite time, such as 12.5 (in s) or '10 min'")
    return seconds


def plot_path(path: Path, animated: bool = False, option: str = "--out") -> Path:
    """The path of a figure, checked for its suffix and for being writable. Raises UsageError."""
    from wsnsim.analysis.figure_style import suffix_of

    suffix_of(path, animated)
    return writable(path, Path(path.name), option)


def not_the_result(path: Path, result: Path, content: str) -> Path:
    """The path, unless it is the result itself.

    Raises:
        UsageError: writing the `content` there would overwrite the result.
    """
    if path.exists() and result.exists() and path.samefile(result):
        raise UsageError(f"{path} is the result itself; give another file for the {content} with --out")
    return path


def echo(text: str, err: bool = False) -> None:
    """Print a text, on stderr if `err`. Control characters are shown as escapes: names and files may hold them.

    What cannot be printed on stderr is left out: notes and progress never end a command.
    """
    if err:
        tell(printable(text))
    else:
        click.echo(printable(text))


def echo_lines(lines: Sequence[str]) -> None:
    """Print lines on stderr."""
    for line in lines:
        echo(line, err=True)


def echo_answer(answer: str | dict[str, Any]) -> None:
    """Print an answer on stdout: a text, or a mapping as JSON."""
    if isinstance(answer, dict):
        echo_json(answer)
    else:
        echo(answer)


def echo_json(answer: dict[str, Any]) -> None:
    """Print one JSON object on stdout."""
    finite = _finite({"schema_version": SCHEMA_VERSION} | answer)
    echo_json_text(json.dumps(finite, ensure_ascii=False, allow_nan=False))


def echo_json_text(text: str) -> None:
    """Print a JSON text on stdout; control characters in its strings become JSON escapes."""
    click.echo(printable_json(text))


def _finite(value: Any) -> Any:
    """The value with NaN and infinity, which JSON does not have, as None."""
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return None if isinstance(value, float) and value - value != 0 else value


def command_line() -> str:
    """The command line of this process, for the provenance."""
    import shlex

    return shlex.join(["wsnsim", *sys.argv[1:]])


@gc_disabled()
def loaded(source: str, overrides: Sequence[str], plugins: bool) -> Scenario:
    """The scenario of a file or name, or the scenario stored in a result, which may name installed plug-ins only."""
    from wsnsim.scenario.texts import is_result

    if not is_result(source):
        from wsnsim.scenario import load

        return load(source, overrides)
    import wsnsim.experiment as experiment

    found: Scenario = experiment.load(source, overrides, plugins)
    return found
