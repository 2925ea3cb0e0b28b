"""`rwt completion`: makes a shell complete commands, options, and the names in the robot's live graph."""

from __future__ import annotations

import argparse
import re
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final

from rwt_cli.console.output import standard_output
from rwt_cli.parser import Commands
from rwt_cli.verbs import Arguments, connecting, sentence

if TYPE_CHECKING:
    from rwt_client import Robot

SHELLS: Final = ("bash", "zsh", "fish")
LIVE_SECONDS: Final = 1.5
"""How long a robot may take to say what it has, while somebody waits for a completion."""

_EXAMPLES: Final = """\
examples:
  source <(rwt completion bash)                                  in ~/.bashrc
  source <(rwt completion zsh)                                   in ~/.zshrc, after compinit
  rwt completion fish > ~/.config/fish/completions/rwt.fish"""

_BASH: Final = """\
_rwt_complete() {
    local IFS=$'\\n'
    COMPREPLY=($(rwt completion words --line "${COMP_LINE:0:COMP_POINT}" 2>/dev/null))
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == */ ]] && compopt -o nospace
}
complete -o default -F _rwt_complete rwt
"""
_ZSH: Final = """\
#compdef rwt
_rwt() {
    local -a found
    found=("${(@f)$(rwt completion words -- "${(@)words[2,CURRENT]}" 2>/dev/null)}")
    if [[ -n "${found[*]}" ]]; then compadd -- "${found[@]}"; else _files; fi
}
if [[ "${funcstack[1]}" == _rwt ]]; then _rwt "$@"; else compdef _rwt rwt; fi
"""
_FISH: Final = """\
function __rwt_complete
    set -l typed (commandline -opc)
    rwt completion words -- $typed[2..-1] (commandline -ct) 2>/dev/null
end
complete -c rwt -f -a '(__rwt_complete)'
"""
_SCRIPTS: Final = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}
_WORD: Final = re.compile(r"""(?:[^\s'"\\]|\\.|\\$|'[^']*(?:'|$)|"(?:[^"\\]|\\.)*(?:"|$))+""", re.S)

Names = Callable[["Robot"], Awaitable[Iterable[str]]]


async def _topics(robot: Robot) -> Iterable[str]:
    return [topic.name for topic in await robot.api.topics()]


async def _services(robot: Robot) -> Iterable[str]:
    return await robot.api.services()


async def _actions(robot: Robot) -> Iterable[str]:
    return await robot.api.action_servers()


async def _nodes(robot: Robot) -> Iterable[str]:
    return await robot.api.nodes()


LIVE: Final[dict[str, Names]] = {"TOPIC": _topics, "SERVICE": _services, "ACTION": _actions, "NODE": _nodes}
"""What the robot is asked for, by the word that stands for the argument in the help."""


def add_completion_command(commands: Commands) -> None:
    """Add `completion` to the command line."""
    help = "print what makes a shell complete what you type, names of the robot's live graph included"
    parser = commands.add_parser("completion", description=sentence(help), epilog=_EXAMPLES)
    shells = parser.add_subparsers(title="shells", metavar="SHELL", required=True)
    for shell in SHELLS:
        of_shell = shells.add_parser(shell, help=f"for {shell}", description=f"The script for {shell}.")
        of_shell.set_defaults(run=_print_script, shell=shell)
    # Without help, so that it is not listed: only the scripts call it.
    words = shells.add_parser(
        "words", description="What the word that is being typed may become, one a line."
    )
    words.add_argument("--line", metavar="LINE", help="the command line so far, as bash has it")
    words.add_argument("word", nargs="*", metavar="WORD", help="the words after rwt; the last is being typed")
    words.set_defaults(run=_print_words)


def _print_script(arguments: Arguments) -> int:
    standard_output(json=False).text(_SCRIPTS[arguments.shell])
    return 0


def _print_words(arguments: Arguments) -> int:
    output = standard_output(json=False)
    words = arguments.word or [""] if arguments.line is None else words_of(arguments.line)[1:] or [""]
    found = candidates(words)
    # Bash takes a colon for the end of a word: what stands before it must not come again.
    given = words[-1].rpartition(":")[0] if arguments.line is not None else ""
    for each in found:
        output.line(each[len(given) + 1 :] if given else each)
    return 0


