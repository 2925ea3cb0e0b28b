"""Program that prints the help of each command, and what `rwt config` says of settings, as JSON.

It is the one place of these traces that imports the server's code: a process for each help would take half a
minute.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
from collections.abc import Iterator

from rwt.cli import main, parser_for


def words_of(parser: argparse.ArgumentParser, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The words of each command below a parser."""
    yield words
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, each in action.choices.items():
                yield from words_of(each, (*words, name))


def ran(*words: str) -> tuple[str, str]:
    """Return the output of a command line, and its exit code."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code: object = main(list(words))
        except SystemExit as ended:
            code = ended.code
    return out.getvalue(), str(code)


lines = [(*words, "--help") for words in words_of(parser_for("*"))]
lines += [("config", "show")]
lines += [("config", "show", *each.split("|")) for each in json.loads(sys.argv[1])]
json.dump([("rwt " + " ".join(words), *ran(*words)) for words in lines], sys.stdout)
