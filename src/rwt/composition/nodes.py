"""Ready-made nodes, scripts and recorders of a server."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, cast
from urllib.parse import urlsplit

from rwt.access.settings import SettingsError
from rwt.composition.extensions import extension_for
from rwt.errors import ServerError
from rwt.extensions.tf_stream import Tf2WebRepublisher
from rwt.rosapi import Rosapi
from rwt.rosbridge.bridge import GATEWAY_NODE
from rwt_graph.nodes.node import Node
from rwt_transports.http.routes import Audience, HttpExtension, HttpResponse, Route

# Optional parts are imported in the functions that start them.
if TYPE_CHECKING:
    from pathlib import Path

    from rwt.extensions.meshes.mesh_files import MeshFiles
    from rwt.extensions.recording import Recorder, RecorderNode, RecordingOptions
    from rwt.extensions.video import WebVideoServer
    from rwt.settings.models import Settings
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import Accept


class ReadyNode(Protocol):
    """Node that works from its construction until it is closed. `http` is its HTTP extension."""

    def close(self) -> None:
        """Leave the graph."""


def http_of(*nodes: object) -> list[HttpExtension]:
    """Return the HTTP extensions of nodes; a node without one has no attribute `http`."""
    return [node.http for node in nodes if hasattr(node, "http")]


def _video(graph: Graph, settings: Settings) -> WebVideoServer:
    from rwt.extensions.video import WebVideoServer

    return WebVideoServer(
        graph, settings.limits.video_viewers, settings.limits.video_encoders, settings.limits.video_pixels
    )


NODES: Final[Mapping[str, Callable[[Graph, Settings], ReadyNode]]] = MappingProxyType(
    {
        "rosapi": lambda graph, settings: Rosapi(graph),
        "tf2_web_republisher": lambda graph, settings: Tf2WebRepublisher(graph),
        "web_video_server": _video,
    }
)
"""Built-in nodes of the setting `nodes`. A row that needs heavy libraries imports them when called."""

ON_EVERY_WORKER: Final[frozenset[str]] = frozenset({"web_video_server"})
"""Nodes that each worker process starts: those with pages, because any process may receive requests."""


def _make_node(name: str, graph: Graph, settings: Settings) -> ReadyNode:
    """Create a node from the settings: a built-in one, or that of an entry point in `rwt.nodes`."""
    builtin = NODES.get(name)
    if builtin is not None:
        return builtin(graph, settings)
    make: Callable[[Graph], ReadyNode] = extension_for("nodes", "rwt.nodes", name, NODES)
    return make(graph)


class StartedNodes(NamedTuple):
    """HTTP extensions of the nodes that the settings name, and the video server."""

    http: list[HttpExtension]
    video: WebVideoServer | None


def start_nodes(graph: Graph, settings: Settings, stack: ExitStack) -> StartedNodes:
    """Start the nodes of the settings, until `stack` is closed.

    Raises:
        SettingsError: there are no packages in a folder of the setting `packages`, a node of another
            distribution cannot be imported, or the settings of the recorder or the page cannot be used.
    """
    named = {name: stack.enter_context(closing(_make_node(name, graph, settings))) for name in settings.nodes}
    nodes: list[object] = [*named.values()]
    if settings.packages:
        nodes.append(_mesh_files(settings))
    if settings.demo:
        from rwt.extensions.demo import DemoRobot

        nodes.append(stack.enter_context(closing(DemoRobot(graph))))
    if settings.recorder.folder is not None:
        nodes.append(stack.enter_context(closing(_commanded_recorder(graph, settings))))
    video = cast("WebVideoServer | None", named.get("web_video_server"))
    return StartedNodes([*http_of(*nodes), *_web_page(settings)], video)


def _web_page(settings: Settings) -> Iterator[HttpExtension]:
    """Return the dashboard or, if it is not built, a note for the index."""
    if not settings.web.enabled:
        return
    from rwt.extensions.dashboard import MISSING, WebPage, WebPageError, find_static_files

    files = find_static_files()
    if files is None:
        missing = HttpResponse(f"{MISSING}\n".encode(), 404)
        yield HttpExtension(
            tuple(Route(path, lambda *_: missing, Audience.ANYBODY) for path in ("/web/*", "/lib/*")),
            section=lambda request, reader: f"<p>{html.escape(MISSING)}",
        )
        return
    try:
        yield WebPage(files, layouts=settings.web.layouts, embed=settings.web.embed).http
    except WebPageError as error:
        raise SettingsError(f"`web`: {error}") from error


def _commanded_recorder(graph: Graph, settings: Settings) -> RecorderNode:
    from rwt.extensions.recording import ExtraMissing, RecorderFolderError, RecorderLimits, RecorderNode

    given = settings.recorder
    assert given.folder is not None  # It is started if a folder is configured.
    limits = RecorderLimits(given.recording_bytes, given.folder_bytes)
    try:
        return RecorderNode(graph, given.folder, limits)
    except (RecorderFolderError, ExtraMissing) as error:
        raise SettingsError(f"`recorder.folder`: {error}") from error


def _mesh_files(settings: Settings) -> MeshFiles:
    from rwt.extensions.meshes.mesh_files import MeshFiles, MeshFilesError

    try:
        return MeshFiles(settings.packages, follow_links=settings.package_links)
    except MeshFilesError as error:
        raise SettingsError(f"`packages`: {error}") from error


def start_gateway_node(graph: Graph, urls: Sequence[str], settings: Settings) -> Node:
    """Start the node of all clients, with its parameters `port` and `actual_port` (CFG-01)."""
    node = Node(graph, GATEWAY_NODE)
    for name, each in (("port", settings.listen), ("actual_port", urls)):
        ports = [urlsplit(url).port for url in each if url.startswith(("ws:", "wss:"))]
        if ports and ports[0] is not None:
            node.parameters.declare(name, ports[0])
            node.parameters.set(name, ports[0])  # ROS 1 keeps the value of the previous server.
    return node


def start_recording(
    graph: Graph,
    file: Path | None,
    options: RecordingOptions | None,
    stack: ExitStack,
    *,
    introspection: bool,
) -> None:
    """Start recording to an MCAP file, introspection or both, until `stack` is closed.

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
    from rwt.extensions.recording.writer import DEFAULT_OPTIONS

    if introspection and not graph.distro.introspects_calls:
        raise SettingsError("introspection: is of ROS 2: ROS 1 has no topics for calls; leave it out")
    if file is None:
        stack.enter_context(closing(Introspection(graph)))
        return
    try:
        selection = EVERYTHING if introspection else TopicSelection()
        recorder = record_graph(graph, file, selection, options or DEFAULT_OPTIONS)
    except RecordingExists as error:
        raise SettingsError(f"record: {error}") from error
    except RecordingError as error:
        raise ServerError(f"record: {error}") from error
    stack.callback(_finish, recorder)
    if introspection:
        stack.enter_context(closing(Introspection(graph, on_topic=recorder.look_now)))


