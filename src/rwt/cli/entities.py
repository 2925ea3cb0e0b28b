"""Table of the entities of a robot's graph, and the verbs that they share: list, info, type and find.

A row says how the entities of one kind are looked up. Each verb is implemented once, for all rows.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypeVar

from rwt.cli.console.output import Output
from rwt.cli.errors import FAILED, CommandError
from rwt.cli.verbs import AddArguments, Arguments, Verb, argument, arguments, flag, gather
from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import two_part
from rwt_participant.errors import ProviderNotFound, ServiceFailed
from rwt_participant.spelling import did_you_mean

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_client.rosapi import NodeDetails
    from rwt_participant.api import Listed


Named: TypeAlias = "list[tuple[str, str]]"
"""Names with their types, sorted."""

ShowVerbose: TypeAlias = "Callable[[Robot, Named, Output], Awaitable[None]]"
AskInfo: TypeAlias = "Callable[[Robot, str, Arguments], Awaitable[dict[str, Any]]]"
ShowInfo: TypeAlias = Callable[[dict[str, Any], Arguments, Output], None]


T = TypeVar("T")

NO_ROSAPI = "rosapi does not answer: it is missing on the robot, or rejects the question"


def absolute_name(name: str) -> str:
    """Return the absolute form of a name: `/odom` for `odom`."""
    return name if name.startswith("/") else f"/{name}"


def is_hidden(name: str) -> bool:
    """True if ROS 2 hides the name: a part of it begins with ``_``."""
    return any(part.startswith("_") for part in name.split("/"))


_PLUMBING: Final = re.compile(
    r"/(tf2_web_republisher|whip)/"
    r"|/((describe|get|list|set)_parameters|get_parameter_types|set_parameters_atomically)\Z"
)
"""Topics and services of the server's own nodes, and the services for parameters that every node has."""


def is_listed(name: str) -> bool:
    """True if lists have the name without an option: it is neither hidden nor plumbing."""
    return not is_hidden(name) and _PLUMBING.search(name) is None


def same_type(one: str, other: str) -> bool:
    """True if two spellings name one type: ``std_msgs/String`` is ``std_msgs/msg/String``."""
    try:
        return two_part(one) == two_part(other)
    except InvalidName:
        return one == other


def unknown(what: str, name: str, known: Iterable[str]) -> CommandError:
    """Return the error for an unknown name, with the nearest known one."""
    return CommandError(f"the robot knows no {what} {name}{did_you_mean(name, known)}", FAILED)


async def all_nodes(robot: Robot) -> list[NodeDetails]:
    """Ask for all nodes with their topics and services."""
    return await gather([partial(robot.api.node, name) for name in await ask_rosapi(robot.api.nodes)])


async def ask_rosapi(question: Callable[[], Awaitable[T]]) -> T:
    """Return an answer of rosapi.

    Raises:
        CommandError: rosapi is missing or rejects the question.
    """
    try:
        return await question()
    except (ServiceFailed, ProviderNotFound) as error:
        raise CommandError(f"{NO_ROSAPI}: {error}", FAILED) from error


