"""A node that records when it is told to, by services: into one folder, and never more than it may."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Awaitable, Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

import anyio
import anyio.to_thread

from rwt.extensions.meshes.mesh_files import file_chunks
from rwt.extensions.recording.errors import RecordingNotWritten, require
from rwt.extensions.recording.recorder import Recorder, failure_metric, record_graph
from rwt.extensions.recording.writer import RecordingOptions, RecordingWriter
from rwt_graph.accounts import ASKER
from rwt_graph.api import Graph
from rwt_graph.nodes.node import Node
from rwt_graph.topic_selection import TopicSelection
from rwt_participant.errors import HandleClosed
from rwt_participant.messages import Message
from rwt_participant.timers import Timer
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from rwt_transports.shared_pool import PoolRow, lasting_room

logger = logging.getLogger(__name__)

STATE_SECONDS: Final = 1.0
"""Interval between state messages while recording, in seconds."""
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_FILE_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*\.mcap")
PATH: Final = "/recordings"
"""Path of the list of recordings; each file is below it."""
_MAX_LISTED: Final = 1000
_MAX_TOPICS: Final = 200
_MAX_NAME_CHARS: Final = 256
_MAX_FILES_PER_SECOND: Final = 100

RECORDINGS: Final = PoolRow("recordings", "recorder.folder_bytes", "bytes of recordings")


class RecorderFolderError(ValueError):
    """A folder that recordings cannot be put into; the text says which and why."""


@dataclass(frozen=True, slots=True)
class RecorderLimits:
    """Limits of recordings that clients start, in bytes.

    Attributes:
        recording: content of one, before compression.
        folder: all files of the folder, which clients share: each may have as much as it leaves free.
    """

    recording: int
    folder: int


class RecorderNode:
    """Records a graph from a call of ``/recorder/start`` to ``/recorder/stop``, or up to its size limit.

    The services are those of ``rwt_recorder_msgs``; ``/recorder/state`` is latched. There is one recording at
    a time, which continues if its client disconnects. Clients that may subscribe to every topic list and
    download the files of the folder over HTTP.

    Args:
        folder: folder of the files, which are named after the request and the time.

    Raises:
        RecorderFolderError: `folder` is not a folder.
        ExtraMissing: the extra ``mcap`` is not installed.
    """

    def __init__(self, graph: Graph, folder: Path, limits: RecorderLimits) -> None:
        require("mcap")
        if not folder.is_dir():
            raise RecorderFolderError(f"{folder}: no folder for recordings")
        self._graph = graph
        self._folder = folder
        self._limits = limits
        self._recorder: Recorder | None = None
        self._is_changing = False
        self._askers: dict[str, Hashable] = {}  # Clients that started the files since this node started.
        self._ending: list[RecordingWriter] = []
        self._timer: Timer | None = None
        self._failure = ""
        self._state: dict[str, object] = {"largest_bytes": min(limits.recording, limits.folder)}
        self._node = Node(graph, "recorder")
        self._publisher = self._node.advertise(
            "/recorder/state", "rwt_recorder_msgs/RecorderState", latch=True
        )
        for name, type, act in (
            ("start", "StartRecording", self._start),
            ("stop", "StopRecording", self._stop),
        ):
            handler = partial(self._alone, act)
            self._node.advertise_service(f"/recorder/{name}", f"rwt_recorder_msgs/{type}", handler)
        self._publish_state()
        routes = (
            Route(PATH, self._list, Audience.EVERY_TOPIC, feature="recordings"),
            Route(f"{PATH}/*", self._download, Audience.EVERY_TOPIC),
        )
        self.http: Final = HttpExtension(
            routes,
            metrics=partial(failure_metric, "rwt_recorder_failed", self.problems),
            problems=self.problems,
        )

    def problems(self) -> tuple[str, ...]:
        """Return why the last recording could not be written; empty if it could."""
        recorder = self._recorder
        writers = self._ending if recorder is None else [*self._ending, recorder.writer]
        failures = [each.failure.reason for each in writers if each.failure is not None]
        reason = failures[-1] if failures else self._failure
        return (f"recording: {reason}",) if reason else ()

    # Pages

    async def _list(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        found = await anyio.to_thread.run_sync(_files_in, self._folder)
        current = self._state["file"] if self._recorder is not None else None
        body = [each for each in found if each["name"] != current]
        return HttpResponse(
            json.dumps(body).encode(), content_type="application/json", headers={"Cache-Control": "no-store"}
        )

    async def _download(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        name = request.path.removeprefix(f"{PATH}/")
        path = self._folder / name
        if _FILE_NAME.fullmatch(name) is None or not path.is_file() or path.is_symlink():
            return HttpResponse(f"there is no recording {name[:80]!a} here\n".encode(), 404)
        headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return HttpResponse(file_chunks(path), content_type="application/octet-stream", headers=headers)

    # Services

    async def _alone(
        self, act: Callable[[Message], Awaitable[dict[str, object]]], request: Message
    ) -> dict[str, object]:
        if self._is_changing:
            return _refusal("another recording is just being started or ended; ask again")
        self._is_changing = True
        try:
            done = await act(request)
        except RecordingNotWritten as error:
            # The writer logs the whole text; clients must not learn where the files are.
            self._failure = error.reason
            done = _refusal(str(error).replace(f"{self._folder}/", ""))
        finally:
            self._is_changing = False
            with suppress(HandleClosed):  # The node was closed while the disk was awaited.
                self._publish_state()
        return done

    async def _start(self, request: Message) -> dict[str, object]:
        name, topics = request.name, tuple(request.topics)
        if self._recorder is not None:
            return _refusal(f"{self._state['file']} is being recorded already; /recorder/stop ends it")
        if name and _NAME.fullmatch(name) is None:
            return _refusal(
                "name: expected up to 64 of the characters A-Z a-z 0-9 . _ -, no dot at its start"
            )
        if len(topics) > _MAX_TOPICS or any(not each or len(each) > _MAX_NAME_CHARS for each in topics):
            return _refusal(f"topics: expected at most {_MAX_TOPICS} names or patterns")
        asker = ASKER.get()
        try:
            sizes = await anyio.to_thread.run_sync(_sizes_in, self._folder)
        except OSError as error:
            raise RecordingNotWritten(
                f"the folder cannot be read: {error.strerror}", str(error.strerror)
            ) from None
        used = sum(sizes.values())
        own = sum(
            size for file, size in sizes.items() if file in self._askers and self._askers[file] == asker
        )
        room = min(self._limits.recording, lasting_room(self._limits.folder, used, own))
        if room <= 0:
            return _refusal(
                f"the recordings here have {used} bytes, {own} of them by this client, which may have as many"
                f" as are left of {self._limits.folder}: remove some of them ({RECORDINGS.setting})"
            )
        path = self._free_path(name or "recording")
        self._askers = {file: each for file, each in self._askers.items() if file in sizes}
        self._askers[path.name] = asker
        options = RecordingOptions(largest_bytes=room)
        self._recorder = record_graph(self._graph, path, TopicSelection(topics), options)
        self._failure, self._ending = "", [each for each in self._ending if each.is_writing]
        self._state = {
            "recording": True,
            "file": path.name,
            "since": self._graph.distro.time(self._graph.clock.time_ns()),
            "largest_bytes": room,
        }
        self._tick()
        return {"success": True, "message": "", "file": path.name}

    async def _stop(self, request: Message) -> dict[str, object]:
        recorder = self._forget()
        if recorder is None:
            return _refusal("nothing is being recorded")
        try:
            await anyio.to_thread.run_sync(recorder.writer.close)
        finally:
            self._note(recorder)
        return {"success": True, "message": "", "file": self._state["file"]}

    # The recording

    def _free_path(self, name: str) -> Path:
        at = datetime.fromtimestamp(self._graph.clock.time_ns() / 1e9, UTC)
        stem = f"{name}_{at:%Y%m%d-%H%M%S}"
        for number in range(1, _MAX_FILES_PER_SECOND):
            path = self._folder / f"{stem}{'' if number == 1 else f'_{number}'}.mcap"
            if not path.exists():
                return path
        raise RecordingNotWritten(
            f"{stem}.mcap is there already; give another name", "the file is there already"
        )

    def _tick(self) -> None:
        recorder = self._recorder
        if recorder is None:
            return
        self._timer = self._graph.clock.call_later(STATE_SECONDS, self._tick)
        if recorder.is_full and not self._is_changing:
            self._close_now(f"it has ended: it has come to {self._state['largest_bytes']} bytes")
        elif recorder.writer.failure is not None and not self._is_changing:
            self._failure = recorder.writer.failure.reason
            self._close_now(str(recorder.writer.failure).replace(f"{self._folder}/", ""))
        self._publish_state()

    def _close_now(self, problem: str) -> None:
        """Stop without waiting: the writer's thread writes the rest."""
        recorder = self._forget(problem)
        if recorder is not None:
            recorder.writer.finish_soon()
            self._ending = [each for each in self._ending if each.is_writing] + [recorder.writer]

    def _forget(self, problem: str = "") -> Recorder | None:
        """Stop the recorder, and return it, for its writer to be closed.

        Args:
            problem: why it stops, for the state; empty if that was requested.
        """
        recorder, self._recorder = self._recorder, None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if recorder is not None:
            recorder.stop()
            self._note(recorder)
            self._state |= {"recording": False, "problem": problem}
        return recorder

    def _note(self, recorder: Recorder) -> None:
        writer = recorder.writer
        self._state |= {"messages": writer.messages, "bytes": writer.content_bytes, "dropped": writer.dropped}

    def _publish_state(self) -> None:
        if self._recorder is not None:
            self._note(self._recorder)
        self._publisher.publish(self._state)

    def close(self) -> None:
        """End what is being recorded, and leave the graph."""
        recorder = self._forget()
        for writer in [*self._ending, *([] if recorder is None else [recorder.writer])]:
            with suppress(RecordingNotWritten):  # Logged by the writer.
                writer.close()
        self._node.close()


def _refusal(text: str) -> dict[str, object]:
    return {"success": False, "message": text, "file": ""}


def _files_in(folder: Path) -> list[dict[str, object]]:
    files = [
        (each.stat(), each.name)
        for each in folder.iterdir()
        if _FILE_NAME.fullmatch(each.name) and each.is_file() and not each.is_symlink()
    ]
    files.sort(key=lambda each: -each[0].st_mtime)
    return [
        {"name": name, "bytes": stat.st_size, "modified": stat.st_mtime} for stat, name in files[:_MAX_LISTED]
    ]


def _sizes_in(folder: Path) -> dict[str, int]:
    return {each.name: each.stat().st_size for each in folder.iterdir() if each.is_file()}