def _finish(recorder: Recorder) -> None:
    from rwt.extensions.recording import RecordingError

    try:
        recorder.close()
    except RecordingError as error:
        raise ServerError(f"record: {error}") from error


def start_script(
    graph: Graph, file: Path, settings: Settings, stack: ExitStack
) -> Callable[[Accept], Accept]:
    """Start the scripted robot of a file, until `stack` is closed.

    Returns:
        Middleware between the transports and the bridge, which injects the script's faults.

    Raises:
        SettingsError: the script is invalid, or the graph does not record messages.
    """
    from rwt.extensions.testing.errors import ScriptError
    from rwt.extensions.testing.journal import ObservedGraph
    from rwt.extensions.testing.script.control import ScriptControl
    from rwt.extensions.testing.wire.observed import ObservedWire

    if not isinstance(graph, ObservedGraph):
        raise SettingsError(
            "script: needs a graph in memory that notes its messages: leave out the setting `graph`, or give"
            " `graph=rwt.extensions.testing.ObservedGraph`"
        )
    wire = ObservedWire(graph, bson=settings.bson_only_mode)
    try:
        stack.enter_context(closing(ScriptControl(graph, wire, file)))
    except ScriptError as error:
        raise SettingsError(f"script: {error}") from error
    return wire.middleware
