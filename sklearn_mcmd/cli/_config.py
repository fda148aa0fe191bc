"""``--config FILE``, settings in a file; ``mcmd config``, all of them with their defaults."""

import json
import tomllib
from pathlib import Path
from textwrap import indent, wrap
from typing import Annotated

import typer

WIDTH = 96  # of comments
# They are of one run, or of no verb.
NO_SETTINGS = {"config", "help", "dry_run", "restart", "report"}


def _settings(context):
    """The options that a file may hold, by verb and name."""
    return {
        verb: {
            option.name: option
            for option in command.params
            if option.param_type_name == "option" and option.name not in NO_SETTINGS
        }
        for verb, command in context.find_root().command.commands.items()
        if any(option.name == "config" for option in command.params)
    }


def _read(context: typer.Context, path: Path | None):
    """Take the settings of the verb as its defaults; refuse what no verb knows."""
    if path is None:
        return None
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as err:
        words = getattr(err, "strerror", None) or str(err)
        raise typer.BadParameter(f"{path} cannot be read: {words}") from err
    known = _settings(context)
    for verb, table in tables.items():
        if verb not in known or not isinstance(table, dict):
            raise typer.BadParameter(
                f"{path}: {verb} is no verb; settings stand below a verb, such as [denoise]"
            )
        for name in table.keys() - known[verb].keys():
            raise typer.BadParameter(
                f"{path}: {verb} has no setting {name}; mcmd config {verb} lists all"
            )
    table = tables.get(context.info_name or "", {})
    context.default_map = {name: _as_typed(value) for name, value in table.items()}
    return path


def _as_typed(value):
    """A value as it would be typed after an option."""
    if isinstance(value, list):
        return ",".join(map(str, value))
    return value if isinstance(value, bool) else str(value)


Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", callback=_read, is_eager=True, help="Settings (TOML); options count more."
    ),
]


def config(
    context: typer.Context,
    verb: Annotated[
        str | None, typer.Argument(metavar="VERB", help="The verb whose settings to print.")
    ] = None,
):
    """Print all settings of a verb, or of all, with their defaults, as a file for --config."""
    known = _settings(context)
    if verb not in (None, *known):
        raise typer.BadParameter(f"{verb} is no verb with settings: {', '.join(known)}")
    for name in [verb] if verb else known:
        typer.echo(f"[{name}]")
        for option in known[name].values():
            typer.echo(indent("\n".join(wrap(option.help or "", WIDTH)), "# "))
            if option.default is None:
                words = option.show_default
                typer.echo(f"# {option.name} = {words if isinstance(words, str) else 'not given'}")
            else:
                typer.echo(f"{option.name} = {json.dumps(option.default)}")
