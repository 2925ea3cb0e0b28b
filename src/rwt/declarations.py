"""Declarations of parts: gateways, nodes, graphs, services and the other things that a server can have.

A part declares itself in a module of its own, conventionally ``part.py`` of its folder or distribution, as a
value of one of the classes below. Built-in parts are rows of :mod:`rwt.parts`; those of other distributions
are entry points of the groups named there. Both are loaded by the same code, on first use.

A declaration is cheap to import: it has the model of its settings, and imports its code when it is made.
Each kind of part is made with one context object and the part's own settings.
"""

from __future__ import annotations

import argparse
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Protocol, TypeAlias

from rwt.access.settings import Table

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.access.access import Access
    from rwt.access.graph_view import GraphView
    from rwt.gateways.base import AcceptPeer, Gateway
    from rwt.settings.models import LimitSettings, Settings
    from rwt_graph.api import Graph
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry
    from rwt_transports.endpoint import Accept, Identify
    from rwt_transports.http.addresses import AddressCount
    from rwt_transports.http.proxies import Proxies
    from rwt_transports.http.routes import HttpExtension, MetricFamily, Route, Routes
    from rwt_transports.limits import Limits
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool


class NoSettings(Table):
    """Settings of a part that has none."""


@dataclass(frozen=True, slots=True)
class Option:
    """Option of `rwt serve` for a setting of a part.

    Attributes:
        flag: option with its dashes, such as ``--webrtc``.
        setting: key of the setting, such as ``webrtc.enabled``.
        arguments: further arguments of :meth:`argparse.ArgumentParser.add_argument`.
    """

    flag: str
    setting: str
    arguments: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Declaration of one part, see the subclasses for the kinds.

    Attributes:
        summary: what the part is, as one line for lists and help.
        settings: model of its table, which has the part's name, or the name in :mod:`rwt.parts`.
        at_top_level: True if the fields of `settings` are settings at the top level of the file.
        check: raises ValueError if the part's settings contradict others; the text names the setting.
        options: options of `rwt serve` for its settings.
        pools: rows of the table of shared pools, what its clients share; references as in :mod:`rwt.parts`.
    """

    summary: str
    settings: type[Table] = NoSettings
    at_top_level: bool = False
    check: Callable[[Settings, Any], None] | None = None
    options: tuple[Option, ...] = ()
    pools: tuple[str, ...] = ()


# -- gateways ----------------------------------------------------------------------------------------------


class ServerInfo(NamedTuple):
    """Names and numbers of a server that parts may show.

    Attributes:
        gateways: names of its gateways, `rosbridge` first.
        nodes: names of the nodes of the setting `nodes`.
        processes: number of processes that serve the same ports.
    """

    gateways: tuple[str, ...]
    nodes: tuple[str, ...]
    processes: int


ALONE: Final = ServerInfo((), (), 1)
"""A gateway without a server around it, as in tests."""


class GatewayContext(NamedTuple):
    """Access of a gateway to its server. It contains no settings of other parts.

    Attributes:
        graph: running graph. Clients get views of it from `access`.
        access: admission of clients, and their views of the graph.
        pages: pages of the server's nodes.
        call_timeout: timeout in seconds of calls without one of their own; None for none.
        linger: seconds that a publisher outlives its last client.
    """

    graph: Graph
    access: Access
    server: ServerInfo
    pages: Sequence[HttpExtension]
    call_timeout: float | None
    linger: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GatewayPart(Part):
    """Protocol beside rosbridge on the same port; named in the setting `gateways`.

    Attributes:
        make: creates the gateway for a running graph.
        asked_role: returns the role of its clients without a token, if it asks a client's user for approvals
            that the role may give; None if it asks nobody.
    """

    make: Callable[[GatewayContext, Any], Gateway]
    asked_role: Callable[[Any], str] | None = None


# -- nodes -------------------------------------------------------------------------------------------------


class ReadyNode(Protocol):
    """Node that works from its construction until it is closed. `http` is its HTTP extension."""

    def close(self) -> None:
        """Leave the graph."""


class NodeContext(NamedTuple):
    """Access of a node to its server.

    Attributes:
        graph: running graph.
        limits: limits of clients, of which some are about a node's streams.
    """

    graph: Graph
    limits: LimitSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class NodePart(Part):
    """Node that runs in the server: named in the setting `nodes`, or turned on by its own settings.

    Attributes:
        make: starts the node before clients can connect; a part with pages only returns these.
        is_on: returns True if its settings turn it on; None for nodes of the setting `nodes`.
        on_every_worker: True if each worker process starts it, as parts with pages require: any process may
            receive a request.
        in_trials: True if `rwt gate check` starts it, because its topics, services and types matter there.
        next_steps: returns what `rwt serve` prints when clients can connect, given the URL of the dashboard's
            port.
    """

    make: Callable[[NodeContext, Any], ReadyNode | HttpExtension]
    is_on: Callable[[Any], bool] | None = None
    on_every_worker: bool = False
    in_trials: bool = False
    next_steps: Callable[[str], str] | None = None


# -- graphs ------------------------------------------------------------------------------------------------


class WorkerContext(NamedTuple):
    """Context of one of several processes that serve the same ports.

    Attributes:
        number: number from 1; the first worker also runs what must exist only once.
        folder: folder of the workers' sockets, accessible only to this user.
        announce: called once with the announcement, when clients can connect.
        serve_metrics: serves the metrics of this process to the others within the block.
        gather_metrics: merges the metrics of this process with those of all.
    """

    number: int
    folder: Path
    announce: Callable[[str], None]
    serve_metrics: Callable[[Callable[[], bytes]], AbstractAsyncContextManager[None]]
    gather_metrics: Callable[[bytes], Awaitable[bytes]]


class GraphContext(NamedTuple):
    """Parameters of a graph.

    Attributes:
        registry: interfaces of the graph.
        clock: clock; None for the wall clock.
        address: value of the setting `graph`: the part's name, if applicable with an address behind it.
        worker: context of this process, if several share the ports.
        processes: number of these processes.
    """

    registry: Registry
    clock: Clock | None
    address: str
    worker: WorkerContext | None
    processes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphPart(Part):
    """Graph that other processes share; named in the settings `graph` and `bridge`.

    Attributes:
        make: creates the graph, which the server enters.
        distro: distribution of every such graph; empty for any.
        default_distro: returns the distribution of such a graph unless another is set.
        add_interfaces: adds interfaces that are installed beside the graph's middleware.
        is_shared: True if several worker processes can join it.
    """

    make: Callable[[GraphContext, Any], Graph]
    distro: str = ""
    default_distro: Callable[[], str] | None = None
    add_interfaces: Callable[[Registry], None] | None = None
    is_shared: bool = False


# -- services ----------------------------------------------------------------------------------------------


class OutgoingConnection(Protocol):
    """Status of a connection that the server opens for its clients, for announcements and metrics."""

    @property
    def url(self) -> str:
        """URL of the other side."""

    @property
    def connected(self) -> bool:
        """True if a new client can be served."""


@dataclass(frozen=True, slots=True)
class ServiceContext:
    """Access of a service to its server.

    Attributes:
        graph: running graph.
        access: admission of clients, and their views of the graph.
        linger: seconds that a publisher outlives its last client.
        nodes: nodes of the setting `nodes`, by name.
        limits: limits of connections.
        addresses: count of connections by address.
        buffers: receive buffers, shared by all connections.
        accept: returns the accept function for clients that arrive through a URL.
        pages: returns the routes for requests that arrive through a URL.
        add_routes: adds routes to every port, made with the port's accept function.
        add_metrics: adds metrics to ``/metrics``.
        add_connection: adds an outgoing connection to announcements.
        on_reload: adds a function that gives clients the roles of reloaded settings.
    """

    graph: Graph
    access: Access
    linger: float
    nodes: Mapping[str, ReadyNode]
    limits: Limits
    addresses: AddressCount
    buffers: ReceiveBufferPool
    accept: Callable[[str], Accept]
    pages: Callable[[str], Routes]
    add_routes: Callable[[Callable[[Accept], Iterable[Route[GraphView]]]], None]
    add_metrics: Callable[[Callable[[], Iterable[MetricFamily]]], None]
    add_connection: Callable[[OutgoingConnection], None]
    on_reload: Callable[[Callable[[], None]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ServicePart(Part):
    """Asynchronous part of a server that its settings turn on, such as another way for clients to connect.

    Attributes:
        run: context within which the service works, entered before the server listens.
        is_on: returns True if its settings turn it on.
        brings_clients: True if a server with this service needs no URL to listen on.
        on_every_worker: True if each worker process runs it.
    """

    run: Callable[[ServiceContext, Any], AbstractAsyncContextManager[object]]
    is_on: Callable[[Any], bool]
    brings_clients: bool = False
    on_every_worker: bool = False


# -- parts of which a server has one -----------------------------------------------------------------------


class RecordingRequest(NamedTuple):
    """Recording of a whole graph, as the arguments of :class:`rwt.Server` request it.

    Attributes:
        file: file to write; None for introspection alone.
        options: format of the file, and when a new one begins; None for the defaults.
        introspection: True to publish calls and goals on topics.
    """

    file: Path | None
    options: object | None
    introspection: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderPart(Part):
    """Recorder of the whole graph.

    Attributes:
        start: starts the recording until the stack is closed; returns its metrics and problems.
        add_options: adds options of `rwt serve`.
        request: returns the recording that these options request; None without one.
    """

    start: Callable[[Graph, RecordingRequest, ExitStack], HttpExtension]
    add_options: Callable[[argparse.ArgumentParser], None]
    request: Callable[[argparse.Namespace], RecordingRequest | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptPart(Part):
    """Robots scripted in a file.

    Attributes:
        make_graph: creates a graph that notes messages for the script, except those of the named nodes.
        start: starts the robot until the stack is closed; returns the middleware that injects its faults.
            The last argument is True if clients use BSON only.
    """

    make_graph: Callable[[Registry, Clock | None, Sequence[str]], Graph]
    start: Callable[[Graph, Path, bool, ExitStack], Callable[[Accept], Accept]]


AsgiApp: TypeAlias = "Callable[[Any, Any, Any], Awaitable[None]]"
"""ASGI application (version 3): a coroutine function of scope, receive and send."""


class Mounts(ABC):
    """Apps of other frameworks below paths of the server's ports."""

    @abstractmethod
    def running(self) -> AbstractAsyncContextManager[object]:
        """Run the lifespans of the apps within the block."""

    @abstractmethod
    def wrap(self, accept: Accept) -> Accept:
        """Return an accept function that hands clients below the paths to the apps."""

    @abstractmethod
    def add_to(self, routes: Routes, *, secure: bool) -> None:
        """Add the routes of the apps.

        Raises:
            SettingsError: a path is taken.
        """


