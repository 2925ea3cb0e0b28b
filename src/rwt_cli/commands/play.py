"""`rwt play`: serve a recording as a robot."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, aclosing, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from rwt.nodes import start_nodes
from rwt.server import serve
from rwt_access.settings import SettingsError
from rwt_cli.commands.config import add_settings_options, settings_of
from rwt_cli.console.key_presses import Key, key_presses
from rwt_cli.console.logs import log_to_stderr
from rwt_cli.errors import CommandError
from rwt_cli.verbs import topic_glob
from rwt_nodes.playback.player import FASTEST, SLOWEST
from rwt_transports.errors import TransportError

if TYPE_CHECKING:
    from rwt.settings.models import Settings
    from rwt_nodes.playback import Player, PlayOptions
    from rwt_nodes.recording import Recording

_EXAMPLES = """\
examples:
  rwt play run.mcap                             on ws://127.0.0.1:9090, at the speed it was recorded
  rwt play run.mcap ws://0.0.0.0:9090 --loop
  rwt play run.mcap --speed 4 --start 30 --end 60
  rwt play run.mcap --paused                    until /rosbag2_player/resume is called, or space is pressed
  rwt play old.bag --remap /scan:=/front/scan   bags of ROS 1 and folders of rosbag2 play too
keys, in a terminal: space pauses and resumes, right plays the next message, up and down change the speed
"""
_CLOCK_HZ = 40.0
_FASTER = 1.1


@dataclass(frozen=True, slots=True)
class _Order:
    """What is to be played."""

    settings: Settings
    options: PlayOptions
    paused: bool
    stay: bool


def add_play_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `play` to the command line."""
    parser = commands.add_parser(
        "play",
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="FILE|URL",
        help="MCAP files, .bag files or folders of rosbag2; and where to listen (default ws://127.0.0.1:9090)",
    )
    _add_time(parser)
    parser.add_argument(
        "--topics", nargs="+", action="extend", default=[], type=topic_glob, metavar="GLOB", help="only these"
    )
    parser.add_argument(
        "--exclude", nargs="+", action="extend", default=[], type=topic_glob, metavar="GLOB", help="not these"
    )
    parser.add_argument(
        "--remap", nargs="+", action="extend", default=[], type=parse_remap, metavar="OLD:=NEW",
        help="publish a topic under another name",
    )  # fmt: skip
    parser.add_argument(
        "--no-services", action="store_true", help="do not answer calls as the recorded ones were answered"
    )
    parser.add_argument(
        "--clock", nargs="?", type=float, const=_CLOCK_HZ, default=0.0, metavar="HZ",
        help=f"publish the recording's time on /clock (default rate {_CLOCK_HZ:g})",
    )  # fmt: skip
    add_settings_options(parser)
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.set_defaults(run=_run)


