"""Sources of settings: a TOML file, the environment, the command line; later ones take precedence."""

from __future__ import annotations

import builtins
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwt.access.settings import SettingsError
from rwt.settings.errors import Key, is_list, kind_of
from rwt.settings.models import Settings

ENVIRONMENT_PREFIX: Final = "RWT_"
FILE_VARIABLE: Final = "RWT_CONFIG"
"""Variable with the default file name."""

CLIENT_VARIABLES: Final = frozenset({"RWT_URL", "RWT_TOKEN"})
"""Variables of commands that connect to a robot, which are not settings of a server."""

DEFAULT: Final = "default"

#: Keys of settings that an error text names.
_NAMED: Final = re.compile(r'`([A-Za-z0-9_-]+(?:\.(?:[A-Za-z0-9_-]+|"[^"`]*"))++)`')
_PART: Final = re.compile(r'"([^"]*)"|([A-Za-z0-9_-]+)')

_DEEPEST: Final = 16
"""Maximum nesting of tables; no setting is as deep."""

#: Maximum number of lines of a file that is searched: each is parsed with all before it.
_MAX_LINES: Final = 2000


@dataclass(frozen=True, slots=True)
class Given:
    """Value of a setting, with its source.

    Attributes:
        value: value; text if the source only has text.
        source: description of the source: file, variable or option.
    """

    key: Key
    value: object
    source: str


@dataclass(frozen=True, slots=True)
class LoadedSettings:
    """Settings with the sources of their values.

    Attributes:
        settings: merged settings.
        sources: source of each key that was set; the others have their defaults.
        file: TOML file; None without one.
    """

    settings: Settings
    sources: Mapping[Key, str]
    file: Path | None = None

    def source(self, key: Key) -> str:
        """Return the source of a setting."""
        return self.sources.get(key, DEFAULT)

    def fixed(self, tables: Collection[str]) -> list[str]:
        """Return the variables and options with values of some tables, which a reload cannot read again."""
        file = str(self.file)
        return list(
            dict.fromkeys(
                source for key, source in self.sources.items() if key[0] in tables and source != file
            )
        )

    def with_places(self, text: str) -> str:
        """Return an error text with the sources of the settings that it names."""
        places = [self.place(key) for key in _named_in(text)]
        found = list(dict.fromkeys(place for place in places if place != DEFAULT))
        return f"{', '.join(found)}: {text}" if found else text

    def place(self, key: Key) -> str:
        """Return where a setting or a table comes from, with the line in a file."""
        for length in range(len(key), min(len(key), 2) - 1, -1):  # A default has the source of its table.
            for known, source in self.sources.items():
                if known[:length] == key[:length]:
                    return placed(key[:length], source, self.file)
        return DEFAULT


def load_settings(
    file: Path | None = None,
    environment: Mapping[str, str] | None = None,
    command_line: tuple[Given, ...] = (),
) -> LoadedSettings:
    """Merge the settings of all sources.

    Args:
        file: TOML file; by default that of the variable ``RWT_CONFIG``, if set.
        environment: variables; those that begin with ``RWT_`` are settings, with ``__`` between a table and
            its members. A list is written as in TOML, or with commas.
        command_line: values of options.

    Raises:
        SettingsError: a source cannot be read, or has an unknown setting or an invalid value.
    """
    variables = environment or {}
    if file is None and variables.get(FILE_VARIABLE):
        file = Path(variables[FILE_VARIABLE])
    given = (*(_in_file(file) if file else ()), *_in_environment(variables), *command_line)
    values: dict[str, object] = {}
    sources: dict[Key, str] = {}
    for each in given:
        _put(values, each.key, each.value)
        sources[each.key] = each.source
    try:
        settings = Settings(**values)
    except SettingsError as error:
        text = str(error)
        raise SettingsError(f"{_where(error.key, text, sources, file)}: {text}", error.key) from None
    return LoadedSettings(settings, sources, file)


def with_changes(settings: Settings | None, changes: Mapping[str, object]) -> Settings:
    """Return settings with some changes.

    Args:
        settings: None for the defaults.

    Raises:
        SettingsError: a setting is unknown, or a value is invalid.
    """
    given = settings or Settings()
    if not changes:
        return given
    return Settings(**{**{name: getattr(given, name) for name in given.model_fields_set}, **changes})


def changed_names(before: Settings, after: Settings) -> list[str]:
    """Return the names at the top level whose values differ; one that is not set has its default."""
    fields = type(before).model_fields | type(after).model_fields

    def value(settings: Settings, name: str) -> object:
        default = fields[name].get_default(call_default_factory=True)
        return getattr(settings, name) if name in type(settings).model_fields else default

    return [name for name in fields if value(before, name) != value(after, name)]


def read_settings(path: Path) -> Settings:
    """Read a single TOML file.

    Raises:
        SettingsError: the file cannot be read, is not TOML, or has an unknown key or an invalid value.
    """
    return load_settings(path).settings