class PortOptions(NamedTuple):
    """Parameters of a port, as of :func:`rwt_transports.listener.listen`."""

    routes: Routes
    hosts: tuple[str, ...]
    proxies: Proxies
    access_log: bool
    subprotocols: Mapping[str, AcceptPeer]
    addresses: AddressCount
    identify: Identify
    limits: Limits
    buffers: ReceiveBufferPool


class HostedApp(ABC):
    """Server as an application that another server runs."""

    @abstractmethod
    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve one connection or request."""

    @abstractmethod
    def serving(
        self, port: Callable[[bool], tuple[Accept, PortOptions]]
    ) -> AbstractAsyncContextManager[object]:
        """Serve within the block.

        Args:
            port: returns the accept function and the parameters of a port, given True for clients that can
                only come from this machine.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class AsgiPart(Part):
    """ASGI in both directions.

    Attributes:
        mount: creates the mounts of apps, by path.
        application: creates the application of a server, given the context of its lifespan.
    """

    mount: Callable[[Mapping[str, AsgiApp]], Mounts]
    application: Callable[[Callable[[], AbstractAsyncContextManager[object]]], HostedApp]


ServeAsWorker: TypeAlias = "Callable[[WorkerContext, Settings], None]"
"""Serves as one worker until it ends."""

