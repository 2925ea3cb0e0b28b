"""Every option of every command with values that nobody means: numbers out of all ranges, control characters,
nothing at all. They are refused in one line with exit code 2, or taken; reading them never fails."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from typing import Final

import pytest

from rwt.cli import parser_for
from rwt.cli.errors import CALLED_WRONGLY
from rwt.cli.parser import Parser, actions_of, commands_of

EXTREME: Final = (
    "", " ", "-1", "0", "1.5", "nan", "inf", "-inf", "1e308", "1e400", "5e-324", "9" * 400, "9" * 5000,
    "4294967296", "18446744073709551616", "0x10", "1_0", "\u0661\u0662", "\u00b2", "\U0001f916", "a\nb",
    "\x1b[2J", "\x00", "\udcff", "a" * 5000, "/" * 5000, "../../etc/passwd", "[[[[", "{", "null", "%s%n", "~",
    "*", "ws://", "ws://[", "ws://a:99999", "-" + "9" * 400, "=", ":=", "9" * 400 + "GB", "1e400s", "-1d",
)  # fmt: skip

_HARMFUL: Final = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f]")


def _commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The commands that have no commands below them."""
    inner = commands_of(parser)
    if not inner:
        yield parser
    for each in inner.values():
        if not (isinstance(each, Parser) and each.unavailable):
            yield from _commands(each)


PARSERS: Final = {parser.prog: parser for parser in _commands(parser_for("*"))}


def _words(parser: argparse.ArgumentParser, action: argparse.Action, value: str) -> list[str]:
    """A command line with one value at its place, and something ordinary where something is required."""
    words = []
    for each in actions_of(parser):
        if each is action:
            words.append(f"{each.option_strings[-1]}={value}" if each.option_strings else value)
        elif each.required and each.nargs not in ("*", argparse.REMAINDER):
            ordinary = str(next(iter(each.choices))) if each.choices else "x"
            words += [*each.option_strings[-1:], ordinary]
    return words


def _refusal(
    capsys: pytest.CaptureFixture[str], parser: argparse.ArgumentParser, words: list[str]
) -> str | None:
    """Return the error of a command line; None if it is accepted."""
    capsys.readouterr()
    try:
        parser.parse_args(words)
    except SystemExit as ended:
        assert ended.code == CALLED_WRONGLY, words
        return capsys.readouterr().err
    return None


@pytest.mark.parametrize("command", PARSERS)
def test_every_value_is_taken_or_refused_in_one_line(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = PARSERS[command]
    for action in actions_of(parser):
        if action.nargs == 0:
            continue
        for value in EXTREME:
            said = _refusal(capsys, parser, _words(parser, action, value))
            if said is not None:
                assert said.count("\n") == 1 and said.startswith(f"{command}: "), (action.dest, value, said)
                assert len(said) < 1000 and not _HARMFUL.search(said), (action.dest, value[:40], said[:2000])


SETTINGS: Final = ("workers", "setting:zenoh.domain")
"""Options that are settings, whose models have the ranges."""

_UNITS: Final = ("N", "S", "SECONDS", "HZ", "RATE", "M/S", "RAD/S", "BYTES")
_NUMBERS: Final = ("9" * 400, "1e400", "nan", "inf", "-1", "1e308", "-" + "9" * 400, "")


@pytest.mark.parametrize("command", PARSERS)
def test_an_option_that_is_a_number_has_a_range(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = PARSERS[command]
    for action in actions_of(parser):
        metavar = action.metavar if isinstance(action.metavar, str) else ""
        if action.dest not in SETTINGS and metavar in _UNITS:
            for value in _NUMBERS:
                assert _refusal(capsys, parser, _words(parser, action, value)), (action.dest, value[:40])
