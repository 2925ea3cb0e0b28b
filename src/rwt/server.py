"""The assembled server: a graph, the nodes in it, the rosbridge gateway, its listeners and its pages."""

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
from typing import TYPE_CHECKING, Any, Protocol, Self

import anyio

from rwt.access.access import Access
from rwt.access.audit import bounded_log
from rwt.access.origins import is_loopback_listener
from rwt.access.settings import SettingsError
from rwt.blocking import LOOPS, BlockingNode, ServerThread, exit_of
from rwt.composition.certificates import CertificateRenewal, authority_page
from rwt.composition.extensions import load_encodings
from rwt.composition.gateways import make_gateway
from rwt.composition.graphs import check_graph, make_graph
from rwt.composition.listeners import Listeners
from rwt.composition.nodes import (
    ReadyNode,
    http_of,
    start_gateway_node,
    start_nodes,
    start_recording,
    start_script,
)
from rwt.composition.webrtc import media_routes, webrtc_media, webrtc_peers
from rwt.gateways.rosbridge.bridge import GATEWAY_NODE, Bridge
from rwt.gateways.rosbridge.numpy_loading import NumpyLoading
from rwt.gateways.visitors import counted
from rwt.nodes.rosapi import DISCLOSURES
from rwt.observability.metrics import ServerMetrics
from rwt.observability.supervision import READY, STOPPING, Heartbeat, tell, tell_reloading
from rwt.settings.sources import with_changes
from rwt.signals import HANGUP, STOP_SIGNALS, Stopped, on_signals, stopped_by_signals, terminal_is_gone
from rwt.tls.tls import renew_server_tls, server_tls
from rwt_graph.api import Graph
from rwt_graph.errors import NotRunning
from rwt_graph.nodes.node import Node
from rwt_transports.drivers.sockets import raise_descriptor_limit
from rwt_transports.relay.dial import check_dial_url

if TYPE_CHECKING:
    from ssl import SSLContext

    from typing_extensions import TypeIs

    from rwt.access.graph_view import GraphView
    from rwt.blocking import Loop
    from rwt.composition.graphs import MakeGraph
    from rwt.gateways.base import Gateway, MakeGateway
    from rwt.settings.models import Settings
    from rwt.workers.worker import InWorker, WorkerContext
    from rwt_graph.clock import Clock
    from rwt_interfaces.registry import Registry
    from rwt_transports.asgi import App, AsgiApplication, AsgiMount
    from rwt_transports.endpoint import Accept
    from rwt_transports.http.routes import HttpExtension
    from rwt_transports.listener import Listener
    from rwt_transports.relay.dial import RelayStatus

logger = logging.getLogger(__name__)

Middleware = Callable[["Accept"], "Accept"]
"""Stands between the transports and the bridge: is given the accept function of each listener, and returns
the one to use."""

Main = Callable[["Server"], Awaitable[object]] | Callable[["BlockingNode"], object]
"""A robot's own program: a coroutine function on the server's event loop, or a plain function beside it."""


class HasRoles(Protocol):
    """Owner of clients whose roles may change while the server runs."""

    def reload_roles(self) -> None:
        """Give each client the role that the settings give it now, and end what that does not allow."""


@dataclass(frozen=True, slots=True)
class _Running:
    """Parts of a server that exist only while it runs."""

    bridge: Bridge
    gateways: tuple[HasRoles, ...]
    metrics: ServerMetrics
    listeners: tuple[Listener, ...]
    tls: SSLContext | None
    stack: AsyncExitStack


