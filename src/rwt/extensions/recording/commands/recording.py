"""`rwt bag info` and `rwt bag recover`: describe recordings, and repair those that are incomplete."""

from __future__ import annotations

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.console.output import printable, standard_output
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import number_within
from rwt_interfaces.times import NANOSECONDS

if TYPE_CHECKING:
    from rwt.extensions.recording import RecordedTopic, Recording


def add_recover_verb(verbs: Commands) -> None:
    """Add `recover` to `bag`."""
    recover = verbs.add_parser(
        "recover",
        help="repair an incomplete MCAP file",
        description="Copy the readable part of a damaged or incomplete MCAP file to a complete one, and"
        " report the losses.",
        epilog="examples:\n  rwt bag recover run.mcap -o whole.mcap",
    )
    recover.add_argument("file", type=Path, metavar="FILE", help="the damaged file")
    recover.add_argument(
        "--output",
        "-o",
        type=Path,
        required=True,
        metavar="FILE",
        help="output file, created once it is complete; with --overwrite it may be the input",
    )
    recover.add_argument("--overwrite", action="store_true", help="replace an existing file")
    add_chunk_bytes(recover)
    recover.set_defaults(run=_run_recover)


def add_chunk_bytes(parser: argparse.ArgumentParser) -> None:
    """Add the option that limits the uncompressed size of chunks."""
    parser.add_argument(
        "--chunk-bytes",
        type=number_within("a number of bytes", 1024, 2**40),
        metavar="N",
        help="maximum uncompressed size of a chunk, or of several that overlap in time (default 128 MiB)",
    )


def chunk_bytes(arguments: argparse.Namespace) -> int:
    """Return the value of the option of :func:`add_chunk_bytes`."""
    from rwt.extensions.recording.recording import CHUNK_BYTES

    given: float | None = arguments.chunk_bytes
    return CHUNK_BYTES if given is None else int(given)


def add_info_verb(verbs: Commands) -> None:
    """Add `info` to `bag`."""
    info = verbs.add_parser(
        "info",
        help="list topics, types, counts and times",
        description="Print the topics of recordings with types, message counts and times.",
        epilog="examples:\n  rwt bag info run.mcap\n  rwt bag info old.bag --json",
    )
    info.add_argument("files", nargs="+", type=Path, metavar="FILE", help="MCAP, .bag or folder of rosbag2")
    info.add_argument("--json", action="store_true", help="as JSON")
    add_chunk_bytes(info)
    info.set_defaults(run=_run_info)


def _run_info(arguments: argparse.Namespace) -> int:
    from rwt.extensions.recording import RecordingError, open_recording

    try:
        with open_recording(arguments.files, chunk_bytes(arguments)) as recording:
            text = json.dumps(described(recording), indent=2) if arguments.json else text_of(recording)
            standard_output(json=arguments.json).line(text)
    except RecordingError as error:
        raise CommandError(str(error)) from error
    return 0


def _run_recover(arguments: argparse.Namespace) -> int:
    from rwt.extensions.recording import RecordingError, open_recording
    from rwt.extensions.recording.errors import require

    try:
        require("mcap")
        from rwt.extensions.recording.mcap_files import recover

        most = chunk_bytes(arguments)
        found = recover(arguments.file, arguments.output, overwrite=arguments.overwrite, chunk_bytes=most)
        with open_recording([arguments.output], most) as whole:
            count = whole.message_count
    except RecordingError as error:
        raise CommandError(str(error)) from error
    print(f"{count} messages of {len(whole.topics)} topics in {arguments.output}")
    if found.recovery is None and not found.damaged:
        print(f"{arguments.file} was complete", file=sys.stderr)
        return 0
    lost_bytes = 0 if found.recovery is None else found.recovery.lost_bytes
    lost = f"{found.damaged} damaged chunks and {lost_bytes} bytes at the end"
    print(f"{lost} could not be read", file=sys.stderr)
    return int(bool(found.damaged))


def described(recording: Recording) -> dict[str, object]:
    """Return the description of a recording for programs."""
    return {
        "files": [str(path) for path in recording.paths],
        "complete": recording.complete,
        "ros_version": recording.distro.ros_version,
        "start_ns": recording.start_ns,
        "end_ns": recording.end_ns,
        "topics": [
            {
                "name": topic.name,
                "type": topic.type,
                "encoding": topic.encoding,
                "count": topic.count,
                "latched": _is_latched(topic),
            }
            for topic in recording.topics
        ],
    }


def text_of(recording: Recording) -> str:
    """Return the description of a recording for people."""
    lines = [
        f"files     {', '.join(map(str, recording.paths))}",
        f"ROS       {recording.distro.ros_version}",
        f"start     {_date(recording.start_ns)}",
        f"end       {_date(recording.end_ns)}",
        f"duration  {recording.seconds:.3f} s",
        f"messages  {recording.message_count}",
        "",
    ]
    if not recording.complete:
        lines.insert(1, "note      incomplete: `rwt bag recover` repairs it")
    width = max((len(topic.name) for topic in recording.topics), default=0)
    for topic in recording.topics:
        count = "?" if topic.count is None else topic.count
        name, kind = printable(topic.name), printable(topic.type)
        lines.append(f"{count:>9}  {name:<{width}}  {kind}{' (latched)' if _is_latched(topic) else ''}")
    return "\n".join(lines)


def _is_latched(topic: RecordedTopic) -> bool:
    return any(qos.durability.value == "transient_local" for qos in topic.offered_qos)


def _date(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
    try:
        date = datetime.fromtimestamp(seconds, UTC)
    except (ValueError, OverflowError, OSError):
        return f"invalid date ({time_ns})"
    return f"{date:%Y-%m-%d %H:%M:%S}.{nanoseconds:09} UTC ({time_ns})"
