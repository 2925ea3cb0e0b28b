"""`rwt hub`: hub for robots behind a NAT, each reachable under its own path."""

from __future__ import annotations

import argparse
import logging
import os
import re
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from pathlib import Path
from typing import NamedTuple

import anyio

from rwt.access.audit import bounded_log
from rwt.access.origins import is_loopback_listener
from rwt.access.settings import SettingsError, TlsSettings
from rwt.cli.console.logs import add_log_options, log_to_stderr
from rwt.cli.errors import CommandError
from rwt.cli.verbs import integer_within
from rwt.extensions.hub.ends import ADDRESS_BYTES
from rwt.extensions.hub.hub import MAX_ROBOTS, Hub, open_hub
from rwt.signals import HANGUP, STOP_SIGNALS, on_signals, terminal_is_gone
from rwt.tls.tls import client_tls, renew_server_tls, server_tls
from rwt_graph.errors import ZenohError
from rwt_transports.drivers.sockets import raise_descriptor_limit
from rwt_transports.errors import TransportError
from rwt_transports.http.proxies import PROXY_HEADERS, Proxies
from rwt_transports.limits import Limits

logger = logging.getLogger("rwt.cli.hub")

TOKEN_VARIABLE = "ROBOT_HUB_TOKEN"
"""Has no prefix `RWT_`, which marks settings of a server."""

_TOKEN = re.compile(r"(?:[A-Za-z0-9][A-Za-z0-9_.-]{0,63}=)?[A-Za-z0-9._~-]{16,256}")
_KIB = 1024
_LIMITS = Limits()
_EXAMPLES = f"""\
examples:
  rwt hub --token 0123456789abcdef                         try it on this machine
  rwt hub wss://0.0.0.0:443 --certfile cert.pem --keyfile key.pem --token-file hub.token
  {TOKEN_VARIABLE}=… rwt hub ws://0.0.0.0:9090                behind a proxy that does TLS
a robot then dials in:
  rwt serve --dial wss://HUB/robots/NAME --set dial.token=TOKEN
and clients connect to wss://HUB/NAME
several nodes on this machine:
  rwt hub ws://127.0.0.1:9090 --cluster-listen tcp/127.0.0.1:7447
  rwt hub ws://127.0.0.1:9091 --cluster tcp/127.0.0.1:7447
"""


_LOCAL_ENDPOINT = re.compile(r"\w+/(127\.\d+\.\d+\.\d+|\[::1\]|localhost):|unixsock-stream/")


class Cluster(NamedTuple):
    """Other nodes.

    Attributes:
        listen: Zenoh endpoints of this node.
        connect: Zenoh endpoints of others.
        config: Zenoh configuration.
        url: where the others dial in; None for the URL on which the hub listens.
        cafile: authority of their certificates; None for those of the system.
        links: maximum number of their robots that are served here at a time.
    """

    listen: tuple[str, ...]
    connect: tuple[str, ...]
    config: Path | None
    url: str | None
    cafile: Path | None
    links: int

    def opened(self, hub: Hub, limits: Limits) -> AbstractAsyncContextManager[object]:
        """Make the hub one of several nodes within a block."""
        try:
            from rwt.extensions.hub.nodes.directory import open_directory
        except ImportError as error:
            raise CommandError(
                f"several nodes need {error.name}, which is not installed: pip install"
                " 'robot-web-tools[zenoh]'"
            ) from error
        return open_directory(
            hub,
            self.url or hub.url,
            listen=self.listen,
            connect=self.connect,
            config=self.config,
            limits=limits,
            tls=client_tls(self.cafile),
            max_links=self.links,
        )