def _add_time(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--speed", "-r", type=float, default=1.0, metavar="RATE", help="2 is twice as fast")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="seconds from its beginning")
    parser.add_argument("--end", type=float, metavar="S", help="seconds from its beginning")
    parser.add_argument("--paused", "-p", action="store_true", help="wait to be resumed")
    parser.add_argument("--loop", "-l", action="store_true", help="begin again at the end")
    parser.add_argument(
        "--stay", action="store_true", help="go on serving what is kept when the end was reached"
    )


def parse_remap(text: str) -> tuple[str, str]:
    """The two names of `OLD:=NEW`.

    Raises:
        argparse.ArgumentTypeError: it is something else.
    """
    old, sign, new = text.partition(":=")
    if not (old and sign and new):
        raise argparse.ArgumentTypeError(f"{text!r}: expected OLD:=NEW, for example /scan:=/front/scan")
    return old, new


def _run(arguments: argparse.Namespace) -> int:
    from rwt_nodes.recording import RecordingError, open_recording

    log_to_stderr("text", verbose=arguments.verbose)
    urls = tuple(word for word in arguments.what if _is_url(word))
    files = [Path(word) for word in arguments.what if not _is_url(word)]
    if not files:
        raise CommandError(
            "expected a recording to play, for example: rwt play run.mcap; "
            "it stands before options that take several words, such as --topics",
            exit_code=2,
        )
    settings = settings_of(arguments, {"listen": urls or None}).settings
    try:
        with open_recording(files) as recording:
            anyio.run(
                _play, recording, _Order(settings, _options(arguments), arguments.paused, arguments.stay)
            )
    except (TransportError, RecordingError) as error:
        raise CommandError(str(error)) from error
    except SettingsError as error:
        raise CommandError(str(error), exit_code=2) from error
    return 0


def _is_url(word: str) -> bool:
    return "://" in word or word == "stdio:"


def _options(arguments: argparse.Namespace) -> PlayOptions:
    from rwt_nodes.playback import PlayOptions
    from rwt_nodes.recording import TopicSelection

    return PlayOptions(
        rate=arguments.speed,
        start=arguments.start,
        end=arguments.end,
        loop=arguments.loop,
        paused=True,  # Until the server is there.
        selection=TopicSelection(tuple(arguments.topics), tuple(arguments.exclude), True, True),
        remap=dict(arguments.remap),
        clock_hz=arguments.clock,
        answer_services=not arguments.no_services,
    )


async def _play(recording: Recording, order: _Order) -> None:
    from rwt_graph.memory.graph import MemoryGraph
    from rwt_interfaces.registry import Registry
    from rwt_nodes.playback import PlaybackClock, Player

    graph = MemoryGraph(Registry(recording.distro), PlaybackClock(recording.start_ns))
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals, ExitStack() as nodes:
        async with graph:
            try:
                player = nodes.enter_context(closing(Player(graph, recording, order.options)))
            except ValueError as error:
                raise CommandError(str(error), exit_code=2) from error
            http = start_nodes(graph, order.settings, nodes)
            async with serve(
                graph,
                *order.settings.listen,
                settings=order.settings,
                http=http,
            ) as server:
                _announce(server.urls, recording)
                if not order.paused:
                    player.resume()
                await _until_over(player, signals, stay=order.stay)


async def _until_over(player: Player, signals: AsyncIterator[signal.Signals], *, stay: bool) -> None:
    """Wait for a signal or, unless it is to stay, for the recording's end; keys control it meanwhile."""
    async with anyio.create_task_group() as tasks:

        async def until_signal() -> None:
            async for _ in signals:
                tasks.cancel_scope.cancel()

        tasks.start_soon(until_signal)
        tasks.start_soon(_follow_keys, player)
        await player.finished.wait()
        if stay:
            await anyio.sleep_forever()
        tasks.cancel_scope.cancel()


async def _follow_keys(player: Player) -> None:
    async with aclosing(key_presses()) as pressed:
        async for key in pressed:
            press(player, key)
            print(f"\r{_standing(player)}", end="", file=sys.stderr, flush=True)


def press(player: Player, key: Key) -> None:
    """Do what a key asks for."""
    if key == "space":
        player.toggle_paused()
    elif key == "right":
        player.play_next()
    else:
        factor = _FASTER if key == "up" else 1 / _FASTER
        player.set_rate(min(FASTEST, max(SLOWEST, player.rate * factor)))


def _standing(player: Player) -> str:
    position = (player.position_ns - player.start_ns) / 1e9
    length = (player.end_ns - player.start_ns) / 1e9
    state = "paused" if player.paused else "playing"
    return f"{state} at {position:.3f} of {length:.3f} s, speed {player.rate:.3g}   "


def _announce(urls: tuple[str, ...], recording: Recording) -> None:
    """Say that the server is ready: on stdout, or on stderr where stdout belongs to the protocol."""
    over_stdio = "stdio:" in urls
    print(
        "\n".join(f"listening on {url}" for url in urls), flush=True, file=sys.stderr if over_stdio else None
    )
    count = sum(topic.count or 0 for topic in recording.topics)
    length = (recording.end_ns - recording.start_ns) / 1e9
    print(f"playing {count} messages of {length:.1f} s", file=sys.stderr)
    if not recording.complete:
        print(
            "the recording was not ended properly: it is played as far as it goes"
            " (see rwt recording recover)",
            file=sys.stderr,
        )


__all__ = ["add_play_command", "parse_remap", "press"]
