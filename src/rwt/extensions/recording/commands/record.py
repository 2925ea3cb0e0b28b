"""`rwt bag record`: write what a robot publishes to an MCAP file, over its rosbridge server."""

from __future__ import annotations

import argparse
import logging
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio
import anyio.to_thread

from rwt.cli.console.logs import quiet
from rwt.cli.console.output import log_notes, note
from rwt.cli.console.progress import ProgressLine
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import (
    DEFAULT_URL,
    TOKEN_VARIABLE,
    URL_VARIABLE,
    add_globs,
    add_tls_options,
    command_error,
    request_headers,
    seconds,
    tls_of,
    topic_glob,
    url_of,
)
from rwt.extensions.recording import (
    COMPRESSIONS,
    ENCODINGS,
    Recorder,
    RecordingError,
    RecordingOptions,
    RecordingWriter,
    Split,
    TopicSelection,
)
from rwt.extensions.recording.channels import KEPT
from rwt.signals import STOP_SIGNALS, on_signals
from rwt_participant.errors import RobotError

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_participant.qos import QoS

logger = logging.getLogger(__name__)

_EXAMPLES = """\
examples:
  rwt bag record -o run.mcap                        everything, until Ctrl-C
  rwt bag record --url ws://robot:9090 /odom '/camera/*' --exclude '*/raw'
  rwt bag record --split 1GB                        run_0000.mcap, run_0001.mcap, …
  rwt bag record --encoding json --max-seconds 60
the file opens in Foxglove and Lichtblick, and `rwt bag play` serves it as a robot
"""
_LOOK_SECONDS = 1.0
_UNITS = {"kb": 1e3, "mb": 1e6, "gb": 1e9, "s": 1.0, "m": 60.0, "h": 3600.0}
_MOST_SPLIT = 1e9
_SPLIT = re.compile(r"(\d+(?:\.\d+)?) ?(kb|mb|gb|s|m|h)", re.IGNORECASE)


def add_record_verb(verbs: Commands) -> None:
    """Add `record` to `bag`."""
    parser = verbs.add_parser(
        "record", help="write what a robot publishes to an MCAP file", description=__doc__, epilog=_EXAMPLES
    )
    parser.add_argument(
        "topics",
        nargs="*",
        metavar="TOPIC",
        type=topic_glob,
        help="only these topics, or patterns (default: all)",
    )
    parser.add_argument("--all", "-a", action="store_true", help="all topics (default)")
    parser.add_argument(
        "--url", metavar="URL", help=f"URL of the robot (default ${URL_VARIABLE}, or {DEFAULT_URL})"
    )
    parser.add_argument(
        "--token", metavar="TOKEN", help=f"bearer token to present (default ${TOKEN_VARIABLE})"
    )
    add_tls_options(parser)
    _add_file_options(parser)
    parser.add_argument("--max-seconds", type=seconds, metavar="S", help="stop after this many seconds")
    parser.add_argument(
        "--no-reconnect",
        action="store_true",
        help="stop when the connection is lost, instead of reconnecting",
    )
    parser.add_argument("--verbose", "-v", action="store_true", help="log every topic")
    parser.set_defaults(run=_run)


def _add_file_options(parser: argparse.ArgumentParser) -> None:
    """Add the options about what is written to the file."""
    parser.add_argument(
        "--output",
        "-o",
        type=Path,
        metavar="FILE",
        help="output file; %%Y, %%m … in its name are the time (default rwt_DATE-TIME.mcap)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an existing file")
    add_globs(parser, "--exclude", "do not record topics that match these patterns")
    parser.add_argument(
        "--services", action="store_true", help="also service calls that the robot publishes as events"
    )
    parser.add_argument(
        "--actions", action="store_true", help="also the topics that carry the robot's actions (ROS 2)"
    )
    add_globs(parser, "--latched", "topics that latch their last message, if the server does not report that")
    parser.add_argument(
        "--encoding", choices=ENCODINGS, default="ros", help="ROS serialisation (default) or JSON"
    )
    parser.add_argument(
        "--compression", choices=COMPRESSIONS, default="zstd", help="compression of the file (default zstd)"
    )
    parser.add_argument(
        "--split",
        type=parse_split,
        metavar="AMOUNT",
        help="begin a new file at this size (1GB) or duration (10m)",
    )


def parse_split(text: str) -> Split:
    """Parse the size or duration at which a new file begins."""
    match = _SPLIT.fullmatch(text.strip())
    if match is None or not 0 < float(match[1]) <= _MOST_SPLIT:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a size nor a duration: expected for example 500MB, 1GB, 30s or 10m"
        )
    amount = float(match[1]) * _UNITS[match[2].lower()]
    return Split(size=round(amount)) if match[2].lower().endswith("b") else Split(seconds=amount)


