"""Writes docs/reference/commands.md from the parsers of the command line.

Run it after a change of a verb: ``python tools/generate_commands.py``. A test compares.
"""

# ruff: noqa: E501 - a row of a Markdown table is one line

from __future__ import annotations

import argparse
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

from rwt.cli import COMMANDS, parser_for
from rwt.cli.parser import Parser
from rwt_transports.schemes import url_forms

TARGET = Path(__file__).parents[1] / "docs" / "reference" / "commands.md"

_ELSEWHERE = ("conformance",)
_ROBOT_OPTIONS = frozenset({"--url", "--token", "--cafile", "--insecure", "--timeout", "--json"})

_HEAD = """\
# Verbs of the command line

This page is made from the program by `tools/generate_commands.py`. [The tour](../how-to/command-line.md) shows the verbs
at work; [what the servers print and serve](command-line.md), and the options of
[`rwt conformance`](../how-to/conformance.md#options), have pages of their own.

Names, options and output are those of the `ros2` tool where it has them. A name may lack its first slash, a type may be
`std_msgs/String` or `std_msgs/msg/String`, and messages and values are YAML or JSON.

## Options of every verb that talks to a robot

| option | meaning |
|---|---|
| `--url URL` | Where the robot is: URL_FORMS, with a host and a port, the path of a socket or a command. Default: the variable `RWT_URL`, else `ws://127.0.0.1:9090`. |
| `--token TOKEN` | Bearer token to show, with `ws://` and `wss://`. Default: the variable `RWT_TOKEN`, which others on the machine cannot read. |
| `--cafile FILE` | Check the server's certificate against those in this file, in PEM. Default: the system's authorities. |
| `--insecure` | Do not check it: whoever is between here and the robot can then read and change everything. |
| `--timeout SECONDS` | How long to wait for the connection and for each answer, default 10. There is no limit for a message, a subscription and the end of a goal unless this sets one. |
| `--json` | Print JSON: one value, or of what goes on one value a line. Octets are base64 and NaN is null, as rosbridge sends them. |
| `--help`, `-h` | Say all this in short. |

Colours, aligned columns and rates that are drawn in place are for terminals; into a pipe or a file goes plain text.
`NO_COLOR` turns colours off everywhere. Notes and errors go to standard error, an error as one line.

## Exit codes

Those of [servers](command-line.md#exit-codes) stand with them.

| code | when |
|---|---|
| 0 | It is done. Also what goes on until Ctrl-C (`topic echo`, `pub`, `hz`, `bw`, `delay`) after Ctrl-C. |
| 1 | It failed: the robot knows no such name or says no, a goal was aborted, a parameter was not set, `rwt doctor` found a problem. |
| 2 | It was called wrongly: an unknown option, a message that cannot be read or does not fit its type, a URL that is none. |
| 3 | There is no connection, or it was lost. |
| 4 | Nothing came in time. |
| 130 | Ctrl-C ended what had not ended by itself; a goal is canceled. |
| 141 | Who read the output has gone, as in `rwt topic echo /odom \\| head -n 1`. |
"""


def page() -> str:
    """The whole page."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield _HEAD.replace("URL_FORMS", ", ".join(f"`{form}`" for form in url_forms(connect=True).split(", ")))
    for command in COMMANDS:
        if command.name in _ELSEWHERE:
            continue
        parser = _subcommands(parser_for(command.name))[command.name]
        verbs = _subcommands(parser)
        yield f"## rwt {command.name}\n"
        yield f"{_prose(parser.description)}\n"
        if not verbs:
            yield from _verb(parser)
        for name, verb in verbs.items():
            yield f"### rwt {command.name} {name}\n"
            yield f"{_prose(verb.description)}\n"
            yield from _verb(verb)


def _subcommands(parser: argparse.ArgumentParser) -> dict[str, Parser]:
    """The commands of a parser, by name, without those that cannot be had."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return {name: each for name, each in action.choices.items() if not each.unavailable}
    return {}


def _verb(parser: argparse.ArgumentParser) -> Iterator[str]:
    options = {name for action in parser._actions for name in action.option_strings}
    # What talks to a robot has these options; a recording has some of them with other meanings.
    told = _ROBOT_OPTIONS | {"--help"} if options > _ROBOT_OPTIONS - {"--json"} else {"--help"}
    rows = [_row(action) for action in parser._actions if not told & set(action.option_strings)]
    if rows:
        yield "| argument | meaning |\n|---|---|"
        yield from rows
        yield ""
    example, _, shape = (parser.epilog or "").partition("\n\n--json prints:\n")
    for indented, lines in itertools.groupby(example.splitlines()[1:], lambda line: line.startswith("  ")):
        if indented:
            code = "\n".join(line.removeprefix("  ") for line in lines)
            yield f"<!-- not run: the tour runs its like -->\n```sh\n{code}\n```\n"
        else:
            text = " ".join(lines)
            yield f"{text[:1].upper()}{text[1:]}{'' if text.endswith(':') else '.'}\n"
    if shape:
        code = "\n".join(line.removeprefix("  ") for line in shape.splitlines())
        yield f"`--json` prints\n\n<!-- not run: output -->\n```text\n{code}\n```\n"


def _row(action: argparse.Action) -> str:
    value = action.metavar if isinstance(action.metavar, str) else None
    if value is None and action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    value = {"?": "[{}]", "+": "{} ...", "*": "[{} ...]"}.get(str(action.nargs), "{}").format(value or "")
    value = value.replace("|", "\\|") if action.option_strings else value.strip("[]").replace("|", "\\|")
    names = [f"`{name}`" for name in action.option_strings[:-1]]
    names += (
        [f"`{' '.join(filter(None, [action.option_strings[-1], value if action.nargs != 0 else None]))}`"]
        if (action.option_strings)
        else [f"`{value}`"]
    )
    help = re.sub(r"[<>|]", lambda found: f"\\{found[0]}", action.help or "")
    end = "" if help.endswith("…") else "."
    return f"| {', '.join(names)} | {help[:1].upper()}{help[1:]}{end} |".replace("||", "|")


def _prose(text: str | None) -> str:
    return " ".join((text or "").split())


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