InWorker: TypeAlias = "Callable[[int, Callable[[], None]], int]"
"""Body of a worker process, given its number and a function that serves; returns the exit code."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SupervisorPart(Part):
    """Supervisor of several processes that serve the same ports.

    Attributes:
        run: runs the processes and returns the exit code: the settings, what a worker does, what announces
            the URLs, and the body of a worker process.
        parent_ended: waits until the parent of this worker process has ended.
    """

    run: Callable[[Settings, ServeAsWorker, Callable[[str], None], InWorker | None], int]
    parent_ended: Callable[[], Awaitable[object]]


# -- checks of `rwt doctor` --------------------------------------------------------------------------------

Verdict = Literal["ok", "note", "warning", "problem"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check.

    Attributes:
        verdict: ``problem`` if something that clients need does not work.
        advice: what to do; empty if nothing.
    """

    name: str
    verdict: Verdict
    text: str
    advice: str = ""


class CheckContext(NamedTuple):
    """Robot that is examined.

    Attributes:
        url: its URL.
        headers: headers of requests, with credentials.
        tls: how to verify the server's certificate; None for the system's authorities.
    """

    url: str
    headers: Mapping[str, str] | None
    tls: SSLContext | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckPart(Part):
    """Check of `rwt doctor`; its name is the scheme of the URLs that it examines.

    Attributes:
        examine: yields findings as they are made.
        is_whole: True if it replaces the examination of a rosbridge server.
    """

    examine: Callable[[CheckContext, Callable[[Finding], None]], Awaitable[None]]
    is_whole: bool = False


__all__ = [
    "AsgiApp", "AsgiPart", "CheckContext", "CheckPart", "Finding", "GatewayContext", "GatewayPart",
    "GraphContext", "GraphPart", "HostedApp", "InWorker", "Mounts", "NoSettings", "NodeContext",
    "NodePart", "Option", "OutgoingConnection", "Part", "PortOptions", "ReadyNode", "RecorderPart",
    "RecordingRequest", "ScriptPart", "ServeAsWorker", "ServerInfo", "ServiceContext", "ServicePart",
    "SupervisorPart", "Verdict", "WorkerContext",
]  # fmt: skip
