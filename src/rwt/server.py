"""Server assembled from settings: graph, nodes, gateways, listeners and pages."""

from __future__ import annotations

import inspect
import ipaddress
import logging
import signal
import socket
import sys
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, ExitStack, nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import anyio

from rwt.access.audit import bounded_log
from rwt.access.origins import is_loopback_listener
from rwt.access.settings import SettingsError
from rwt.composition.graphs import MakeGraph, bridged_graphs, check_graph, make_graph, relay_between
from rwt.composition.starting import (
    http_of,
    load_encodings,
    make_gateway,
    only_part,
    start_gateway_node,
    start_nodes,
)
from rwt.declarations import (
    AsgiPart,
    HostedApp,
    OutgoingConnection,
    RecorderPart,
    RecordingRequest,
    ScriptPart,
    ServiceContext,
    ServicePart,
    SupervisorPart,
)
from rwt.observability.build import version_line
from rwt.observability.supervision import (
    ALIVE,
    READY,
    STOPPING,
    Periodic,
    heartbeat_seconds,
    tell,
    tell_reloading,
)
from rwt.settings.sources import LoadedSettings, changed_names, with_changes
from rwt.signals import HANGUP, STOP_SIGNALS, Stopped, on_signals, stopped_by_signals, terminal_is_gone
from rwt.tls.expiry import expiry_metrics, warn_of_expiry
from rwt.tls.machine import outward_address
from rwt.tls.tls import renew_server_tls, server_tls
from rwt_graph.api import Graph
from rwt_graph.errors import NotRunning
from rwt_graph.nodes.node import Node
from rwt_transports.drivers.sockets import raise_descriptor_limit
from rwt_transports.scheduler import WRITING, Scheduler

if TYPE_CHECKING:
    from ssl import SSLContext

    from typing_extensions import TypeIs

    from rwt.access.access import Access
    from rwt.access.graph_view import GraphView
    from rwt.blocking import BlockingNode
    from rwt.declarations import AsgiApp, InWorker, ReadyNode, WorkerContext
    from rwt.gateways.base import Gateway, MakeGateway
    from rwt.observability.metrics import ServerMetrics
    from rwt.rosbridge.bridge import Bridge
    from rwt.settings.models import Settings
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry
    from rwt_transports.endpoint import Accept
    from rwt_transports.http.routes import HttpExtension
    from rwt_transports.listener import Listener

logger = logging.getLogger(__name__)

Loop = Literal["asyncio", "trio", "uvloop"]
"""Event loops that the server can start."""

LOOPS: Final[dict[Loop, tuple[str, dict[str, bool]]]] = {
    "asyncio": ("asyncio", {}),
    "trio": ("trio", {}),
    "uvloop": ("asyncio", {"use_uvloop": True}),
}
"""Backend and options for :func:`anyio.run`."""

Middleware = Callable[["Accept"], "Accept"]
"""Wraps the accept function of each listener."""

Main = Callable[["Server"], Awaitable[object]] | Callable[["BlockingNode"], object]
"""Robot program: a coroutine function on the server's event loop, or a plain function beside it."""


#: Settings that :meth:`Server.reload` replaces.
_RELOADED = frozenset({"auth", "roles", "origins", "tls", "gate"})


@dataclass(frozen=True, slots=True)
class _Running:
    """Parts of a server that exist only while it runs.

    Attributes:
        reload_roles: functions that assign clients their roles of the current settings.
        connections: connections that the server opened for its clients.
    """

    bridge: Bridge
    reload_roles: tuple[Callable[[], None], ...]
    metrics: ServerMetrics
    listeners: tuple[Listener, ...]
    connections: Sequence[OutgoingConnection]
    tls: SSLContext | None
    stack: AsyncExitStack


