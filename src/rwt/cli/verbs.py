"""Shared parts of the verbs that talk to a robot: options, connection, errors.

A family of verbs (`rwt topic …`) is one module with a tuple of :class:`Verb`, and a row in
:data:`rwt.cli.COMMANDS`.
"""

from __future__ import annotations

import argparse
import inspect
import itertools
import logging
import math
import os
from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import anyio

from rwt.cli.console.output import Output, log_notes, standard_output
from rwt.cli.errors import CALLED_WRONGLY, CANNOT_CONNECT, FAILED, TIMED_OUT, CommandError, cannot_read
from rwt.cli.parser import Commands, add_commands
from rwt_participant.errors import InvalidMessage, RobotError, TimedOut, TransformUnavailable

if TYPE_CHECKING:
    import ssl

    from rwt_client import ConnectionEvent, Robot

DEFAULT_URL: Final = "ws://127.0.0.1:9090"
URL_VARIABLE: Final = "RWT_URL"
TOKEN_VARIABLE: Final = "RWT_TOKEN"
USUAL_TIMEOUT: Final = 10.0
"""Default of ``--timeout``: seconds for connecting and for each answer."""

_MIN_SECONDS: Final = 1e-6
_MAX_SECONDS: Final = 1e9
"""Range of options in seconds that timers support; the minimum applies to frequencies, too."""

_MAX_CONCURRENT: Final = 16

T = TypeVar("T")

Arguments = argparse.Namespace
AddArguments = Callable[[argparse.ArgumentParser], object]


def arguments(*adders: AddArguments) -> AddArguments:
    """Return a function that adds several arguments to a parser."""

    def add(parser: argparse.ArgumentParser) -> None:
        for adder in adders:
            adder(parser)

    return add


def argument(*names: str, **keywords: Any) -> AddArguments:
    """Return a function that adds one argument, as :meth:`argparse.ArgumentParser.add_argument` does."""
    return lambda parser: parser.add_argument(*names, **keywords)


def flag(*names: str, help: str) -> AddArguments:
    """Return a function that adds one option without a value."""
    return argument(*names, action="store_true", help=help)


JSON_OPTION: Final = flag("--json", help="print JSON")


@dataclass(frozen=True, slots=True)
class Verb:
    """Verb of a command, such as `list` of `rwt topic`.

    Attributes:
        run: the verb; its docstring is the help: a sentence, which also stands in the help of the family,
            then the lines under ``example:`` and ``--json prints:``.
        definitions: fetch the definitions of the robot's topics when connecting.
        until_interrupted: run until Ctrl-C, which then exits with 0, and reconnect after a lost connection.
        text: help in place of the docstring.
    """

    name: str
    run: Callable[[Robot, Arguments, Output], Awaitable[None]]
    add_arguments: AddArguments = lambda parser: None
    definitions: bool = False
    until_interrupted: bool = False
    text: str = ""


@dataclass(frozen=True, slots=True)
class LocalVerb:
    """Verb that works on files, or asks a robot only if its options say so.

    Attributes:
        run: the verb, with its help as that of :class:`Verb`; returns the exit code, None for success.
        add_arguments: adds all options, ``--json`` included.
    """

    name: str
    run: Callable[[Arguments, Output], int | None]
    add_arguments: AddArguments


def add_family(
    commands: Commands, name: str, description: str, verbs: Sequence[Verb | LocalVerb]
) -> Commands:
    """Add a command with verbs, and return the object to which further verbs are added."""
    family = commands.add_parser(name, description=description)
    added = add_commands(family)
    for verb in verbs:
        add_verb(added, verb)
    return added


def add_verb(commands: Commands, verb: Verb | LocalVerb) -> None:
    """Add a verb to a family, or as a command of its own."""
    # Without docstrings (`python -OO`) only the name is left.
    text = (verb.text if isinstance(verb, Verb) else "") or verb.run.__doc__ or verb.name
    description, example, end = inspect.cleandoc(text).partition("\n\nexample:")
    help = description.partition("\n")[0].removesuffix(".")
    parser = commands.add_parser(
        verb.name,
        help=f"{help[:1].lower()}{help[1:]}",
        description=description,
        epilog=f"{example.strip()}{end}",
    )
    verb.add_arguments(parser)
    if isinstance(verb, LocalVerb):
        parser.set_defaults(run=partial(_run_locally, verb))
    else:
        add_robot_options(parser)
        parser.set_defaults(run=partial(_run, verb))