def add_hub_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `hub` to the command line."""
    parser = commands.add_parser(
        "hub",
        description=__doc__,
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "url",
        nargs="?",
        default="ws://127.0.0.1:9090",
        metavar="URL",
        help="where to listen, ws:// or wss:// (default ws://127.0.0.1:9090; port 0 picks one)",
    )
    parser.add_argument(
        "--token",
        action="append",
        default=[],
        metavar="TOKEN",
        help="accept robots with this token (16 to 256 of A-Z a-z 0-9 - . _ ~); NAME=TOKEN is required from,"
        " and only valid for, the robot NAME; several may be given",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help=f"file with a token on each line (or ${TOKEN_VARIABLE})",
    )
    parser.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="NAME",
        help="name by which clients address the hub, a glob; on a loopback address others are refused",
    )
    parser.add_argument("--certfile", type=Path, metavar="FILE", help="certificate for wss://, PEM")
    parser.add_argument("--keyfile", type=Path, metavar="FILE", help="its private key, PEM")
    parser.add_argument(
        "--proxy",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="address or network of a reverse proxy that names its clients; several may be given",
    )
    parser.add_argument(
        "--proxy-header",
        action="append",
        default=[],
        metavar="NAME",
        help="header that the proxies write themselves, for example x-forwarded-prefix; several may be given"
        f" (default {', '.join(PROXY_HEADERS)}); others are ignored",
    )
    _add_nodes(parser)
    _add_bounds(parser)
    parser.add_argument("--access-log", action="store_true", help="log each HTTP request")
    add_log_options(parser)
    parser.set_defaults(run=_run)


def _add_nodes(parser: argparse.ArgumentParser) -> None:
    nodes = parser.add_argument_group("several nodes", "a robot and its clients may connect to any of them")
    nodes.add_argument(
        "--cluster",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help="Zenoh endpoint of another node, such as tls/node-a:7447; several may be given",
    )
    nodes.add_argument(
        "--cluster-listen",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help="Zenoh endpoint for other nodes, such as tls/0.0.0.0:7447",
    )
    nodes.add_argument(
        "--cluster-config",
        type=Path,
        metavar="FILE",
        help="Zenoh configuration (JSON5), such as certificates; required for endpoints beyond this machine",
    )
    nodes.add_argument(
        "--node-url",
        metavar="URL",
        help="ws:// or wss:// URL of this node for the others (default: the URL on which it listens)",
    )
    nodes.add_argument(
        "--node-cafile", type=Path, metavar="FILE", help="authority of the other nodes' certificates, PEM"
    )


def _add_bounds(parser: argparse.ArgumentParser) -> None:
    for option, metavar, least, most, default, help in (
        ("--robots", "COUNT", 1, 1_000_000, MAX_ROBOTS, "robots that have dialled in"),
        ("--links", "COUNT", 1, 65_536, 1024, "robots of other nodes that are served here at a time"),
        ("--connections", "COUNT", 1, 1_000_000, _LIMITS.connections,
         "open connections of clients, including plain HTTP, which the addresses share"),
        ("--connections-per-address", "COUNT", 0, 1_000_000, _LIMITS.connections_per_address,
         "connections of clients per address, other than this machine; 0 for no limit"),
        ("--message-bytes", "BYTES", _KIB, 1 << 30, _LIMITS.message_bytes,
         "largest message in either direction"),
        ("--waiting-bytes", "BYTES", _KIB, 1 << 40, ADDRESS_BYTES,
         ("bytes that may wait for clients of one address, or for their robots, before the connection that"
          " has waited for longest is ended; all addresses together share four times as many")),
    ):  # fmt: skip
        kind = integer_within(least, most)
        help = f"{help} (default {default})"
        parser.add_argument(option, type=kind, default=default, metavar=metavar, help=help)


def _run(arguments: argparse.Namespace) -> int:
    log_to_stderr(arguments.log_format, verbose=arguments.verbose)
    if not arguments.url.lower().startswith(("ws://", "wss://")):
        raise CommandError(
            f"a hub cannot listen on {arguments.url!r}: expected ws:// or wss://, for example "
            "ws://127.0.0.1:9090",
            exit_code=2,
        )
    tokens = _tokens(arguments)
    if not tokens and not is_loopback_listener(arguments.url):
        raise CommandError(
            "a hub that others can reach requires a token, or anyone could pose as a robot: --token, "
            f"--token-file or {TOKEN_VARIABLE}",
            exit_code=2,
        )
    cluster = _cluster(arguments)
    raise_descriptor_limit()
    try:
        anyio.run(_serve, arguments, tokens, _tls(arguments), cluster)
    except (TransportError, ZenohError) as error:
        raise CommandError(str(error)) from error
    except SettingsError as error:
        raise CommandError(str(error), exit_code=2) from error
    return 0


def _tokens(arguments: argparse.Namespace) -> tuple[str, ...]:
    tokens: list[str] = [*arguments.token, *filter(None, [os.environ.get(TOKEN_VARIABLE)])]
    if arguments.token_file is not None:
        try:
            tokens += arguments.token_file.read_text(encoding="utf-8").split()
        except (OSError, UnicodeDecodeError) as error:
            raise CommandError(f"--token-file {arguments.token_file}: cannot be read: {error}", 2) from error
    for token in tokens:
        if _TOKEN.fullmatch(token) is None:
            # The error omits the token, which would remain in a terminal or log.
            raise CommandError(
                "a token is 16 to 256 of the characters A-Z a-z 0-9 - . _ ~, or NAME=TOKEN", exit_code=2
            )
    return tuple(tokens)


def _cluster(arguments: argparse.Namespace) -> Cluster | None:
    """Return how to reach other nodes; None for a hub of one."""
    endpoints: list[str] = [*arguments.cluster, *arguments.cluster_listen]
    config: Path | None = arguments.cluster_config
    if not endpoints and config is None:
        if arguments.node_url or arguments.node_cafile:
            raise CommandError("expected --cluster or --cluster-listen with --node-url", exit_code=2)
        return None
    if config is None and not all(_LOCAL_ENDPOINT.match(endpoint) for endpoint in endpoints):
        raise CommandError(
            "nodes trust each other, so endpoints beyond this machine require --cluster-config with"
            " certificates of the nodes (docs/how-to/behind-nat.md shows one)",
            exit_code=2,
        )
    url = arguments.node_url
    if url is None and re.search(r"//(0\.0\.0\.0|\[::\]|\*)", arguments.url):
        raise CommandError(
            f"other nodes cannot reach this one at {arguments.url}: --node-url wss://HOST:PORT", exit_code=2
        )
    listen, connect = tuple(arguments.cluster_listen), tuple(arguments.cluster)
    return Cluster(listen, connect, config, url, arguments.node_cafile, arguments.links)


def _tls(arguments: argparse.Namespace) -> TlsSettings:
    if (arguments.certfile is None) != (arguments.keyfile is None):
        raise CommandError("expected --certfile and --keyfile together", exit_code=2)
    return TlsSettings(certfile=arguments.certfile, keyfile=arguments.keyfile)


async def _serve(
    arguments: argparse.Namespace, tokens: tuple[str, ...], tls: TlsSettings, cluster: Cluster | None
) -> None:
    stop = anyio.Event()
    try:
        proxies = Proxies(arguments.proxy, arguments.proxy_header or PROXY_HEADERS)
    except ValueError as error:
        raise CommandError(f"--proxy or --proxy-header: {error}", exit_code=2) from None
    context = server_tls(tls)
    limits = Limits(
        connections=arguments.connections,
        connections_per_address=arguments.connections_per_address,
        message_bytes=arguments.message_bytes,
        incoming_bytes=arguments.waiting_bytes,
    )
    opened = open_hub(
        arguments.url,
        tokens=tokens,
        limits=limits,
        waiting_bytes=arguments.waiting_bytes,
        max_robots=arguments.robots,
        tls=context,
        hosts=arguments.host,
        proxies=proxies,
        access_log=arguments.access_log,
    )
    async with opened as hub, AsyncExitStack() as stack:
        if cluster is not None:
            await stack.enter_async_context(cluster.opened(hub, limits))

        def reload() -> None:
            """Reload tokens and certificate; if one is invalid, keep all of them."""
            try:
                again = _tokens(arguments)
                if tokens and not again:
                    raise CommandError("no token is left, and this hub has required one since its start")
                if context is not None:
                    renew_server_tls(context, tls)
            except (CommandError, SettingsError) as error:
                logger.error("tokens and certificate stay as they were: %s", error)
                return
            hub.take_tokens(again)
            logger.info("tokens and certificate were read again from their files")
            if arguments.token or os.environ.get(TOKEN_VARIABLE):
                logger.warning("not read again: --token and %s, which only a restart changes", TOKEN_VARIABLE)

        handlers: dict[int, Callable[[], object]] = dict.fromkeys(STOP_SIGNALS, stop.set)
        if HANGUP is not None:
            handlers[HANGUP] = lambda: stop.set() if terminal_is_gone() else reload()
        with on_signals(handlers), bounded_log():
            print(f"listening on {hub.url}", flush=True)
            proxies.log()
            await stop.wait()