class Server:
    """Robot graph with a rosbridge server, assembled from settings.

    With an event loop (asyncio, trio, uvloop)::

        async with Server("ws://127.0.0.1:9090") as server:
            robot = server.node("my_robot")

    Without one, the server runs in a thread, and the block gets a node with blocking methods
    (:class:`BlockingNode`)::

        with Server("ws://127.0.0.1:9090") as robot:
            robot.publish("/battery", {"data": 12.6}, "std_msgs/Float32")

    :meth:`run` serves until a signal arrives. At the end, each client is closed with code 1001. A server runs
    only once.

    Args:
        urls: URLs to listen on, for example ``ws://127.0.0.1:9090``, instead of the setting `listen`. See
            :data:`rwt_transports.schemes.SCHEMES`; ``wss`` and ``tcps`` require `tls.certfile` and
            `tls.keyfile`.
        settings: settings of the server. Without any URL it listens on the default one, or, with
            `dial.urls`, on none.
        graph: existing graph, or a factory such as a class; default: a graph according to the setting
            `graph`. A graph that already runs keeps running when the server ends.
        registry: interfaces of a new graph; default: those of `distro` and `interfaces`.
        clock: clock of a new graph; default: the wall clock.
        extra_nodes: factories, called with the running graph before clients can connect. Each returns a node,
            which is closed with the server; its attribute `http`, if any, adds pages.
        gateways: gateways of other protocols on the same port, instead of the setting `gateways`. Each is a
            name, or a factory called with the running graph and the access rules
            (:class:`rwt.gateways.base.Gateway`). ``[]`` for none; None for the setting.
        http: additional pages, sections of the index page, and metrics.
        mounts: ASGI apps by path, such as ``{"/shop": app}``: HTTP, streams, WebSocket without subprotocols,
            and lifespan. Access rules do not apply to them; the limits of the port do.
        script: ``.toml`` or ``.py`` file of a scripted robot.
        record: MCAP file to which all topics are recorded.
        record_options: format of the file, and when a new one begins.
        introspection: True to publish calls and goals on topics, as in ROS 2, and record them with `record`.
        middleware: layer between the transports and the bridge, for example to inject faults.
        name: name of the node that a ``with`` block gets.
        loop: event loop that :meth:`run` and a ``with`` block start.
        worker: context of this worker process; set by :meth:`run`.
        reload: reads the settings again for :meth:`reload`, if possible with their places for errors;
            default: only the files that the settings name are read again.
        changes: settings by name, overriding `settings`: ``Server(demo=True, distro="noetic")``.

    Attributes:
        settings: effective settings, including `urls` and `changes`.

    Raises:
        SettingsError: a setting or an argument is invalid, or contradicts another.
        GraphError: the options of Zenoh are invalid.
    """

    def __init__(
        self,
        *urls: str,
        settings: Settings | None = None,
        graph: Graph | MakeGraph | str | None = None,
        registry: Registry | None = None,
        clock: Clock | None = None,
        extra_nodes: Iterable[Callable[[Graph], ReadyNode]] = (),
        gateways: Iterable[MakeGateway | str] | None = None,
        http: Iterable[HttpExtension] = (),
        mounts: Mapping[str, AsgiApp] = MappingProxyType({}),
        script: Path | None = None,
        record: Path | None = None,
        record_options: object | None = None,
        introspection: bool = False,
        middleware: Middleware | None = None,
        name: str = "robot",
        loop: Loop = "asyncio",
        worker: WorkerContext | None = None,
        reload: Callable[[], Settings | LoadedSettings] | None = None,
        **changes: object,
    ) -> None:
        if urls and "listen" in changes:
            raise SettingsError("`listen`: given twice; leave it out where URLs are given")
        if urls:
            changes["listen"] = urls
        if isinstance(graph, str):
            changes["graph"], graph = graph, None
        if gateways is not None:
            gateways = tuple(gateways)
            changes["gateways"] = [each for each in gateways if isinstance(each, str)]
        self.settings = with_changes(settings, changes)
        self._started_with = self.settings if reload is None or settings is None else settings
        self._registry = registry
        self._clock = clock
        self._extra_nodes = tuple(extra_nodes)
        self._own_gateways = [each for each in gateways or () if not isinstance(each, str)]
        self._http = tuple(http)
        self._mounts = dict(mounts)
        for path in self._mounts:
            if not path.startswith("/") or path.endswith("/") or any(each in path for each in "*?#%"):
                raise SettingsError(f"mounts: {path!r} is no path for an app: expected one such as '/shop'")
        self._script = script
        self._record = record
        self._record_options = record_options
        self._introspection = introspection
        self._middleware = middleware
        self._name = name
        self._loop = loop
        self._worker = worker
        self._is_first = worker is None or worker.number == 1
        self._read_settings = reload or (lambda: self.settings)
        self._running: _Running | None = None
        self._thread: ExitStack | None = None
        self._given_graph = graph
        self._announced = False
        self._app: HostedApp | None = None
        if self.settings.brings_clients and "listen" not in self.settings.model_fields_set:
            # A robot that only dials out needs no port.
            self.settings = self.settings.model_copy(update={"listen": ()})
        if self.settings.workers == 1 or worker is not None:
            _ = self.graph  # Made here, so that the constructor raises if it is not possible.
        else:
            self._refuse_several_processes()

    def _refuse_several_processes(self) -> None:
        for argument, value in (
            ("script", self._script),
            ("record", self._record),
            ("introspection", self._introspection or None),
            ("graph", self._given_graph),
        ):
            if value is not None:
                raise SettingsError(
                    f"{argument}: sees one process only: use it with `workers = 1`, or `rwt bag record`"
                    " beside several"
                )

    @cached_property
    def graph(self) -> Graph:
        """Robot graph. It runs while the server does; nodes may join before."""
        settings = self.settings
        if settings.workers > 1 and self._worker is None:
            raise SettingsError(
                f"`workers`: {settings.workers} processes cannot share the graph of this program: use 1 here,"
                " or `Server(…).run()` or `rwt serve --workers`, where each process makes its own"
            )
        given = self._given_graph
        if isinstance(given, Graph):
            check_graph(given, settings, self._registry, self._clock)
            return given
        if given is None and self._script is not None:
            # What the robot's own nodes publish is not what it received.
            from rwt.rosbridge.bridge import GATEWAY_NODE  # Not at the top, see `_start`.

            make = only_part("script", ScriptPart).make_graph

            def given(registry: Registry, clock: Clock | None) -> Graph:
                return make(registry, clock, (GATEWAY_NODE,))

        return make_graph(settings, given, self._registry, self._clock, self._worker)

    def node(self, name: str, namespace: str = "/") -> Node:
        """Return a node in the graph, for a program on the server's event loop, or before the server starts.

        Raises:
            InvalidGraphName: the name or the namespace is not valid in ROS.
        """
        return Node(self.graph, name, namespace)

    # While it runs

    @property
    def running(self) -> bool:
        """True while clients can connect."""
        return self._running is not None

    @property
    def urls(self) -> tuple[str, ...]:
        """URLs at which the server listens, with the actual ports. Raises :exc:`NotRunning`."""
        return tuple(listener.url for listener in self._while_running.listeners)

    @property
    def bridge(self) -> Bridge:
        """Rosbridge gateway. Raises :exc:`NotRunning`."""
        return self._while_running.bridge

    @property
    def dials(self) -> tuple[OutgoingConnection, ...]:
        """Status of each outgoing connection, such as those to hubs. Raises :exc:`NotRunning`."""
        return tuple(self._while_running.connections)

    @property
    def metrics(self) -> ServerMetrics:
        """Metrics of the server. Raises :exc:`NotRunning`."""
        return self._while_running.metrics

    def asgi(self) -> HostedApp:
        """Return the server as an ASGI application (HTTP, server-sent events and WebSocket).

        An ASGI server that runs it as the whole app starts and stops it by the lifespan protocol. An app that
        mounts it below a path enters the server in its own lifespan, with ``async with``. The server itself
        listens only on URLs that were passed to it.

        Raises:
            SettingsError: the server already runs, or `workers` is not 1: use the ASGI server's own workers.
        """
        if self._app is None:
            if self._running is not None:
                raise SettingsError("asgi(): the server runs already: call it before it is started")
            if self.settings.workers > 1:
                raise SettingsError("`workers`: an ASGI server has workers of its own: use 1 with asgi()")
            if "listen" not in self.settings.model_fields_set:
                self.settings = self.settings.model_copy(update={"listen": ()})
            self._app = only_part("asgi", AsgiPart).application(self._begin)
        return self._app

    def _begin(self) -> AbstractAsyncContextManager[object]:
        """Return the context that an app's lifespan enters; empty if the server already runs."""
        return nullcontext() if self.running else self

    @property
    def _while_running(self) -> _Running:
        if self._running is None:
            raise NotRunning("the server does not run: enter it with `async with server:` or `with server:`")
        return self._running

    def announce(
        self,
        say: Callable[[str], None] | None = None,
        on_up: Callable[[Server], str] | None = None,
    ) -> None:
        """Announce once that clients can connect, and where; see :meth:`run`."""
        if not self._announced:
            self._announced = True
            (say or print_announcement)((on_up or listening)(self))
            if self._worker is None:
                tell(READY)

    def reload(self) -> None:
        """Reload certificate, tokens, roles, origins, gate rules and the secret of rosauth, as on SIGHUP.

        Clients stay connected unless they are no longer admitted, and keep their leases if the rules allow
        it. Other settings require a restart; a warning names those that differ. Call on the server's event
        loop.

        Raises:
            SettingsError: a value is invalid, or a change requires a restart; nothing has changed.
            NotRunning: the server does not run.
        """
        running = self._while_running
        read = self._read_settings()
        settings = read.settings if isinstance(read, LoadedSettings) else read
        try:
            server_tls(settings.tls)  # Raises before anything changes.
            running.bridge.access.reload(settings)
        except SettingsError as error:
            if not isinstance(read, LoadedSettings):
                raise
            raise SettingsError(read.with_places(str(error))) from None
        for reload_roles in running.reload_roles:
            reload_roles()
        warn_of_expiry(settings.tls)
        if running.metrics.globs is not None:
            running.metrics.globs.take(settings)
        if running.tls is not None:
            renew_server_tls(running.tls, settings.tls)
        self._warn_of_strangers(running.bridge.access, running.listeners, running.connections)
        changed = [name for name in changed_names(self._started_with, settings) if name not in _RELOADED]
        if changed:
            logger.warning("changed, but without effect until a restart: %s", ", ".join(changed))
        if isinstance(read, LoadedSettings) and (fixed := read.fixed(_RELOADED)):
            logger.warning(
                "not read again, since only a restart changes the environment and the command line of a"
                " process: %s",
                ", ".join(fixed),
            )

    def _on_hangup(self) -> None:
        tell_reloading()
        try:
            self.reload()
        except SettingsError as error:
            logger.error("the settings stay as they were: %s", error)
        else:
            logger.info("certificate, tokens, roles, origins and gate rules were read again from their files")
        tell(READY)

    async def ended(self) -> None:
        """Wait for the end of the service: the peer of ``stdio:`` has closed it, or the parent of this worker
        process has died. Otherwise wait forever.

        Raises:
            NotRunning: the server does not run.
        """
        ends = self._ends()  # Raises; a task group would wrap the error.
        async with anyio.create_task_group() as tasks:

            async def watch(wait: Callable[[], Awaitable[object]]) -> None:
                await wait()
                tasks.cancel_scope.cancel()

            for wait in ends:
                tasks.start_soon(watch, wait)
            await anyio.sleep_forever()

    def _ends(self) -> list[Callable[[], Awaitable[object]]]:
        """Return functions that wait for an end which the server does not cause."""
        ends: list[Callable[[], Awaitable[object]]] = [each.ended for each in self._while_running.listeners]
        if self._worker is not None:
            ends.append(only_part("supervisor", SupervisorPart).parent_ended)
        return ends

    # In a program with an event loop

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            self._running = await self._start(stack)
        return self

    async def __aexit__(self, *exc: Any) -> bool | None:
        stack = self._while_running.stack
        self._running = None
        if self._announced and self._worker is None:
            tell(STOPPING)
        try:
            return await stack.__aexit__(*exc)
        finally:
            if self._is_first:
                logger.info("the server has stopped")

    async def _start(self, stack: AsyncExitStack) -> _Running:
        # Imported on start: the gateway and the transports would add a third to the time of
        # `from rwt import Server`, and only a running server needs them.
        from rwt.access.access import Access
        from rwt.composition.listeners import Listeners
        from rwt.gateways.visitors import counted
        from rwt.observability.metrics import ServerMetrics
        from rwt.observability.unmatched import GlobCheck
        from rwt.rosapi import DISCLOSURES
        from rwt.rosbridge.bridge import Bridge
        from rwt.rosbridge.numpy_loading import NumpyLoading

        settings, graph = self.settings, self.graph
        tls = server_tls(settings.tls)
        load_encodings(settings.encodings)
        if not graph.running:
            await stack.enter_async_context(graph)
        others = [await stack.enter_async_context(each) for each in bridged_graphs(settings, graph)]
        # Nodes leave first: their timers go on while a graph takes leave of other processes.
        nodes = stack.enter_context(ExitStack())
        for other in others:
            nodes.callback(relay_between(graph, other))
        for each in (graph, *others):
            each.in_batch = Scheduler.of_loop(WRITING).batch
        ready = start_nodes(graph, settings, nodes)
        http = (*ready.http, *self._start_extra_nodes(nodes), *self._http)
        if settings.tls.auto and tls is not None:
            from rwt.composition.certificates import authority_page, renewal

            http = (*http, authority_page(settings.tls))
            stack.callback(renewal(graph.clock, tls, settings.tls).close)
        if self._record is not None or self._introspection:
            request = RecordingRequest(self._record, self._record_options, self._introspection)
            http = (*http, only_part("recorder", RecorderPart).start(graph, request, nodes))
        middleware = [] if self._middleware is None else [self._middleware]
        if self._script is not None:
            start_script = only_part("script", ScriptPart).start
            middleware.insert(0, start_script(graph, self._script, settings.bson_only_mode, nodes))
        access = Access(graph, settings, DISCLOSURES)
        stack.callback(access.close)
        bridge = Bridge(graph, settings, access, NumpyLoading())
        stack.callback(bridge.close)
        globs = GlobCheck(graph, settings)
        stack.callback(globs.close)
        http = (*http, globs.http, expiry_metrics(settings.tls))
        warn_of_expiry(settings.tls)
        gateways = self._start_gateways(access, http, stack)
        of_gateways = (counted(each.http, each.shared.counters) for each in gateways)
        extensions: list[HttpExtension[GraphView]] = [*http, *of_gateways]
        metrics = ServerMetrics(bridge, extensions, gateways)
        metrics.globs = globs
        stack.callback(metrics.close)
        if self._worker is None and (seconds := heartbeat_seconds()) is not None:
            tell(ALIVE)
            stack.callback(Periodic(graph.clock, seconds, partial(tell, ALIVE)).close)
        stack.enter_context(bounded_log())
        reload_roles = [each.reload_roles for each in (bridge, *gateways)]
        spoken = {name: accept for gateway in gateways for name, accept in gateway.websockets.items()}
        mounts = only_part("asgi", AsgiPart).mount(self._mounts) if self._mounts else None
        if mounts is not None:
            await stack.enter_async_context(mounts.running())
        ports = Listeners(
            settings, bridge, spoken, metrics, tls, extensions, middleware, self._worker, mounts
        )
        metrics.include(ports.refusals)
        connections: list[OutgoingConnection] = []
        context = ServiceContext(
            graph=graph,
            access=access,
            linger=settings.unregister_timeout,
            nodes=ready.named,
            limits=ports.limits,
            addresses=ports.addresses,
            buffers=ports.buffers,
            accept=ports.accept,
            pages=ports.pages,
            add_routes=ports.routes.append,
            add_metrics=metrics.include,
            add_connection=connections.append,
            on_reload=reload_roles.append,
        )
        for service, own in settings.active("service"):
            if isinstance(service.part, ServicePart):
                await stack.enter_async_context(service.part.run(context, own))
        listeners = [await stack.enter_async_context(ports.listen(url)) for url in settings.listen]
        if self._is_first:
            node = start_gateway_node(graph, [listener.url for listener in listeners], settings)
            stack.callback(node.close)
        if self._app is not None:
            await stack.enter_async_context(self._app.serving(ports.port))
        if self._worker is not None:
            await stack.enter_async_context(self._worker.serve_metrics(metrics.text))
        self._warn_of_strangers(access, listeners, connections)
        self._warn_of_readable_tokens(listeners)
        if self._is_first:
            ports.proxies.log()
            urls = [*(each.url for each in listeners), *(each.url for each in connections)]
            logger.info("rwt %s serves %s", version_line(), ", ".join(urls) or "the listeners of its host")
        return _Running(
            bridge, tuple(reload_roles), metrics, tuple(listeners), connections, tls, stack.pop_all()
        )

    def _start_gateways(
        self, access: Access, http: Sequence[HttpExtension], stack: AsyncExitStack
    ) -> list[Gateway]:
        graph, settings = self.graph, self.settings
        made = [partial(make_gateway, name, graph, settings, access, http) for name in settings.gateways]
        gateways: list[Gateway] = []
        for make in (*made, *(partial(make, graph, access) for make in self._own_gateways)):
            gateways.append(gateway := make())
            stack.callback(gateway.close)
        return gateways

    def _warn_of_strangers(
        self, access: Access, listeners: Iterable[Listener], connections: Iterable[OutgoingConnection]
    ) -> None:
        """Warn if other machines reach a server without authentication, also through a proxy or a hub."""
        role = access.admission.default_role
        has_proxy = bool(self.settings.proxies)
        open_at = [each.url for each in listeners if has_proxy or not is_loopback_listener(each.url)]
        open_at += [each.url for each in connections]
        if open_at and role is not None and role.unrestricted and self._is_first:
            logger.warning(
                "NO AUTHENTICATION: everybody who reaches %s may drive this robot. Set `auth.tokens`, or"
                " `auth.default_role` to a role that may less, or listen on 127.0.0.1.",
                " and ".join(open_at),
            )

    def _warn_of_readable_tokens(self, listeners: Iterable[Listener]) -> None:
        """Warn if clients send tokens over networks without encryption, unless a proxy may encrypt them."""
        urls = [each.url for each in listeners if each.url.startswith("ws://")]
        open_at = [url for url in urls if not is_loopback_listener(url)]
        if open_at and self.settings.auth.tokens and not self.settings.proxies and self._is_first:
            logger.warning(
                "UNENCRYPTED TOKENS: everybody on the network can read the tokens that clients send to %s."
                " Use `--tls auto` or a certificate (tls.certfile), or a reverse proxy with TLS (proxies).",
                " and ".join(open_at),
            )

    def _start_extra_nodes(self, stack: ExitStack) -> list[HttpExtension]:
        nodes = []
        for make in self._extra_nodes:
            nodes.append(node := make(self.graph))
            stack.callback(node.close)
        return http_of(*nodes)

    # In a program without one

    def __enter__(self) -> BlockingNode:
        from rwt.blocking import BlockingNode, ServerThread

        with ExitStack() as stack:
            thread = ServerThread(self, self._loop)
            stack.enter_context(stopped_by_signals(partial(self.graph.run_on_graph, self._on_hangup)))
            stack.enter_context(thread)
            robot = BlockingNode(self.node(self._name), self, thread)
            self._thread = stack.pop_all()
        return robot

    def __exit__(self, *exc: Any) -> bool | None:
        thread, self._thread = self._thread, None
        return None if thread is None else thread.__exit__(*exc)

    def run(
        self,
        main: Main | None = None,
        *,
        announce: Callable[[str], None] | None = None,
        on_up: Callable[[Server], str] | None = None,
        in_worker: InWorker | None = None,
    ) -> int:
        """Serve until SIGINT, SIGTERM or :meth:`ended`, with as many processes as the setting `workers`.

        A worker process that ends is restarted.

        Args:
            main: robot program; the server ends when it returns. A coroutine function gets this server and
                runs on its event loop; a signal cancels it. A plain function gets a node with blocking
                methods and runs in the main thread, with the server in another; a signal raises an exception
                in it. In both cases, ``finally`` and ``with`` run before clients are disconnected.
            announce: called with the result of `on_up`; default: print it.
            on_up: called on the event loop when clients can connect; default: return where the server
                listens. Each worker calls it; the result of the first is announced.
            in_worker: called in each worker process with its number and a function that serves; returns the
                exit code. May set up logging first.

        Returns:
            The exit code for the program: 0, unless a worker process failed.

        Raises:
            SettingsError: a file in the settings is invalid, or the settings do not allow several processes.
            TransportError: a URL is invalid, or a port is taken.
            GraphError: the graph cannot connect to others.
            ServerError: the recording cannot be written.
        """
        if self.settings.workers > 1 and self._worker is None:
            if main is not None:
                raise SettingsError("`workers`: the robot's own program runs in one process: use 1 here")
            if not hasattr(signal, "pthread_sigmask") or not hasattr(socket, "SO_REUSEPORT"):
                raise SettingsError("`workers`: this system has no processes that share a port: use 1 here")

            def serve(worker: WorkerContext, settings: Settings) -> None:
                self._as_worker(worker, settings).run(announce=worker.announce, on_up=on_up)

            run_workers = only_part("supervisor", SupervisorPart).run
            return run_workers(self.settings, serve, announce or print_announcement, in_worker)
        raise_descriptor_limit()
        if main is None or _is_coroutine_function(main):
            backend, options = LOOPS[self._loop]
            say = partial(self.announce, announce, on_up)
            try:
                anyio.run(self._until_stopped, main, say, backend=backend, backend_options=options)
            except BaseExceptionGroup as group:
                if isinstance(ending := exit_of(group), SystemExit):
                    raise ending from None
                raise
            return 0
        try:
            with self as robot:
                robot.node.run(partial(self.announce, announce, on_up))
                main(robot)
        except (KeyboardInterrupt, Stopped):
            pass
        return 0

    def _as_worker(self, worker: WorkerContext, settings: Settings) -> Server:
        """Return this server as one of several processes; only the first runs what must exist once."""
        return Server(
            settings=settings,
            registry=self._registry,
            clock=self._clock,
            extra_nodes=self._extra_nodes if worker.number == 1 else (),
            gateways=(*settings.gateways, *self._own_gateways),
            http=self._http,
            mounts=self._mounts,
            middleware=self._middleware,
            loop=self._loop,
            worker=worker,
            reload=self._read_settings,
        )

    async def _until_stopped(
        self,
        main: Callable[[Server], Awaitable[object]] | None,
        say: Callable[[], None],
    ) -> None:
        stop = anyio.Event()
        failure: Exception | None = None
        handlers: dict[int, Callable[[], object]] = dict.fromkeys(STOP_SIGNALS, stop.set)
        if HANGUP is not None:
            handlers[HANGUP] = lambda: stop.set() if terminal_is_gone() else self._on_hangup()
        with on_signals(handlers):
            async with self, anyio.create_task_group() as tasks:
                say()

                async def end_after(wait: Callable[[], Awaitable[object]]) -> None:
                    await wait()
                    tasks.cancel_scope.cancel()

                tasks.start_soon(end_after, self.ended)
                tasks.start_soon(end_after, stop.wait)
                try:
                    await (anyio.sleep_forever() if main is None else main(self))
                except Exception as error:
                    failure = error  # Raised below, and not in a group.
                tasks.cancel_scope.cancel()
        if failure is not None:
            raise failure