def add_robot_options(parser: argparse.ArgumentParser, *, json: bool = True) -> None:
    """Add the options of all verbs that talk to a robot, with ``--json`` if `json` is true."""
    group = parser.add_argument_group("the robot")
    group.add_argument(
        "--url", metavar="URL", help=f"URL of the robot (default ${URL_VARIABLE}, or {DEFAULT_URL})"
    )
    group.add_argument(
        "--token",
        metavar="TOKEN",
        help=f"bearer token to present (default ${TOKEN_VARIABLE}, which others on this machine cannot read)",
    )
    add_tls_options(group)
    group.add_argument(
        "--timeout",
        type=seconds,
        metavar="SECONDS",
        help=f"timeout of the connection and of each answer (default {USUAL_TIMEOUT:g}; none for messages)",
    )
    if json:
        group.add_argument("--json", action="store_true", help="print JSON")


def add_tls_options(to: argparse._ActionsContainer) -> None:
    """Add the options for the verification of the server's certificate."""
    certificate = to.add_mutually_exclusive_group()
    certificate.add_argument(
        "--cafile",
        type=Path,
        metavar="FILE",
        help="verify the server's certificate against those in this PEM file (default: the system's)",
    )
    certificate.add_argument(
        "--insecure",
        action="store_true",
        help="do not verify the server's certificate (insecure: traffic can be read and changed)",
    )


def number_within(what: str, least: float, most: float) -> Callable[[str], float]:
    """Return a parser of option values that are numbers in a range.

    Args:
        what: unit of the number, for error messages.
    """

    def read(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not least <= number <= most:
            raise argparse.ArgumentTypeError(f"expected {what} from {least:g} to {most:g}, got {text!r}")
        return number

    return read


seconds: Final = number_within("seconds", _MIN_SECONDS, _MAX_SECONDS)
"""Parser of option values in seconds: from a microsecond to thirty years."""

seconds_or_none: Final = number_within("seconds", 0.0, _MAX_SECONDS)
"""Parser of option values in seconds, including 0."""

hertz: Final = number_within("times a second", _MIN_SECONDS, 1e6)
"""Parser of option values in Hz: up to a million, and as slow as a timer supports."""


def topic_glob(text: str) -> str:
    """Parse a topic pattern. Reject URLs, which options with several patterns would consume."""
    if "://" in text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a topic pattern: put the URL before options that take several patterns"
        )
    return text


def add_globs(parser: argparse.ArgumentParser, option: str, help: str) -> None:
    """Add an option that takes several topic patterns."""
    parser.add_argument(
        option, nargs="+", action="extend", default=[], type=topic_glob, metavar="GLOB", help=help
    )


def integer_within(least: int, most: int) -> Callable[[str], int]:
    """Return a parser of option values that are integers in a range."""

    def read(text: str) -> int:
        if text.isascii() and text.isdecimal() and len(text) < 20 and least <= int(text) <= most:
            return int(text)
        raise argparse.ArgumentTypeError(f"expected a whole number from {least} to {most}, got {text!r:.40}")

    return read


count: Final = integer_within(1, 999_999_999)
"""Parser of positive integers."""

count_or_none: Final = integer_within(0, 999_999_999)
"""Parser of non-negative integers."""