class Server:
    """A robot graph and a rosbridge server in front of it, put together from settings.

    In a program with an event loop of its own (asyncio, trio, uvloop)::

        async with Server("ws://127.0.0.1:9090") as server:
            robot = server.node("my_robot")

    In one without, the server runs on a loop in a thread of its own, and what the block is given is a node
    whose methods wait (:class:`BlockingNode`)::

        with Server("ws://127.0.0.1:9090") as robot:
            robot.publish("/battery", {"data": 12.6}, "std_msgs/Float32")

    :meth:`run` serves until a signal comes. Leaving the block, or the signal, closes each client with code
    1001. A server runs once.

    Args:
        urls: where to listen, for example ``ws://127.0.0.1:9090``, instead of the setting `listen`. The
            schemes are those of :data:`rwt_transports.schemes.SCHEMES`; ``wss`` and ``tcps`` need the
            settings `tls.certfile` and `tls.keyfile`.
        settings: how it is; the defaults by default. Without a URL anywhere it listens on the default one,
            or, with `dial.urls`, on none.
        graph: a graph that exists, or what makes one, such as a class; else the setting `graph` decides. One
            that runs already goes on running when the server ends.
        registry: the interfaces of a graph that is made here; those of `distro` and `interfaces` by default.
        clock: of a graph that is made here; the wall clock by default.
        extra_nodes: each is called with the graph when it runs, before anybody can connect, and makes a node
            that is closed with the server; what the node brings to HTTP is its attribute `http`.
        gateways: the protocols beside rosbridge, in place of the setting `gateways`; ``[]`` for none. A name
            is one that the setting takes; a function makes a gateway of your own, from the running graph and
            the access rules (:class:`rwt.gateways.base.Gateway`). None leaves the setting as it is.
        http: further pages, sections of the index page, and metrics.
        mounts: ASGI apps of others by the path at which they are, such as ``{"/shop": app}``: HTTP, streams,
            WebSocket without subprotocols, and lifespan. They make their own rules; the limits of the port
            hold for them.
        script: a ``.toml`` or ``.py`` file that says what a robot for tests does.
        record: an MCAP file to which all topics are written.
        introspection: whether calls and goals are published on topics, as ROS 2 can, and recorded with
            `record`.
        middleware: what stands between the transports and the bridge, for example to inject faults.
        name: of the node that a ``with`` block is given.
        loop: which event loop :meth:`run` and a ``with`` block start.
        worker: the process that this is, of several with the same ports; :meth:`run` makes those.
        reload: reads the settings again, for :meth:`reload`; by default the same settings are used, and only
            the files that they name are read again.
        changes: settings by name, instead of those in `settings`: ``Server(demo=True, distro="noetic")``.

    Attributes:
        settings: all of them, with `urls` and `changes`.

    Raises:
        SettingsError: a setting or an argument that cannot be used, or that contradicts another.
        GraphError: the options of Zenoh cannot be used.
        BadUrl: one of `dial.urls` is not the URL of a hub.
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
        mounts: Mapping[str, App] = MappingProxyType({}),
        script: Path | None = None,
        record: Path | None = None,
        introspection: bool = False,
        middleware: Middleware | None = None,
        name: str = "robot",
        loop: Loop = "asyncio",
        worker: WorkerContext | None = None,
        reload: Callable[[], Settings] | None = None,
        **changes: object,
    ) -> None:
        if urls and "listen" in changes:
            raise SettingsError("`listen`: given twice; leave it out where URLs are given")
        if urls:
            changes["listen"] = urls
        if isinstance(graph, str):
            changes["graph"], graph = graph, None
        own_gateways: list[MakeGateway] = []
        if gateways is not None:
            names: list[str] = []
            for each in gateways:
                if isinstance(each, str):
                    names.append(each)
                else:
                    own_gateways.append(each)
            changes["gateways"] = names
        self.settings = with_changes(settings, changes)
        self._registry = registry
        self._clock = clock
        self._extra_nodes = tuple(extra_nodes)
        self._own_gateways = own_gateways
        self._http = tuple(http)
        self._mounts = dict(mounts)
        for path in self._mounts:
            if not path.startswith("/") or path.endswith("/") or any(each in path for each in "*?#%"):
                raise SettingsError(f"mounts: {path!r} is no path for an app: expected one such as '/shop'")
        self._script = script
        self._record = record
        self._introspection = introspection
        self._middleware = middleware
        self._name = name
        self._loop = loop
        self._worker = worker
        self._read_settings = reload or (lambda: self.settings)
        self._running: _Running | None = None
        self._thread: ExitStack | None = None
        self._given_graph = graph
        self._announced = False
        self._app: AsgiApplication | None = None
        if self.settings.dial.urls and "listen" not in self.settings.model_fields_set:
            # A robot that only dials out needs no port.
            self.settings = self.settings.model_copy(update={"listen": ()})
        for url in self.settings.dial.urls:
            check_dial_url(url)
        if self.settings.workers == 1 or worker is not None:
            self.graph  # noqa: B018 - a graph that cannot be made is the caller's mistake, raised to the caller
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
        """The robot graph; it runs while the server does, and nodes may join it before."""
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
            from rwt.testing.observed_graph import ObservedGraph  # Only what is tested is observed.

            # What the robot's own nodes publish is not what it received.
            given = partial(ObservedGraph, only=(GATEWAY_NODE,))
        return make_graph(settings, given, self._registry, self._clock, self._worker)

    def node(self, name: str, namespace: str = "/") -> Node:
        """A node in the graph, for a program on the server's event loop, or for one that has not started it.

        Raises:
            InvalidGraphName: the name or the namespace is not one that ROS allows.
        """
        return Node(self.graph, name, namespace)

    # While it runs

    @property
    def running(self) -> bool:
        """True while clients can connect."""
        return self._running is not None

    @property
    def urls(self) -> tuple[str, ...]:
        """Where it listens, with the ports it has got. Raises :exc:`NotRunning` where it does not."""
        return tuple(listener.url for listener in self._while_running.listeners)

    @property
    def bridge(self) -> Bridge:
        """The rosbridge clients. Raises :exc:`NotRunning` while it does not run."""
        return self._while_running.bridge

    @property
    def dials(self) -> tuple[RelayStatus, ...]:
        """Status of each connection to a hub (`dial.urls`). Raises :exc:`NotRunning` if it does not run."""
        return tuple(self._while_running.metrics.dials)

    @property
    def metrics(self) -> ServerMetrics:
        """Metrics of the server. Raises :exc:`NotRunning` while it does not run."""
        return self._while_running.metrics

    def asgi(self) -> AsgiApplication:
        """The server as an ASGI application: HTTP, server-sent events and WebSocket, for any ASGI server, or
        for an app to mount below a path.

        It then listens on no port but those that it was given by URL. An ASGI server that runs it as the
        whole app starts and stops it by the lifespan protocol; an app that mounts it enters the server in its
        own lifespan, with ``async with``.

        Raises:
            SettingsError: the server runs already, or has several worker processes, which is for the ASGI
                server to do.
        """
        from rwt_transports.asgi import AsgiApplication  # Few servers are mounted in an app.

        if self._app is None:
            if self._running is not None:
                raise SettingsError("asgi(): the server runs already: call it before it is started")
            if self.settings.workers > 1:
                raise SettingsError("`workers`: an ASGI server has workers of its own: use 1 with asgi()")
            if "listen" not in self.settings.model_fields_set:
                self.settings = self.settings.model_copy(update={"listen": ()})
            self._app = AsgiApplication(self._begin)
        return self._app

    def _begin(self) -> AbstractAsyncContextManager[object]:
        """Return what the lifespan of an app enters: the server, or nothing if it runs already."""
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
        """Say that clients can connect, and where, unless it was said already; see :meth:`run`."""
        if not self._announced:
            self._announced = True
            (say or print_announcement)((on_up or listening)(self))
            if self._worker is None:
                tell(READY)

    def reload(self) -> None:
        """Read certificate, tokens, roles, origins and the secret of rosauth again, as SIGHUP asks for.

        Connections are kept, but for clients that are not let in any more. The other settings stay as they
        are until the server is started again. To be called on the server's event loop.

        Raises:
            SettingsError: something cannot be used; then all stays as it was.
            NotRunning: it does not run.
        """
        running = self._while_running
        settings = self._read_settings()
        server_tls(settings.tls)  # Raises before anything has changed.
        running.bridge.access.reload(settings)
        running.bridge.reload_roles()
        for gateway in running.gateways:
            gateway.reload_roles()
        if running.tls is not None:
            renew_server_tls(running.tls, settings.tls)
        self._warn_of_strangers(running.bridge.access, running.listeners)

    def _on_hangup(self) -> None:
        tell_reloading()
        try:
            self.reload()
        except SettingsError as error:
            logger.error("the settings stay as they were: %s", error)
        else:
            logger.info("certificate, tokens, roles and origins were read again")
        tell(READY)

    async def ended(self) -> None:
        """Wait until there is nobody to serve: the program at the other end of ``stdio:`` has closed it, or
        the parent of this worker process has died. Without either this waits forever.

        Raises:
            NotRunning: it does not run.
        """
        async with anyio.create_task_group() as tasks:

            async def watch(wait: Callable[[], Awaitable[object]]) -> None:
                await wait()
                tasks.cancel_scope.cancel()

            for wait in self._ends():
                tasks.start_soon(watch, wait)
            await anyio.sleep_forever()

    def _ends(self) -> list[Callable[[], Awaitable[object]]]:
        """Return functions that each wait for something that ends the server."""
        ends: list[Callable[[], Awaitable[object]]] = [each.ended for each in self._while_running.listeners]
        if self._worker is not None:
            from rwt.workers.supervisor import parent_sentinel

            ends.append(partial(anyio.wait_readable, parent_sentinel()))
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
        return await stack.__aexit__(*exc)

    async def _start(self, stack: AsyncExitStack) -> _Running:
        settings, graph = self.settings, self.graph
        tls = server_tls(settings.tls)
        load_encodings(settings.encodings)
        nodes = stack.enter_context(ExitStack())
        if not graph.running:
            await stack.enter_async_context(graph)
        ready = start_nodes(graph, settings, nodes)
        http = (*ready.http, *self._start_extra_nodes(nodes), *self._http)
        if settings.tls.auto and tls is not None:
            http = (*http, authority_page(settings.tls))
            stack.callback(CertificateRenewal(graph.clock, tls, settings.tls).close)
        if self._record is not None or self._introspection:
            start_recording(graph, self._record, nodes, introspection=self._introspection)
        middleware = [] if self._middleware is None else [self._middleware]
        if self._script is not None:
            middleware.insert(0, start_script(graph, self._script, settings, nodes))
        access = Access(graph, settings, DISCLOSURES)
        stack.callback(access.close)
        bridge = Bridge(graph, settings, access, NumpyLoading())
        stack.callback(bridge.close)
        gateways = self._start_gateways(access, http, stack)
        of_gateways = (counted(each.http, each.shared.counters) for each in gateways)
        extensions: list[HttpExtension[GraphView]] = [*http, *of_gateways]
        metrics = ServerMetrics(bridge, extensions, gateways)
        stack.callback(metrics.close)
        if self._worker is None:
            stack.callback(Heartbeat(graph.clock).close)
        stack.enter_context(bounded_log())
        reloaded: list[HasRoles] = [*gateways]
        spoken = {name: accept for gateway in gateways for name, accept in gateway.websockets.items()}
        mounts = [await stack.enter_async_context(mount.running()) for mount in self._make_mounts()]
        doors = Listeners(
            settings, bridge, spoken, metrics, tls, extensions, middleware, self._worker, mounts
        )
        if settings.webrtc.enabled:
            peers = webrtc_peers(settings.webrtc, doors.limits, doors.addresses, doors.buffers)
            # They have ended when what they publish on leaves the graph.
            media = webrtc_media(graph, access, settings.unregister_timeout, stack)
            doors.peers = await stack.enter_async_context(peers)
            doors.media = media_routes(doors.peers, ready.video, media)
            if media is not None:
                reloaded.append(media[0])
            metrics.include(doors.peers.metrics)
        listeners = [await stack.enter_async_context(doors.listen(url)) for url in settings.listen]
        if self._worker is None or self._worker.number == 1:
            node = start_gateway_node(graph, [listener.url for listener in listeners], settings)
            stack.callback(node.close)
        if self._app is not None:
            mounted = {it: await stack.enter_async_context(doors.asgi(loopback=it)) for it in (True, False)}
            stack.enter_context(self._app.serve(mounted))
        for url in settings.dial.urls:
            metrics.dials.append(await stack.enter_async_context(doors.dial(url)))
        if self._worker is not None:
            await stack.enter_async_context(self._worker.metrics.serve(metrics.text))
        self._warn_of_strangers(access, listeners)
        return _Running(bridge, tuple(reloaded), metrics, tuple(listeners), tls, stack.pop_all())

    def _start_gateways(
        self, access: Access, http: Sequence[HttpExtension], stack: AsyncExitStack
    ) -> list[Gateway]:
        """Start the gateways of the settings and of the program; `stack` closes them."""
        graph, settings = self.graph, self.settings
        made = [partial(make_gateway, name, graph, settings, access, http) for name in settings.gateways]
        gateways: list[Gateway] = []
        for make in (*made, *(partial(make, graph, access) for make in self._own_gateways)):
            gateways.append(gateway := make())
            stack.callback(gateway.close)
        return gateways

    def _make_mounts(self) -> Iterable[AsgiMount]:
        if self._mounts:
            from rwt_transports.asgi import AsgiMount  # Few servers have an app.

            yield from (AsgiMount(path, app) for path, app in self._mounts.items())

    def _warn_of_strangers(self, access: Access, listeners: Iterable[Listener]) -> None:
        """Say that other machines reach a server which lets everybody do everything."""
        role = access.admission.default_role
        open_at = [each.url for each in listeners if not is_loopback_listener(each.url)]
        is_first = self._worker is None or self._worker.number == 1
        if open_at and role is not None and role.unrestricted and is_first:
            logger.warning(
                "NO AUTHENTICATION: everybody who reaches %s may drive this robot. Set `auth.tokens`, or"
                " `auth.default_role` to a role that may less, or listen on 127.0.0.1.",
                " and ".join(open_at),
            )

    def _start_extra_nodes(self, stack: ExitStack) -> list[HttpExtension]:
        """Start the program's own nodes; returns what they bring to HTTP."""
        nodes = []
        for make in self._extra_nodes:
            nodes.append(node := make(self.graph))
            stack.callback(node.close)
        return http_of(*nodes)

    # In a program without one

    def __enter__(self) -> BlockingNode:
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
        """Serve until SIGINT or SIGTERM comes, or :meth:`ended`; with the setting `workers` by that many
        processes, of which one that ends is started again.

        Args:
            main: the robot's own program; when it returns, the server ends. A coroutine function is given
                this server, and runs on its event loop; a signal cancels it. A plain function is given a node
                whose methods wait, and runs in the program's main thread with the server in another; a signal
                raises an exception in it, at any point. Either way ``finally`` and ``with`` of the program
                run before clients are disconnected. None serves and does nothing else.
            announce: called with what `on_up` returns; prints it by default.
            on_up: called when clients can connect, on the event loop; by default says where the server
                listens. With workers each process calls it, and what the first returns is announced.
            in_worker: called in each worker process with its number and a function that serves; returns the
                exit code, and may set up the log before.

        Returns:
            The exit code for the program: 0, unless a worker process failed.

        Raises:
            SettingsError: a file that the settings name cannot be used, or processes cannot share what is
                asked.
            TransportError: a URL that cannot be used, or a port that is taken.
            GraphError: the graph cannot be joined with others.
            ServerError: the recording cannot be written.
        """
        if self.settings.workers > 1 and self._worker is None:
            from rwt.workers.worker import run_workers  # Imported only where there are several.

            if main is not None:
                raise SettingsError("`workers`: the robot's own program runs in one process: use 1 here")
            if not hasattr(signal, "pthread_sigmask") or not hasattr(socket, "SO_REUSEPORT"):
                raise SettingsError("`workers`: this system has no processes that share a port: use 1 here")

            def serve(worker: WorkerContext, settings: Settings) -> None:
                self._as_worker(worker, settings).run(announce=worker.announce, on_up=on_up)

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
        """This server as one of several processes; what there can be only once is in the first."""
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


