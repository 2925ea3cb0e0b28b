"""`rwt config show`: the settings in effect with their sources; and the options for settings of commands."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from pydantic import BaseModel

from rwt.access.settings import SettingsError
from rwt.cli.errors import CommandError
from rwt.cli.parser import add_commands
from rwt.settings.errors import Key, is_secret
from rwt.settings.models import with_all_tables
from rwt.settings.sources import DEFAULT, Given, LoadedSettings, from_text, load_settings

_EXAMPLES = """\
examples:
  rwt config show                                     the defaults, and what the environment sets
  rwt config show --config robot.toml
  RWT_LIMITS__CONNECTIONS=20 rwt config show          a table and its key are joined by two underscores
  rwt config show --set limits.connections=20         what `rwt serve` would do with the same option
"""
_MASK = "**********"
_COMMENT_COLUMN = 44


def add_config_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `config` to the command line."""
    parser = commands.add_parser("config", description="Print the settings.")
    actions = add_commands(parser)
    show = actions.add_parser(
        "show",
        help="print the settings in effect with their sources",
        description="Print the settings in effect as TOML, each with its source. Secrets are masked.",
        epilog=_EXAMPLES,
    )
    add_settings_options(show)
    show.set_defaults(run=_run)


def add_settings_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of all commands with settings."""
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="TOML file with settings (default: $RWT_CONFIG, or none)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="set one setting, for example limits.connections=20; may be given several times",
    )


def settings_of(arguments: argparse.Namespace, options: Mapping[str, object] | None = None) -> LoadedSettings:
    """Load the settings of a command from file, environment and command line.

    Args:
        arguments: arguments of a parser with :func:`add_settings_options`.
        options: values of further options by the key of their setting; None if not given.

    Raises:
        CommandError: a setting is invalid.
    """
    given = [
        Given(tuple(key.split(".")), value, "command line")
        for key, value in (options or {}).items()
        if value is not None
    ]
    try:
        for text in arguments.set:
            key, equals, value = text.partition("=")
            if not equals:
                raise SettingsError(f"--set {text}: expected KEY=VALUE, for example limits.connections=20")
            given.append(from_text(tuple(key.strip().split(".")), value, f"--set {key}"))
        return load_settings(arguments.config, os.environ, tuple(given))
    except SettingsError as error:
        raise CommandError(str(error), exit_code=2) from error


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(show(settings_of(arguments))))
    return 0


def show(loaded: LoadedSettings) -> Iterator[str]:
    """Yield the lines of a TOML file with these settings, each with the source of its value."""
    yield from _table(loaded, (), with_all_tables(loaded.settings))


def _table(loaded: LoadedSettings, above: Key, table: BaseModel) -> Iterator[str]:
    inner: list[tuple[Key, BaseModel]] = []
    for name in type(table).model_fields:
        key, value = (*above, name), getattr(table, name)
        if isinstance(value, BaseModel):
            inner.append((key, value))
        elif isinstance(value, Mapping) and all(isinstance(each, BaseModel) for each in value.values()):
            inner.extend(((*key, each), entry) for each, entry in value.items())
        else:
            yield _line(key, value, loaded.source(key))
    for key, entry in inner:
        yield ""
        yield f"[{'.'.join(_part(part) for part in key)}]"
        yield from _table(loaded, key, entry)


def _line(key: Key, value: object, source: str) -> str:
    if value is None:
        return f"# {key[-1]} is not set"
    text = f"{_part(key[-1])} = {_toml(_MASK if is_secret(key) else value)}"
    return f"{text:<{_COMMENT_COLUMN}}  # {_comment(source)}"


def _part(name: str) -> str:
    return name if name.isascii() and name.replace("-", "_").isidentifier() else _toml(name)


def _toml(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(item) for item in value)}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_part(name)} = {_toml(each)}' for name, each in value.items())}}}"
    if isinstance(value, bool | int | float):
        return str(value).lower()
    # A TOML basic string is a JSON string, except for code point 127, which must be escaped.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(source: str) -> str:
    """Return a source as one line; file names may contain line breaks."""
    return source if source == DEFAULT or source.isprintable() else source.encode("unicode_escape").decode()