@dataclass(frozen=True, slots=True)
class Entity:
    """A kind of named things in a robot's graph.

    Attributes:
        noun: name of the kind, and of its command.
        example: name in the demo robot, for the help.
        example_type: type of the example; empty if things of this kind have no types.
        listed: asks for all names, or for all topics with their types.
        type_of: asks for the type of one name, where the answer of `listed` has no types.
        hidden_options: options that include hidden names; empty if no name of this kind is hidden.
    """

    noun: str
    example: str
    example_type: str
    listed: Callable[[Robot], Awaitable[Sequence[str] | Sequence[Listed]]]
    type_of: Callable[[Robot, str], Awaitable[str]] | None = None
    hidden_options: tuple[str, ...] = ()

    async def names(self, robot: Robot) -> dict[str, str]:
        """Ask for all names, with their types where the answer has these."""
        listed = await self.listed(robot)
        return dict((each, "") if isinstance(each, str) else (each.name, each.type) for each in listed)

    async def known(self, robot: Robot, name: str) -> str:
        """Return the type of an entity that exists.

        Raises:
            CommandError: there is no such entity (names the nearest one), or its type is unknown.
        """
        failure = f"the robot does not know the type of {name} yet: add the type to the command"
        if self.type_of is not None:
            try:
                if kind := await self.type_of(robot, name):
                    return kind
            except (ServiceFailed, ProviderNotFound) as error:  # Some rosapi answer so for unknown names.
                failure = f"{NO_ROSAPI}: {error}"
        names = await ask_rosapi(lambda: self.names(robot))
        if name not in names:
            raise unknown(self.noun, name, names)
        if self.example_type and not names[name]:
            raise CommandError(failure, FAILED)
        return names[name]

    async def found(self, robot: Robot, *, hidden: bool = False, types: bool = True) -> Named:
        """Return the entities with their types, sorted by name.

        Args:
            hidden: include names that ROS 2 hides, and the plumbing of nodes.
            types: ask for types that the answer to the names lacks.
        """
        names = await ask_rosapi(lambda: self.names(robot))
        shown = [name for name in sorted(names) if hidden or not self.hidden_options or is_listed(name)]
        if not types or self.type_of is None:
            return [(name, names[name]) for name in shown]
        kinds = await gather([partial(self.type_of, robot, name) for name in shown])
        return list(zip(shown, kinds, strict=True))

    def add_argument(self, parser: argparse.ArgumentParser) -> None:
        """Add the argument for a name."""
        parser.add_argument(self.noun, metavar=self.noun.upper(), help=f"for example {self.example}")

    def list_verb(self, show_verbose: ShowVerbose | None = None, verbose_json: str = "") -> Verb:
        """Return the verb that lists names.

        Args:
            show_verbose: prints the list where ``--verbose`` is given; None for no such option.
            verbose_json: what it prints with ``--json``, for the help.
        """
        typed = bool(self.example_type)

        def add_arguments(parser: argparse.ArgumentParser) -> None:
            if typed:
                flag("-t", "--show-types", help=f"show the type of each {self.noun}")(parser)
            self._add_count(parser)
            if show_verbose:
                help = "show types and the numbers of publishers and subscribers"
                flag("-v", "--verbose", help=help)(parser)
            self._add_hidden(parser)

        async def run(robot: Robot, arguments: Arguments, output: Output) -> None:
            types = typed and not arguments.count and (arguments.show_types or output.json)
            found = await self.found(robot, hidden=arguments.hidden, types=types)
            if arguments.count or not typed:
                _print_names(found, output, only_count=arguments.count)
            elif show_verbose and arguments.verbose:
                await show_verbose(robot, found, output)
            elif output.json:
                output.record(names_and_types(found))
            elif types and output.people:
                output.columns(found, ("name", "type"))
            elif types:
                for name, kind in found:
                    output.line(f"{output.styled(name, 'name')} [{output.escape_terminal(kind)}]")
            else:
                _print_names(found, output)

        shape = self._typed_example if typed else f'"{self.example}"'
        example = f"rwt {self.noun} list{' -t' if typed else ''}"
        json = f'[{shape}, …];{verbose_json} with -c {{"count": …}}'
        return Verb("list", run, add_arguments, text=_help(f"List the {self.noun}s.", example, json))

    def type_verb(self) -> Verb:
        """Return the verb that prints a type."""

        async def run(robot: Robot, arguments: Arguments, output: Output) -> None:
            name = absolute_name(getattr(arguments, self.noun))
            kind = await self.known(robot, name)
            output.answer({"name": name, "type": kind}, output.styled(kind, "type"))

        help = f"Print {'an' if self.noun[0] in 'aeiou' else 'a'} {self.noun}'s type."
        text = _help(help, f"rwt {self.noun} type {self.example}", self._typed_example)
        return Verb("type", run, self.add_argument, text=text)

    def find_verb(self) -> Verb:
        """Return the verb that lists the names of a type."""

        async def run(robot: Robot, arguments: Arguments, output: Output) -> None:
            found = await self.found(robot, hidden=arguments.hidden)
            found = [(name, kind) for name, kind in found if same_type(kind, arguments.type)]
            _print_names(found, output, only_count=arguments.count)

        example = f"rwt {self.noun} find {self.example_type}"
        json = f'["{self.example}"]; with -c {{"count": 1}}'
        kind = argument("type", metavar="TYPE", help=f"for example {self.example_type}")
        options = arguments(kind, self._add_count, self._add_hidden)
        return Verb("find", run, options, text=_help(f"List the {self.noun}s of a type.", example, json))

    def info_verb(
        self, help: str, ask: AskInfo, show: ShowInfo, json: str, add_options: AddArguments
    ) -> Verb:
        """Return the verb that prints what is known about one entity.

        Args:
            help: what it prints, as a sentence.
            ask: asks the robot; the answer follows name and type in the output of ``--json``.
            show: prints all of it for people.
            json: what ``--json`` prints, for the help.
            add_options: adds options of its own.
        """

        async def run(robot: Robot, arguments: Arguments, output: Output) -> None:
            name = absolute_name(getattr(arguments, self.noun))
            kind = await self.known(robot, name)
            typed = {"type": kind} if self.example_type else {}
            found = {"name": name, **typed, **await ask(robot, name, arguments)}
            if output.json:
                output.record(found)
            else:
                show(found, arguments, output)

        options = arguments(self.add_argument, add_options)
        text = _help(help, f"rwt {self.noun} info {self.example}", json)
        return Verb("info", run, options, text=text)

    @property
    def _typed_example(self) -> str:
        return f'{{"name": "{self.example}", "type": "{self.example_type}"}}'

    def _add_count(self, parser: argparse.ArgumentParser) -> None:
        option = f"--count-{self.noun}s"
        parser.add_argument("-c", option, dest="count", action="store_true", help="only print the count")

    def _add_hidden(self, parser: argparse.ArgumentParser) -> None:
        if not self.hidden_options:
            parser.set_defaults(hidden=False)
            return
        help = f"include {self.noun}s with a name part that begins with `_`"
        if self is not NODE:
            help += ", those of `/tf2_web_republisher` and `/whip`, and services for parameters"
        parser.add_argument(*self.hidden_options, dest="hidden", action="store_true", help=help)