def _run(arguments: argparse.Namespace) -> int:
    log_notes("%(levelname)s %(message)s")
    if arguments.verbose:
        logging.getLogger("rwt.cli").setLevel(logging.DEBUG)
    _refuse_files(arguments.topics)
    if arguments.output is None:
        arguments.output = Path("rwt_%Y_%m_%d-%H_%M_%S.mcap")
    try:
        # The command prints an error that ends it, so it is not logged as well.
        with quiet("rwt.extensions.recording.writer", logging.CRITICAL):
            anyio.run(_record, arguments)
    except RobotError as error:
        raise command_error(error) from error
    except RecordingError as error:
        raise CommandError(str(error)) from error
    return 0


def _refuse_files(topics: Iterable[str]) -> None:
    for topic in topics:
        if topic.endswith(".mcap"):
            raise CommandError(f"expected topics, got {topic!r}; to record to it: -o {topic}", CALLED_WRONGLY)


async def _record(arguments: argparse.Namespace) -> None:
    from rwt_client import Backoff, connect

    headers, tls = request_headers(arguments), tls_of(arguments)
    reconnect = None if arguments.no_reconnect else Backoff()
    over = anyio.Event()
    with on_signals(dict.fromkeys(STOP_SIGNALS, over.set)):
        async with connect(url_of(arguments), reconnect=reconnect, headers=headers, tls=tls) as robot:
            await _record_robot(robot, arguments, over)


async def _record_robot(robot: Robot, arguments: argparse.Namespace, over: anyio.Event) -> None:
    url = url_of(arguments)
    if robot.types.distro is None:
        raise CommandError(f"rosapi does not answer at {url}: start it on the robot to list its topics")
    options = RecordingOptions(
        arguments.encoding,
        arguments.compression,
        arguments.split,
        arguments.overwrite,
        dated="%" in arguments.output.name,
    )
    writer = RecordingWriter(arguments.output, robot.types.registry.distro, options)
    topics = TopicSelection(
        tuple(arguments.topics), tuple(arguments.exclude), arguments.services, arguments.actions
    )
    latched = TopicSelection(tuple(arguments.latched), services=True, actions=True)
    recorder = Recorder(robot, writer, topics, offered_qos=partial(_offered_qos, latched))
    try:
        await _look(recorder)
        note(f"recording {url} to {writer.paths[0]}")
        robot.on_event(lambda event: over.set() if event.kind == "closed" else None)
        if not robot.connected and arguments.no_reconnect:
            over.set()
        with anyio.move_on_after(arguments.max_seconds):
            await _keep_looking(recorder, over)
    finally:
        recorder.stop()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(_finish, writer, arguments.verbose)


def _offered_qos(latched: TopicSelection, topic: str) -> tuple[QoS, ...] | None:
    """Return the QoS of a topic that matches `--latched`; None for any other."""
    return (KEPT,) if latched.topics and latched.takes(topic) else None


async def _look(recorder: Recorder) -> None:
    """Record the topics that are new; no-op while there is no connection."""
    from rwt_client import ConnectionLost

    with suppress(ConnectionLost):
        await recorder.look()


async def _keep_looking(recorder: Recorder, over: anyio.Event) -> None:
    progress = ProgressLine()
    while not over.is_set() and recorder.writer.failure is None:
        with anyio.move_on_after(_LOOK_SECONDS):
            await over.wait()
            return
        progress.show(partial(_progress, recorder))
        try:
            await _look(recorder)
        except RobotError as error:
            logger.warning("the robot does not list its topics: %s", error)


def _progress(recorder: Recorder) -> str:
    writer = recorder.writer
    lost = f", {writer.dropped} dropped" if writer.dropped else ""
    topics, size = recorder.topics, writer.content_bytes / 1e6
    return f"{writer.messages} messages of {topics} topics, {size:.1f} MB{lost}"


def _finish(writer: RecordingWriter, verbose: bool) -> None:
    writer.close()
    files = ", ".join(map(str, writer.paths))
    size = writer.bytes_on_disk / 1e6
    begin = "\r" if sys.stderr.isatty() else ""
    print(f"{begin}{writer.messages} messages in {files}, {size:.1f} MB", file=sys.stderr)
    if not writer.channels:
        print("no messages on the given topics; `rwt topic list` lists all topics", file=sys.stderr)
    if writer.dropped:
        print(f"{writer.dropped} messages are missing: the disk was too slow", file=sys.stderr)
    for channel in writer.channels if verbose else ():
        note(f"  {channel.messages:8}  {channel.form.topic}")
