"""Parts of a server: gateways, nodes and services, made from their declarations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar
from urllib.parse import urlsplit

from rwt import parts
from rwt.access.settings import SettingsError
from rwt.declarations import (
    GatewayContext,
    GatewayPart,
    NodeContext,
    NodePart,
    Part,
    ReadyNode,
    ServerInfo,
)
from rwt_graph.nodes.node import Node
from rwt_protocol.extensions import ExtensionError
from rwt_transports.http.routes import HttpExtension

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.gateways.base import Gateway
    from rwt.settings.models import Settings
    from rwt_graph.api import Graph

P = TypeVar("P", bound=Part)


def loaded(kind: parts.Kind, name: str, setting: str, expected: type[P]) -> P:
    """Return the declaration of a part that a setting names.

    Raises:
        SettingsError: it cannot be imported, or is of another kind.
    """
    try:
        part = parts.load(kind, name)
    except parts.PartError as error:
        raise SettingsError(f"`{setting}`: {error}") from error
    if not isinstance(part, expected):
        raise SettingsError(f"`{setting}`: {name} is a {type(part).__name__}, not a {expected.__name__}")
    return part


def only_part(kind: parts.Kind, expected: type[P]) -> P:
    """Return the part of a kind of which a server has at most one.

    Raises:
        SettingsError: it is not installed.
    """
    return loaded(kind, parts.names(kind)[0] if parts.names(kind) else kind, kind, expected)


def load_encodings(names: Iterable[str]) -> None:
    """Import the encodings of the setting `encodings`. Raises SettingsError."""
    from rwt_protocol.codecs import load_encoding  # On start only: it imports all ops.

    for name in names:
        try:
            load_encoding(name)
        except ExtensionError as error:
            raise SettingsError(f"`encodings`: {error}") from error


def make_gateway(
    name: str, graph: Graph, settings: Settings, access: Access, pages: Sequence[HttpExtension]
) -> Gateway:
    """Create a gateway of the setting `gateways`. Raises SettingsError."""
    part = loaded("gateway", name, "gateways", GatewayPart)
    context = GatewayContext(
        graph,
        access,
        ServerInfo(("rosbridge", *settings.gateways), settings.nodes, settings.workers),
        pages,
        settings.default_call_service_timeout or None,
        settings.unregister_timeout,
    )
    return part.make(context, settings.of(part.settings))


def http_of(*nodes: object) -> list[HttpExtension]:
    """Return the HTTP extensions of nodes; a node without one has no attribute `http`."""
    return [node.http for node in nodes if hasattr(node, "http")]


class StartedNodes(NamedTuple):
    """Nodes that the settings name, and the HTTP extensions of all nodes."""

    named: Mapping[str, ReadyNode]
    http: list[HttpExtension]


def start_nodes(graph: Graph, settings: Settings, stack: ExitStack) -> StartedNodes:
    """Start the nodes of the settings, until `stack` is closed.

    Raises:
        SettingsError: a node cannot be imported, or its settings cannot be used.
    """
    context = NodeContext(graph, settings.limits)
    named: dict[str, ReadyNode] = {}
    http: list[HttpExtension] = []

    def start(part: NodePart, own: Any, name: str = "") -> None:
        made = part.make(context, own)
        if isinstance(made, HttpExtension):
            # Pages only: there is nothing to close, and no name to look it up by.
            http.append(made)
            return
        # Before the next node starts: if that fails, this one is closed.
        stack.enter_context(closing(made))
        http.extend(http_of(made))
        if name:
            named[name] = made

    for name in settings.nodes:
        part = loaded("node", name, "nodes", NodePart)
        start(part, settings.of(part.settings), name)
    # After the named ones: these are switched on by their own settings tables.
    for each, own in settings.active("node"):
        if isinstance(each.part, NodePart):
            start(each.part, own)
    return StartedNodes(named, http)


def start_gateway_node(graph: Graph, urls: Sequence[str], settings: Settings) -> Node:
    """Start the node of all clients, with its parameters `port` and `actual_port` (CFG-01)."""
    from rwt.rosbridge.bridge import GATEWAY_NODE  # On start only: it imports the whole gateway.

    node = Node(graph, GATEWAY_NODE)
    for name, each in (("port", settings.listen), ("actual_port", urls)):
        ports = [urlsplit(url).port for url in each if url.startswith(("ws:", "wss:"))]
        if ports and ports[0] is not None:
            node.parameters.declare(name, ports[0])
            node.parameters.set(name, ports[0])  # ROS 1 keeps the value of the previous server.
    return node
