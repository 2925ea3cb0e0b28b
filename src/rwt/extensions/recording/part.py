"""Declarations of recordings: those that clients request, and that of the whole graph."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from pydantic import Field

from rwt.access.settings import MIB, Bytes, SettingsError, Table
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.verbs import count
from rwt.declarations import NodeContext, NodePart, ReadyNode, RecorderPart, RecordingRequest
from rwt.errors import ServerError
from rwt_graph.api import Graph
from rwt_transports.http.routes import HttpExtension

if TYPE_CHECKING:
    from rwt.extensions.recording import Recorder, RecordingOptions, Split
    from rwt.settings.models import Settings


class RecorderSettings(Table):
    """Recordings that clients start and end, by `/recorder/start` and `/recorder/stop`. Needs the extra
    `mcap`."""

    folder: Path | None = Field(None, description="folder for recordings; not set: the services do not exist")
    recording_bytes: Bytes = Field(
        1024 * MIB, description="largest recording in bytes before compression; it ends there"
    )
    folder_bytes: Bytes = Field(
        8 * 1024 * MIB,
        description="largest size of all files in the folder; recordings end there, and none starts. Each"
        " client may use as much as it leaves free",
    )


def _check(settings: Settings, own: RecorderSettings) -> None:
    if own.folder is not None and settings.workers > 1:
        raise ValueError("`recorder.folder`: a recorder sees one process: expected `workers = 1`")


def _make(context: NodeContext, settings: RecorderSettings) -> ReadyNode:
    from rwt.extensions.recording import ExtraMissing, RecorderFolderError, RecorderLimits, RecorderNode

    assert settings.folder is not None  # It is started if a folder is configured.
    limits = RecorderLimits(settings.recording_bytes, settings.folder_bytes)
    try:
        return RecorderNode(context.graph, settings.folder, limits)
    except (RecorderFolderError, ExtraMissing) as error:
        raise SettingsError(f"`recorder.folder`: {error}") from error


ON_DEMAND = NodePart(
    summary="recordings that clients start and end",
    pools=("rwt.extensions.recording.recorder_node:RECORDINGS",),
    settings=RecorderSettings,
    check=_check,
    is_on=lambda settings: settings.folder is not None,
    make=_make,
)


def _start(graph: Graph, request: RecordingRequest, stack: ExitStack) -> HttpExtension:
    """Start recording to an MCAP file, introspection or both, until `stack` is closed.

    Returns its metrics and problems.

    Raises:
        SettingsError: introspection on ROS 1, or the file is there already.
        ServerError: the file cannot be written, now or when `stack` is closed.
    """
    from rwt.extensions.recording import (
        EVERYTHING,
        RecordingError,
        RecordingExists,
        TopicSelection,
        record_graph,
    )
    from rwt.extensions.recording.introspection import Introspection
    from rwt.extensions.recording.recorder import failure_metric
    from rwt.extensions.recording.writer import DEFAULT_OPTIONS

    if request.introspection and not graph.distro.introspects_calls:
        raise SettingsError("introspection: is of ROS 2: ROS 1 has no topics for calls; leave it out")
    if request.file is None:
        stack.enter_context(closing(Introspection(graph)))
        return HttpExtension()
    options = cast("RecordingOptions", request.options or DEFAULT_OPTIONS)
    try:
        selection = EVERYTHING if request.introspection else TopicSelection()
        recorder = record_graph(graph, request.file, selection, options)
    except RecordingExists as error:
        raise SettingsError(f"record: {error}") from error
    except RecordingError as error:
        raise ServerError(f"record: {error}") from error
    stack.callback(_finish, recorder)
    if request.introspection:
        stack.enter_context(closing(Introspection(graph, on_topic=recorder.look_now)))

    def problems() -> tuple[str, ...]:
        failure = recorder.writer.failure
        return () if failure is None else (f"recording of all topics: {failure.reason}",)

    return HttpExtension(metrics=partial(failure_metric, "rwt_record_failed", problems), problems=problems)


def _finish(recorder: Recorder) -> None:
    from rwt.extensions.recording import RecordingError

    try:
        recorder.close()
    except RecordingError as error:
        raise ServerError(f"record: {error}") from error


def _add_recording_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="write all topics to an MCAP file; %%Y, %%m … in its name are the time, as in"
        " run_%%Y-%%m-%%d_%%H%%M%%S.mcap",
    )
    parser.add_argument(
        "--record-overwrite", action="store_true", help="replace an existing file; by default an error"
    )
    parser.add_argument(
        "--record-split",
        type=_split,
        metavar="AMOUNT",
        help="begin a new file at this size (1GB) or duration (10m)",
    )
    parser.add_argument(
        "--record-keep",
        type=count,
        metavar="N",
        help="with --record-split, keep only the newest N files of this run",
    )
    parser.add_argument(
        "--introspection",
        action="store_true",
        help="publish calls and goals on topics, as ROS 2 can, and record them with --record",
    )


def _split(text: str) -> Split:
    from rwt.extensions.recording.commands.record import parse_split  # `--help` does not need it

    return parse_split(text)


def _request(arguments: argparse.Namespace) -> RecordingRequest | None:
    split, keep = arguments.record_split, arguments.record_keep
    if arguments.record is None:
        if split or keep or arguments.record_overwrite:
            raise CommandError("the options --record-… require --record", CALLED_WRONGLY)
        return RecordingRequest(None, None, True) if arguments.introspection else None
    if keep and split is None:
        raise CommandError("--record-keep requires --record-split", CALLED_WRONGLY)
    from rwt.extensions.recording import RecordingOptions

    options = RecordingOptions(
        split=split and replace(split, keep=keep or 0),
        overwrite=arguments.record_overwrite,
        dated="%" in arguments.record.name,
    )
    return RecordingRequest(arguments.record, options, arguments.introspection)


WHOLE_GRAPH = RecorderPart(
    summary="recording of all topics to an MCAP file, and of calls and goals",
    start=_start,
    add_options=_add_recording_options,
    request=_request,
)
