"""Options of a test: from its markers, the command line and the ini file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rwt_interfaces.distro import DISTROS
from rwt_participant.spelling import nearest

#: Distributions that `both` stands for, and the default, which is the first.
FAMILIES = ("jazzy", "noetic")
BOTH = "both"

_KEYS = ("distro", "demo", "interfaces", "settings")


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a robot and its server.

    Attributes:
        settings: server settings by dotted key; those from the ini file are strings.
        virtual: True to simulate time.
    """

    distro: str = FAMILIES[0]
    demo: bool = False
    interfaces: tuple[Path, ...] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    virtual: bool = False


def distros_of(config: pytest.Config, marks: list[pytest.Mark]) -> tuple[str, ...]:
    """Return the distributions with which a test runs.

    Raises:
        UsageError: an unknown distribution is named.
    """
    marked = _marked(marks).get("distro")
    asked = marked or config.getoption("rwt_distro") or config.getini("rwt_distro") or FAMILIES[0]
    chosen: object = FAMILIES if asked == BOTH else asked
    several = tuple(map(str, chosen)) if isinstance(chosen, list | tuple) else (str(chosen),)
    for each in several:
        if each not in DISTROS:
            known = ", ".join((*DISTROS, BOTH))
            raise pytest.UsageError(f"rwt: there is no distro {each!r}; known are {known}")
    return several


def options_of(request: pytest.FixtureRequest, distro: str) -> Options:
    """Return the options of one test.

    Raises:
        UsageError: a marker or an ini value is invalid.
    """
    node: pytest.Item = request.node
    config = request.config
    marked = _marked(list(node.iter_markers("rwt")))
    return Options(
        distro=distro,
        demo=bool(marked.get("demo", False)),
        interfaces=(*config.getini("rwt_interfaces"), *_folders(node, marked.get("interfaces", ()))),
        settings={**_ini_settings(config), **_settings(marked.get("settings", {}))},
        virtual="rwt_clock" in request.fixturenames,
    )


def _marked(marks: list[pytest.Mark]) -> dict[str, object]:
    """Merge the arguments of all markers; the closest to the test wins."""
    asked: dict[str, object] = {}
    for mark in reversed(marks):
        if mark.args:
            raise pytest.UsageError(f"@pytest.mark.rwt takes {', '.join(_KEYS)} by name, not {mark.args!r}")
        for key in mark.kwargs:
            if key not in _KEYS:
                near = nearest(key, _KEYS)
                instead = f"did you mean {near}?" if near else f"known are {', '.join(_KEYS)}"
                raise pytest.UsageError(f"@pytest.mark.rwt has no argument {key}; {instead}")
        asked.update(mark.kwargs)
    return asked


def _folders(node: pytest.Item, asked: object) -> tuple[Path, ...]:
    several = asked if isinstance(asked, list | tuple) else (asked,)
    return tuple(node.path.parent / str(folder) for folder in several)


def _settings(asked: object) -> Mapping[str, object]:
    if not isinstance(asked, Mapping):
        raise pytest.UsageError(
            f'@pytest.mark.rwt: settings={{"limits.connections": 2}} is expected, not {asked!r}'
        )
    return asked


def _ini_settings(config: pytest.Config) -> dict[str, object]:
    pairs = [str(line).partition("=") for line in config.getini("rwt_settings")]
    for key, equals, _ in pairs:
        if not equals:
            raise pytest.UsageError(f"rwt_settings: expected KEY=VALUE on each line, got {key!r}")
    return {key.strip(): value.strip() for key, _, value in pairs}


def transcript_lines(config: pytest.Config) -> int:
    """Return how many transcript lines a failing test shows.

    Raises:
        UsageError: the ini value is not a whole number.
    """
    text = str(config.getini("rwt_transcript_lines"))
    if not text.isdecimal():
        raise pytest.UsageError(f"rwt_transcript_lines: expected a whole number, got {text!r}")
    return int(text)