def exit_of(error: BaseException) -> BaseException:
    """Return the error that ended the event loop, without the exception groups of tasks."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def _is_coroutine_function(main: Main) -> TypeIs[Callable[[Server], Awaitable[object]]]:
    return inspect.iscoroutinefunction(main)


def print_announcement(text: str) -> None:
    """Print an announcement; on standard error if standard output carries the protocol."""
    over_stdio = "listening on stdio:" in text.splitlines()
    print(text, flush=True, file=sys.stderr if over_stdio else sys.stdout)


def listening(server: Server) -> str:
    """Describe where a running server is reached: a line per URL, and the URLs for other machines."""
    lines = []
    for url in server.urls:
        lines.append(f"listening on {url}")
        lines += [f"  from other machines: {other}" for other in _from_other_machines(url)]
    return "\n".join([*lines, *(f"dialing {dialed.url}" for dialed in server.dials)])


def _from_other_machines(url: str) -> list[str]:
    """Return the URLs for a URL that stands for every address of this machine."""
    scheme, _, rest = url.partition("://")
    host, _, port = rest.rpartition(":")
    if host not in ("0.0.0.0", "[::]"):
        return []
    family = socket.AF_INET if host == "0.0.0.0" else socket.AF_INET6
    return [
        f"{scheme}://{f'[{address}]' if family is socket.AF_INET6 else address}:{port}"
        for address in _own_addresses(family)
    ]


def _own_addresses(family: socket.AddressFamily) -> list[str]:
    """Return the addresses of this machine, the one with a route to other networks first."""
    first = outward_address(family)
    found = [] if first is None else [str(first)]
    with suppress(OSError):
        found += [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None, family)]
    return [each for each in dict.fromkeys(found) if not ipaddress.ip_address(each).is_loopback]
