"""`rwt mcp`: MCP server for one agent on standard input and output."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import anyio.to_thread

from rwt.access.audit import one_line
from rwt.cli.console.logs import add_log_options, log_to_stderr
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, add_robot_options, connecting, run_async
from rwt.observability.build import version

if TYPE_CHECKING:
    from mcp.server.context import ServerRequestContext

    from rwt.extensions.mcp.agent import Act, Agent, Allow
    from rwt.extensions.mcp.settings import McpSettings
    from rwt_client import ConnectionEvent, Robot

#: Start of status messages of a robot's gate.
_OF_GATE: Final = "gate: "

_EXAMPLES: Final = """\
examples:
  rwt mcp --robot ws://robot:9090                     read-only
  rwt mcp --robot ws://robot:9090 --act               drive, call, set: what the robot's server allows
  RWT_TOKEN=… rwt mcp --robot wss://robot.example.com --act --confirm '*'
the agent starts it, and uses the Model Context Protocol on standard input and output:
  {"mcpServers": {"robot": {"command": "rwt", "args": ["mcp", "--robot", "ws://robot:9090"]}}}
requires the extra `mcp`"""


def add_mcp_command(commands: Commands) -> None:
    """Add `mcp` to the command line."""
    parser = commands.add_parser(
        "mcp",
        description="Give an agent tools, resources and prompts for a robot, over standard input and output."
        ' A server with `gateways = ["mcp"]` offers them at /mcp.',
        epilog=_EXAMPLES,
    )
    add_robot_options(parser, json=False)
    parser.add_argument("--robot", dest="url", metavar="URL", help="URL of the robot, like --url")
    parser.add_argument(
        "--act",
        action="store_true",
        help="also offer tools that change the robot, as far as its server allows",
    )
    parser.add_argument(
        "--confirm",
        action="append",
        default=[],
        metavar="GLOB",
        help="topics, services, actions and parameters that require confirmation by the user of the agent;"
        " several may be given",
    )
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", help="folder of recordings to offer")
    add_log_options(parser)
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    log_to_stderr(arguments.log_format, verbose=arguments.verbose)
    try:
        from mcp.server.stdio import stdio_server
    except ModuleNotFoundError as error:
        raise CommandError(
            f"this needs {error.name}, which is not installed: pip install 'robot-web-tools[mcp]'"
        ) from None

    from pydantic import ValidationError

    from rwt.extensions.mcp.server import make_server
    from rwt.extensions.mcp.settings import McpSettings

    try:
        settings = McpSettings(confirm=tuple(arguments.confirm), recordings=arguments.recordings)
    except ValidationError as error:
        raise CommandError(str(error), CALLED_WRONGLY) from None

    async def program() -> None:
        async with connecting(arguments, definitions=True, until_interrupted=True) as robot:
            server = make_server(CommandHost(robot, settings, acts=arguments.act), version())
            async with stdio_server() as (incoming, outgoing):
                await server.run(incoming, outgoing, server.create_initialization_options())

    run_async(program)
    return 0


class CommandHost:
    """Host of the one agent of this program."""

    def __init__(self, robot: Robot, settings: McpSettings, *, acts: bool) -> None:
        from rwt.extensions.mcp.goals import GoalTable
        from rwt.extensions.mcp.person import Questions
        from rwt.extensions.mcp.recordings import RecordingFolder

        self.questions = Questions()
        self._log = logging.getLogger("rwt.extensions.mcp.audit")
        self._robot = robot
        self.settings = settings
        every: tuple[Act, ...] = ("publish", "call", "goals", "set_param")
        self._acts: frozenset[Act] = frozenset(every) if acts else frozenset()
        self._goals = GoalTable(settings.goals)
        self._recordings = None if settings.recordings is None else RecordingFolder(settings.recordings)

    @asynccontextmanager
    async def agent(
        self, context: ServerRequestContext[Any, Any], allow: Allow | None = None, *, lasts: bool = False
    ) -> AsyncIterator[Agent]:
        """Yield the only agent."""
        from rwt.extensions.mcp.agent import Agent, note_once
        from rwt.extensions.mcp.command.checked_publisher import CheckedPublisher, take_lease

        notices: list[str] = []

        def take(event: ConnectionEvent) -> None:
            if event.kind == "status" and event.text.startswith(_OF_GATE):
                note_once(notices, event.text.removeprefix(_OF_GATE))

        end = self._robot.on_event(take)
        agent = Agent(
            owner="",
            robot=self._robot,
            settings=self.settings,
            acts=self._acts,
            goals=self._goals,
            in_thread=lambda work: anyio.to_thread.run_sync(work),
            charge=lambda seconds: None,  # The only agent has no work limit.
            sees=lambda topic: True,  # The recordings belong to the user of this program.
            how_to_act="start `rwt mcp` with --act",
            advertise=partial(CheckedPublisher, self._robot),
            lease_seconds=partial(take_lease, self._robot),
            recordings=self._recordings,
            notices=notices,
        )
        try:
            yield agent
        finally:
            end()

    def note(self, context: ServerRequestContext[Any, Any], text: str, *, acts: bool) -> None:
        """Log an act of the agent on standard error."""
        (self._log.info if acts else self._log.debug)("%s", one_line(text))

    def count(self, tool: str, outcome: str) -> None:
        """No-op: this program serves no metrics."""
