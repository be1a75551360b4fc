"""What all commands share: the group they belong to, options that several have, and how an answer goes out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.version import __version__

SCHEMA_VERSION: Final = 1


class _Commands(click.Group):
    """A group that names the nearest command when it has none of the name."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            raise click.UsageError(f"no such command '{args[0]}' ({did_you_mean(args[0], self.commands)})", ctx)
        return super().resolve_command(ctx, args)


def _version(ctx: click.Context, option: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(f"wsnsim {__version__}")
        ctx.exit()


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show the version.")
def group() -> None:
    """Simulate wireless sensor networks that track moving targets, joule by joule.

    SCENARIO is a YAML file, the name of a shipped scenario (`wsnsim list scenarios`), or a result whose scenario is run
    again.
    """


overrides_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Change a value: link.reach='80 m'."
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Answer with one JSON object (SI units; NaN and infinity are null)."
)
result_argument = click.argument("result", metavar="FILE", type=click.Path(path_type=Path))


def is_campaign(source: str) -> bool:
    """Whether a name is that of a campaign's folder."""
    try:
        return (Path(source) / "campaign.json").is_file()
    except (OSError, ValueError):
        return False


def writable(out: Path | None, default: Path) -> Path:
    """Where the answer goes. Raises UsageError, before anything runs, if it cannot be written there."""
    import tempfile

    path = out or default
    try:
        if out is None:
            path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise UsageError(f"--out {path} is a folder; give a file such as {path / default.name}")
        if path.exists() and not path.is_file():
            raise UsageError(f"--out {path} is no regular file")
        if not path.parent.exists():
            raise UsageError(f"--out {path}: there is no folder {path.parent}; make it first")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from None
    return path


def echo_json(answer: dict[str, Any]) -> None:
    """One JSON object on stdout."""
    click.echo(json.dumps(_finite({"schema_version": SCHEMA_VERSION} | answer), ensure_ascii=False, allow_nan=False))


def _finite(value: Any) -> Any:
    """JSON has no NaN and no infinity: they are null."""
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return None if isinstance(value, float) and value - value != 0 else value


def command_line() -> str:
    """What was typed, for provenance."""
    import shlex

    return shlex.join(["wsnsim", *sys.argv[1:]])
