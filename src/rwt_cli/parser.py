"""The parser of every command: its errors are one line, with the nearest known word."""

from __future__ import annotations

import argparse
import re
import sys
from typing import Final, NoReturn, TypeAlias

from rwt_cli.errors import CALLED_WRONGLY, did_you_mean

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""What commands are added to."""

_INVALID_CHOICE: Final = re.compile(r"(?:argument (.*?): )?invalid choice: '(.*)' \(choose from (.*)\)", re.S)


class Parser(argparse.ArgumentParser):
    """An :class:`argparse.ArgumentParser` that keeps the line ends of texts, and says what is wrong in one
    line."""

    def __init__(
        self,
        *,
        prog: str | None = None,
        usage: str | None = None,
        description: str | None = None,
        epilog: str | None = None,
        formatter_class: type[argparse.HelpFormatter] = argparse.RawDescriptionHelpFormatter,
        prefix_chars: str = "-",
        add_help: bool = True,
    ) -> None:
        super().__init__(
            prog=prog,
            usage=usage,
            description=description,
            epilog=epilog,
            formatter_class=formatter_class,
            prefix_chars=prefix_chars,
            add_help=add_help,
            # `--time` for `--timeout` today would be something else tomorrow.
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """End the program with one line on stderr and the exit code for being called wrongly."""
        sys.stderr.write(f"{self.prog}: {_plainly(message)} (`{self.prog} --help` says more)\n")
        raise SystemExit(CALLED_WRONGLY)


def _plainly(message: str) -> str:
    """argparse's message with the nearest word in place of all that there are."""
    found = _INVALID_CHOICE.fullmatch(message)
    if found is None:
        return message
    where, word, listed = found.groups()
    known = [each.strip(" '\"") for each in listed.split(",")]
    what = "command" if where in (None, "COMMAND") else f"value for {where}"
    meant = did_you_mean(word, known) or f": expected {', '.join(known)}"
    return f"unknown {what} {word!r}{meant}"
