"""`rwt bag play`: serve a recording as a robot."""

from __future__ import annotations

import argparse
import sys
from contextlib import aclosing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from rwt.cli.commands.config import add_settings_options, settings_of
from rwt.cli.commands.serve import command_errors
from rwt.cli.console.key_presses import Key, key_presses
from rwt.cli.console.logs import log_to_stderr
from rwt.cli.console.output import note
from rwt.cli.console.progress import ProgressLine, share
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import add_globs, number_within, seconds_or_none
from rwt.extensions.recording.commands.recording import add_chunk_bytes, chunk_bytes

if TYPE_CHECKING:
    from rwt.extensions.recording import Recording
    from rwt.extensions.recording.playback import Player, PlayOptions
    from rwt.server import Server

_EXAMPLES = """\
examples:
  rwt bag play run.mcap                            on ws://127.0.0.1:9090, as fast as it was recorded
  rwt bag play run.mcap ws://0.0.0.0:9090 --loop
  rwt bag play run.mcap --rate 4 --start-offset 30 --end 60
  rwt bag play run.mcap --start-paused             until /rosbag2_player/resume is called or space pressed
  rwt bag play old.bag --remap /scan:=/front/scan  bags of ROS 1 and folders of rosbag2 play too
keys, in a terminal: space pauses and resumes, right plays the next message, up and down change the speed
"""
_CLOCK_HZ = 40.0
_PROGRESS_SECONDS = 1.0
_FASTER = 1.1


def add_play_verb(verbs: Commands) -> None:
    """Add `play` to `bag`."""
    parser = verbs.add_parser(
        "play", help="serve a recording as a robot", description=__doc__, epilog=_EXAMPLES
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="FILE|URL",
        help="MCAP files, .bag files or folders of rosbag2; and where to listen (default ws://127.0.0.1:9090)",
    )
    _add_time(parser)
    add_globs(parser, "--topics", "only these")
    add_globs(parser, "--exclude", "not these")
    parser.add_argument(
        "--remap", "-m", nargs="+", action="extend", default=[], type=parse_remap, metavar="OLD:=NEW",
        help="publish a topic under another name",
    )  # fmt: skip
    parser.add_argument(
        "--no-services", action="store_true", help="do not answer service calls from the recording"
    )
    parser.add_argument(
        "--clock", nargs="?", type=number_within("times a second", 0, 1e4), const=_CLOCK_HZ, default=0.0,
        metavar="HZ", help=f"publish the recording's time on /clock (default rate {_CLOCK_HZ:g})",
    )  # fmt: skip
    add_settings_options(parser)
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.set_defaults(run=_run)


def _add_time(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--rate",
        "-r",
        type=number_within("a rate", 0.001, 1000),
        default=1.0,
        metavar="RATE",
        help="speed from 0.001 to 1000; 2 is twice as fast (default 1)",
    )
    parser.add_argument(
        "--start-offset",
        type=seconds_or_none,
        default=0.0,
        metavar="S",
        help="start at this time, in seconds",
    )
    parser.add_argument(
        "--end", type=seconds_or_none, metavar="S", help="stop at this time, in seconds from the start"
    )
    add_chunk_bytes(parser)
    parser.add_argument("--start-paused", "-p", action="store_true", help="start paused")
    parser.add_argument("--loop", "-l", action="store_true", help="restart at the end")
    parser.add_argument("--stay", action="store_true", help="keep serving latched topics after the end")


def parse_remap(text: str) -> tuple[str, str]:
    """Parse `OLD:=NEW`."""
    old, sign, new = text.partition(":=")
    if not (old and sign and new):
        raise argparse.ArgumentTypeError(f"{text!r}: expected OLD:=NEW, for example /scan:=/front/scan")
    return old, new


def _run(arguments: argparse.Namespace) -> int:
    from rwt.extensions.recording import RecordingError, open_recording
    from rwt.extensions.recording.playback.server import (
        PlaybackServer,  # `--help` and completion need none of it.
    )
    from rwt.server import listening, print_announcement

    log_to_stderr("text", verbose=arguments.verbose)
    urls = tuple(word for word in arguments.what if _is_url(word))
    files = [Path(word) for word in arguments.what if not _is_url(word)]
    if not files:
        raise CommandError(
            "expected a recording to play, for example: rwt bag play run.mcap; "
            "put it before options that take several words, such as --topics",
            exit_code=2,
        )
    settings = settings_of(arguments, {"listen": urls or None}).settings
    try:
        with open_recording(files, chunk_bytes(arguments)) as recording, command_errors():
            server = PlaybackServer(
                recording, options=_options(arguments), stay=arguments.stay, settings=settings
            )

            def on_up(up: Server) -> str:
                up.graph.spawn(partial(_follow_keys, server.player), "key presses")
                up.graph.spawn(partial(_show_progress, server.player), "progress")
                return listening(up)

            def announce(text: str) -> None:
                print_announcement(text)
                _announce(recording)

            code = server.run(announce=announce, on_up=on_up)
            losses = server.player.losses if code == 0 else ()
            for loss in losses:
                note(f"not played: {loss}")
            return code or int(bool(losses))
    except RecordingError as error:
        raise CommandError(str(error)) from error


def _is_url(word: str) -> bool:
    return "://" in word or word == "stdio:"


def _options(arguments: argparse.Namespace) -> PlayOptions:
    from rwt.extensions.recording import TopicSelection
    from rwt.extensions.recording.playback import PlayOptions

    return PlayOptions(
        rate=arguments.rate,
        start=arguments.start_offset,
        end=arguments.end,
        loop=arguments.loop,
        paused=arguments.start_paused,
        selection=TopicSelection(tuple(arguments.topics), tuple(arguments.exclude), True, True),
        remap=dict(arguments.remap),
        clock_hz=arguments.clock,
        answer_services=not arguments.no_services,
    )


async def _follow_keys(player: Player) -> None:
    async with aclosing(key_presses()) as pressed:
        async for key in pressed:
            press(player, key)
            print(f"\r{_status_line(player)}", end="", file=sys.stderr, flush=True)


async def _show_progress(player: Player) -> None:
    progress = ProgressLine()
    while progress.is_terminal:
        await anyio.sleep(_PROGRESS_SECONDS)
        progress.show(partial(_status_line, player))


def press(player: Player, key: Key) -> None:
    """Apply a key press to the player."""
    from rwt.extensions.recording.playback.player import FASTEST, SLOWEST

    if key == "space":
        player.toggle_paused()
    elif key == "right":
        player.play_next()
    elif key in ("up", "down"):
        factor = _FASTER if key == "up" else 1 / _FASTER
        player.set_rate(min(FASTEST, max(SLOWEST, player.rate * factor)))


def _status_line(player: Player) -> str:
    position = (player.position_ns - player.start_ns) / 1e9
    length = (player.end_ns - player.start_ns) / 1e9
    state = "paused" if player.paused else "playing"
    bar = share(round(position * 1e3), round(length * 1e3))
    return f"{bar} {state} at {position:.3f} of {length:.3f} s, speed {player.rate:.3g}   "


def _announce(recording: Recording) -> None:
    print(f"playing {recording.message_count} messages of {recording.seconds:.1f} s", file=sys.stderr)
    if not recording.complete:
        print("the recording is incomplete: playing what can be read (see rwt bag recover)", file=sys.stderr)