def _is_coroutine_function(main: Main) -> TypeIs[Callable[[Server], Awaitable[object]]]:
    return inspect.iscoroutinefunction(main)


def print_announcement(text: str) -> None:
    """Print that a server is ready; on standard error where standard output belongs to the protocol."""
    over_stdio = "listening on stdio:" in text.splitlines()
    print(text, flush=True, file=sys.stderr if over_stdio else sys.stdout)


def listening(server: Server) -> str:
    """Where a running server is reached: a line for each URL, and what to write on other machines."""
    lines = []
    for url in server.urls:
        lines.append(f"listening on {url}")
        lines += [f"  from other machines: {other}" for other in _from_other_machines(url)]
    return "\n".join([*lines, *(f"dialing {dialed.url}" for dialed in server.dials)])


def _from_other_machines(url: str) -> list[str]:
    """A URL that stands for every address of this machine, with those that can be written instead."""
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
    """Addresses of this machine in its networks, the one that leads out of them first."""
    found = []
    with socket.socket(family, socket.SOCK_DGRAM) as probe, suppress(OSError):
        # Addresses for documentation (RFC 5737, RFC 3849): it sends nothing, and only looks for a route.
        probe.connect(("192.0.2.1" if family is socket.AF_INET else "2001:db8::1", 9))
        found.append(str(probe.getsockname()[0]))
    with suppress(OSError):
        found += [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None, family)]
    return [each for each in dict.fromkeys(found) if not ipaddress.ip_address(each).is_loopback]
