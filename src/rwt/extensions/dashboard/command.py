"""`rwt web`: the dashboard without a robot, for any rosbridge server."""

from __future__ import annotations

from pathlib import Path

import anyio

from rwt.cli.commands.serve import command_errors
from rwt.cli.console.logs import log_to_stderr
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments


def add_web_command(commands: Commands) -> None:
    """Add `web` to the command line."""
    parser = commands.add_parser(
        "web",
        description="Serve the dashboard without a robot, for any rosbridge server. The browser\n"
        "connects to the robot itself; `rwt serve` must allow the origin of the page (origins.allow).",
        epilog="example:\n  rwt web --robot ws://robot:9090",
    )
    parser.add_argument(
        "url",
        nargs="?",
        default="ws://127.0.0.1:8080",
        metavar="URL",
        help="where to listen, ws://HOST:PORT (default ws://127.0.0.1:8080; port 0 picks one)",
    )
    parser.add_argument(
        "--robot", metavar="URL", help="rosbridge server that the page connects to; without one the page asks"
    )
    parser.add_argument("--layouts", type=Path, metavar="DIR", help="folder of layouts to offer")
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    log_to_stderr("text", verbose=arguments.verbose)
    if not arguments.url.lower().startswith("ws://"):
        raise CommandError(
            f"the page cannot be served on {arguments.url!r}: expected ws://HOST:PORT", exit_code=2
        )
    with command_errors():
        anyio.run(_serve, arguments.url, arguments.robot, arguments.layouts)
    return 0


async def _serve(url: str, robot: str | None, layouts: Path | None) -> None:
    from rwt.extensions.dashboard.page_server import serve_page  # `--help` and completion need none of it.
    from rwt.signals import STOP_SIGNALS, on_signals

    stop = anyio.Event()
    with on_signals(dict.fromkeys(STOP_SIGNALS, stop.set)):
        async with serve_page(url, robot, layouts=layouts) as listener:
            address = listener.url.replace("ws", "http", 1)
            print(f"the page is at {address}/" + (f" for the robot at {robot}" if robot else ""), flush=True)
            await stop.wait()
