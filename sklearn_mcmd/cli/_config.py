"""``--config FILE``, settings in a file; ``mcmd config``, all of them with their defaults."""

import json
import tomllib
from pathlib import Path
from textwrap import indent, wrap
from typing import Annotated

import typer

__all__ = ["Config", "config"]

WIDTH = 96
# They are of one run, or of no verb.
NO_SETTINGS = {"config", "help", "dry_run", "restart", "report"}


def _read(context: typer.Context, path: Path | None):
    """Take the settings of the verb as its defaults; refuse what no verb knows."""
    if path is None:
        return None
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as err:
        words = getattr(err, "strerror", None) or str(err)
        raise typer.BadParameter(f"{path} cannot be read: {words}") from err
    verbs = _verbs(context)
    for verb, table in tables.items():
        if verb not in verbs or not isinstance(table, dict):
            raise typer.BadParameter(
                f"{path}: {verb} is no verb; settings stand below a verb, such as [denoise]"
            )
        known = {option.name for option in _settings(verbs[verb])}
        for name in table:
            if name not in known:
                raise typer.BadParameter(
                    f"{path}: {verb} has no setting {name}; mcmd config {verb} lists all"
                )
    table = tables.get(context.info_name or "", {})
    context.default_map = {name: _as_typed(value) for name, value in table.items()}
    return path


Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        callback=_read,
        is_eager=True,
        help="File of settings (TOML), those of this verb and more. Options that are given here "
        "count more. mcmd config VERB prints all with their defaults.",
    ),
]


def config(
    context: typer.Context,
    verb: Annotated[
        str | None, typer.Argument(metavar="VERB", help="The verb whose settings to print.")
    ] = None,
):
    """Print all settings of a verb, or of all, with their defaults, as a file for --config."""
    verbs = _verbs(context)
    with_settings = [name for name, command in verbs.items() if _takes_config(command)]
    if verb not in (None, *with_settings):
        raise typer.BadParameter(f"{verb} is no verb with settings: {', '.join(with_settings)}")
    for name in [verb] if verb else with_settings:
        typer.echo(f"[{name}]")
        for option in _settings(verbs[name]):
            typer.echo(_lines(option))


def _verbs(context):
    return context.find_root().command.commands


def _takes_config(command):
    return any(option.name == "config" for option in command.params)


def _settings(command):
    """The options of a verb that a file may hold."""
    options = [option for option in command.params if option.param_type_name == "option"]
    return [option for option in options if option.name not in NO_SETTINGS]


def _lines(option):
    help = indent("\n".join(wrap(option.help or "", WIDTH)), "# ")
    default, words = option.default, option.show_default
    if default is None:
        words = words if isinstance(words, str) else "not given"
        return f"{help}\n# {option.name} = {words}"
    return f"{help}\n{option.name} = {json.dumps(default)}"


def _as_typed(value):
    """A value as it would be typed after an option."""
    if isinstance(value, bool):
        return value
    if isinstance(value, list):
        return ",".join(map(str, value))
    if isinstance(value, dict):  # columns
        return ",".join(f"{name}={part}" for name, part in value.items())
    return str(value)