def from_text(key: Key, text: str, source: str) -> Given:
    """Parse a setting from text, for example ``limits``, ``connections`` and ``20``.

    Raises:
        SettingsError: the text begins like a list, but is invalid.
    """
    if not is_list(key):
        return Given(key, _plain_value(key, text), source)
    if not text.lstrip().startswith("["):
        return Given(key, [item.strip() for item in text.split(",") if item.strip()], source)
    try:
        return Given(key, tomllib.loads(f"list = {text}")["list"], source)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{source}: `{'.'.join(key)}`: not a list as TOML writes it: {error}") from error


def _plain_value(key: Key, text: str) -> object:
    """Return the boolean or number in a text, or the text itself."""
    match kind_of(key):
        case builtins.bool:
            return {"true": True, "1": True, "false": False, "0": False}.get(text.strip().lower(), text)
        case builtins.int | builtins.float as kind:
            with suppress(ValueError):
                return kind(text)
    return text


def _in_file(path: Path) -> Iterator[Given]:
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # TOMLDecodeError, UnicodeDecodeError, or a number with thousands of digits.
        raise SettingsError(f"{path}: not TOML: {error}") from error
    except RecursionError:
        raise SettingsError(f"{path}: tables or lists are nested too deeply") from None
    return _leaves((), values, str(path))


def _leaves(above: Key, values: Mapping[str, object], source: str) -> Iterator[Given]:
    if len(above) > _DEEPEST:
        raise SettingsError(f"{source}: tables are nested too deeply: {'.'.join(above)}")
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _leaves((*above, name), value, source)
        else:
            yield Given((*above, name), value, source)


def _in_environment(variables: Mapping[str, str]) -> Iterator[Given]:
    for name in sorted(variables):
        if name.startswith(ENVIRONMENT_PREFIX) and name not in (FILE_VARIABLE, *CLIENT_VARIABLES):
            key = tuple(part.lower() for part in name.removeprefix(ENVIRONMENT_PREFIX).split("__"))
            yield from_text(key, variables[name], name)


def _put(values: dict[str, object], key: Key, value: object) -> None:
    """Set one value in nested tables; an empty table is only created."""
    *tables, name = key
    for table in tables:
        inner = values.get(table)
        if not isinstance(inner, dict):
            inner = values[table] = {}
        values = inner
    if value != {} or not isinstance(values.get(name), dict):
        values[name] = value


def _where(key: Key, text: str, sources: Mapping[Key, str], file: Path | None) -> str:
    """Return the places of an invalid value: its own, those of named settings, or all sources."""
    for each in ([key], _named_in(text)):
        places = [place for one in each if (place := _place(one, sources, file))]
        if places:
            return ", ".join(dict.fromkeys(places))
    within = [source for known, source in sources.items() if known[: len(key)] == key]
    return ", ".join(dict.fromkeys(within or sources.values()))


def _named_in(text: str) -> list[Key]:
    """Return the keys of the settings that an error text names."""
    return [tuple(quoted or plain for quoted, plain in _PART.findall(key)) for key in _NAMED.findall(text)]


def _place(key: Key, sources: Mapping[Key, str], file: Path | None) -> str:
    """Return where a setting or the table of a missing one is set; empty if unknown."""
    for length in range(len(key), 0, -1):
        if key[:length] in sources:
            return placed(key[:length], sources[key[:length]], file)
    table = key[:-1]
    if len(table) > 1:  # A member is missing: what sets another one creates the table.
        others = (source for known, source in sources.items() if known[: len(table)] == table)
        if (source := next(others, "")) and source != str(file):
            return source
    return placed(key, str(file), file) if len(key) > 1 and file is not None else ""


def placed(key: Key, source: str, file: Path | None) -> str:
    """Return the source of a setting, with the line if it is a file."""
    if file is None or source != str(file):
        return source
    lines = (line_of(file, key[:length]) for length in range(len(key), 1, -1))
    line = next((each for each in lines if each is not None), line_of(file, key[:1]))
    return source if line is None else f"{source}:{line}"


def line_of(path: Path, key: Sequence[str]) -> int | None:
    """Return the line at which a setting or its table begins, from 1; None if it is not found.

    Growing parts of the file are parsed until one contains the setting.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, ValueError):
        return None
    begins = 0  # Start of the statement after the last valid part.
    for number in range(min(len(lines), _MAX_LINES)):
        try:
            values = tomllib.loads("".join(lines[: number + 1]))
        except (ValueError, RecursionError):
            continue  # Inside a list or a string of several lines.
        if _has(values, key):
            return begins + 1
        begins = number + 1
    return None


def _has(values: object, key: Sequence[str]) -> bool:
    for part in key:
        if not isinstance(values, Mapping) or part not in values:
            return False
        values = values[part]
    return True