def words_of(line: str) -> list[str]:
    """The words of a command line as a shell splits it; the last is the one being typed, perhaps empty."""
    words = [_unquoted(match[0]) for match in _WORD.finditer(line)]
    return [*words, ""] if not line or line[-1].isspace() else words


def _unquoted(word: str) -> str:
    return re.sub(r"""\\(.)|\\$|['"]""", lambda match: match[1] or "", word, flags=re.S)


def candidates(words: Sequence[str]) -> list[str]:
    """What the last word may become, given those before it."""
    *before, typed = words
    place = _Place(before)
    if place.expecting is not None:
        return _starting(typed, _values(place.expecting, place.given))
    if typed.startswith("-"):
        return _starting(typed, _options(place.parser))
    action = place.positional()
    return [] if action is None else _starting(typed, _values(action, place.given))


class _Place:
    """Where in the command line somebody is after some words.

    Attributes:
        parser: of the command that was typed.
        expecting: the option whose value comes next; None for none.
        given: the options that have a value.
    """

    def __init__(self, words: Sequence[str]) -> None:
        from rwt_cli import parser_for

        self.parser: argparse.ArgumentParser = parser_for(words[0] if words else None)
        self.expecting: argparse.Action | None = None
        self.given: dict[str, str] = {}
        self._filled = 0
        for word in words:
            self._pass(word)

    def _pass(self, word: str) -> None:
        if self.expecting is not None:
            self.given[self.expecting.dest], self.expecting = word, None
        elif word.startswith("-") and len(word) > 1:
            self.expecting = _option_with_value(self.parser, word, self.given)
        elif (inner := _subcommand(self.parser, word)) is not None:
            self.parser, self._filled = inner, 0
        else:
            self._filled += 1

    def positional(self) -> argparse.Action | None:
        """The argument that comes next; None if there is no more."""
        known = self.parser._get_positional_actions()
        if self._filled < len(known):
            return known[self._filled]
        return known[-1] if known and known[-1].nargs in ("*", "+") else None


def _option_with_value(
    parser: argparse.ArgumentParser, word: str, given: dict[str, str]
) -> argparse.Action | None:
    """The option whose value is the next word; None if the next word is none."""
    name, equals, value = word.partition("=")
    action = parser._option_string_actions.get(name)
    if action is None or action.nargs == 0:
        return None
    if equals:
        given[action.dest] = value
        return None
    return action


def _subcommand(parser: argparse.ArgumentParser, word: str) -> argparse.ArgumentParser | None:
    for action in parser._get_positional_actions():
        if isinstance(action, argparse._SubParsersAction):
            found: argparse.ArgumentParser | None = action.choices.get(word)
            return found
    return None


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [name for name in parser._option_string_actions if name.startswith("--")]


def _starting(typed: str, values: Iterable[str]) -> list[str]:
    return sorted({value for value in values if value.startswith(typed)})


def _values(action: argparse.Action, given: dict[str, str]) -> Iterable[str]:
    """What an argument may be."""
    if isinstance(action, argparse._SubParsersAction):
        return [choice.dest for choice in action._choices_actions] or list(action.choices)
    if action.choices is not None:
        return [str(choice) for choice in action.choices]
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if metavar in LIVE:
        return _live(LIVE[metavar], given)
    return _types() if metavar.split(" ")[0] == "TYPE" else []


def _types() -> list[str]:
    from rwt_interfaces.distro import JAZZY
    from rwt_interfaces.names import KINDS, three_part
    from rwt_interfaces.registry import Registry

    registry = Registry(JAZZY)
    return [three_part(name, kind) for kind in KINDS for name in registry.names(kind)]


def _live(names: Names, given: dict[str, str]) -> list[str]:
    """Names of the live graph; none if the robot does not say in time: nobody wants an error message here."""
    import anyio

    from rwt_cli.errors import CommandError
    from rwt_client import RobotError

    found: list[str] = []
    arguments = Arguments(url=given.get("url"), token=given.get("token"), timeout=LIVE_SECONDS)

    async def ask() -> None:
        with anyio.move_on_after(LIVE_SECONDS):
            async with connecting(arguments) as robot:
                found.extend(await names(robot))

    try:
        anyio.run(ask)
    except (RobotError, CommandError):
        return []
    return found