def add_times(parser: argparse.ArgumentParser, once: str, times: str) -> None:
    """Add the options ``--once`` and ``--times``, both as `arguments.times`, with their help."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--once", action="store_const", const=1, dest="times", help=once)
    group.add_argument("-n", "--times", type=count, metavar="N", help=times)


def rounds(times: int | None) -> Iterable[int]:
    """Count from 1 to `times`; without end if it is None."""
    return itertools.count(1) if times is None else range(1, times + 1)


def url_of(arguments: Arguments) -> str:
    """Return the URL of the robot."""
    return arguments.url or os.environ.get(URL_VARIABLE) or DEFAULT_URL


def token_of(arguments: Arguments) -> str:
    """Return the bearer token; empty for none."""
    return arguments.token or os.environ.get(TOKEN_VARIABLE, "")


def request_headers(arguments: Arguments) -> dict[str, str]:
    """Return the headers of the connection request.

    Raises:
        CommandError: the transport cannot carry the token, or the token is malformed.
    """
    token = token_of(arguments)
    if not token:
        return {}
    from rwt_transports.schemes import scheme_of  # slow import that `--help` does not need

    scheme = scheme_of(url_of(arguments))
    if scheme is None or not scheme.http:
        raise CommandError(
            "tokens require ws:// or wss://: other transports cannot carry them", CALLED_WRONGLY
        )
    if not (token.isascii() and token.isprintable()) or " " in token:
        raise CommandError("the token contains invalid characters: was it copied completely?", CALLED_WRONGLY)
    return {"Authorization": f"Bearer {token}"}


def tls_of(arguments: Arguments) -> ssl.SSLContext | None:
    """Return the TLS context of the options; None to verify against the system's authorities.

    Raises:
        CommandError: the URL is not encrypted, or the file has no certificates.
    """
    if arguments.cafile is None and not arguments.insecure:
        return None
    import ssl  # slow import that few commands need

    from rwt_transports.schemes import scheme_of

    scheme = scheme_of(url_of(arguments))
    if scheme is None or not scheme.tls:
        raise CommandError("--cafile and --insecure require a wss:// or tcps:// URL", CALLED_WRONGLY)
    try:
        context = ssl.create_default_context(cafile=arguments.cafile)
    except ssl.SSLError as error:
        why = f"--cafile: {arguments.cafile}: expected certificates in PEM"
        raise CommandError(why, CALLED_WRONGLY) from error
    except OSError as error:
        raise cannot_read(f"--cafile: {arguments.cafile}", error) from error
    if arguments.insecure:
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
    return context


def connecting(
    arguments: Arguments, *, definitions: bool = False, until_interrupted: bool = False
) -> AbstractAsyncContextManager[Robot]:
    """Connect to the robot that the options name.

    Args:
        definitions: fetch the definitions of the topics, which take precedence over the standard ones.
        until_interrupted: reconnect when the connection is lost.
    """
    from rwt_client import connect  # slow import that `--help` does not need
    from rwt_client.connection import RECONNECT

    return connect(
        url_of(arguments),
        timeout=arguments.timeout or USUAL_TIMEOUT,
        reconnect=RECONNECT if until_interrupted else None,
        fetch_types=definitions,
        headers=request_headers(arguments),
        tls=tls_of(arguments),
    )


def run_async(program: Callable[[], Awaitable[T]]) -> T:
    """Run a coroutine function to its end, and return its result.

    Raises:
        CommandError: the coroutine raised :exc:`RobotError`; has its text and an exit code.
    """
    try:
        return anyio.run(program)
    except RobotError as error:
        raise command_error(error) from error


def _run_locally(verb: LocalVerb, arguments: Arguments) -> int:
    return verb.run(arguments, standard_output(json=arguments.json)) or 0


def _run(verb: Verb, arguments: Arguments) -> int:
    log_notes("rwt: %(message)s")
    output = standard_output(json=arguments.json)

    async def program() -> None:
        async with connecting(
            arguments, definitions=verb.definitions, until_interrupted=verb.until_interrupted
        ) as robot:
            if verb.until_interrupted:
                robot.on_event(_log_connection)
            await verb.run(robot, arguments, output)

    try:
        run_async(program)
    except KeyboardInterrupt:
        if not verb.until_interrupted:
            raise
    return 0


def _log_connection(event: ConnectionEvent) -> None:
    if event.kind == "lost":
        logging.getLogger("rwt").warning("%s; reconnecting", event.text or "the connection was lost")
    elif event.kind == "restored":
        logging.getLogger("rwt").warning("reconnected")


def command_error(error: RobotError) -> CommandError:
    """Convert an error of the client to one with an exit code."""
    from rwt_client import BadAddress, ConnectionLost

    if isinstance(error, BadAddress | InvalidMessage):
        code = CALLED_WRONGLY
    elif isinstance(error, ConnectionLost):
        code = CANNOT_CONNECT
    else:
        code = TIMED_OUT if isinstance(error, TimedOut | TransformUnavailable) else FAILED
    return CommandError(str(error), code)


async def gather(questions: Sequence[Callable[[], Awaitable[T]]]) -> list[T]:
    """Run coroutine functions concurrently, at most 16 at a time, and return their results in order.

    Raises:
        RobotError: the first error, if any of them failed.
    """
    answers: dict[int, T] = {}
    failures: list[RobotError] = []
    few = anyio.Semaphore(_MAX_CONCURRENT)

    async def ask(index: int, question: Callable[[], Awaitable[T]]) -> None:
        async with few:
            try:
                answers[index] = await question()
            except RobotError as error:
                failures.append(error)

    async with anyio.create_task_group() as tasks:
        for index, question in enumerate(questions):
            tasks.start_soon(ask, index, question)
    if failures:
        raise failures[0]
    return [answers[index] for index in range(len(questions))]