def _help(sentence: str, example: str, json: str) -> str:
    """Return the help of a verb of all entities, see :class:`rwt.cli.verbs.Verb`."""
    shape = json.replace("\n", "\n  ")
    return f"{sentence}\n\nexample:\n  {example}\n\n--json prints:\n  {shape}"


def names_and_types(found: Iterable[tuple[str, str]]) -> list[dict[str, str]]:
    """Return names with their types as ``--json`` prints them."""
    return [{"name": name, "type": kind} for name, kind in found]


def _print_names(found: Sequence[tuple[str, str]], output: Output, *, only_count: bool = False) -> None:
    if only_count:
        output.answer({"count": len(found)}, str(len(found)))
    else:
        output.names([name for name, _ in found], "name")


TOPIC: Final = Entity(
    "topic",
    "/odom",
    "nav_msgs/msg/Odometry",
    lambda robot: robot.api.topics(),
    None,
    ("--include-hidden-topics",),
)
SERVICE: Final = Entity(
    "service",
    "/add_two_ints",
    "example_interfaces/srv/AddTwoInts",
    lambda robot: robot.api.services(),
    lambda robot, name: robot.api.service_type(name),
    ("--include-hidden-services",),
)
ACTION: Final = Entity(
    "action",
    "/fibonacci",
    "example_interfaces/action/Fibonacci",
    lambda robot: robot.api.action_servers(),
    lambda robot, name: robot.api.action_type(name),
)
NODE: Final = Entity(
    "node", "/demo_robot", "", lambda robot: robot.api.nodes(), hidden_options=("-a", "--all")
)
