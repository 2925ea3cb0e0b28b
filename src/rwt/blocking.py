"""Server for programs without an event loop: it runs in a thread, and its node's methods block."""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import Future
from typing import Final, Self

import anyio

from rwt.errors import ServerError
from rwt.server import LOOPS, Loop, Server, exit_of
from rwt.signals import Stopped
from rwt_graph.errors import NotRunning
from rwt_graph.nodes.blocking import BlockingGraphNode
from rwt_graph.nodes.node import Node
from rwt_participant.errors import WrongThread
from rwt_participant.threads.pool import call_soon_threadsafe

_WAIT_SECONDS: Final = 1.0
"""Maximum duration of one wait: some systems deliver Ctrl-C to a waiting thread only after it."""


class ServerThread:
    """Context in which a server runs on an event loop in its own thread."""

    def __init__(self, server: Server, loop: Loop) -> None:
        self._server = server
        self._loop = loop
        self._up: Future[None] = Future()
        self._stop: Future[None] = Future()
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        # Daemon: must not keep the program alive after its main thread.
        self._thread = threading.Thread(target=self._run, name="rwt server", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        try:
            self._up.result()
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._leave()
        # NotRunning in the block is a consequence: raise the cause instead.
        if self._failure is not None and (error is None or isinstance(error, NotRunning)):
            raise self._what_ended_it() from self._failure

    def wait(self) -> None:
        """Wait for the end of the service, see :meth:`Server.ended`.

        Raises:
            WrongThread: called in a callback.
            SystemExit: raised by a callback, which ended the loop.
            ServerError: the loop ended for another reason.
        """
        if threading.current_thread() is self._thread:
            raise WrongThread("a blocking call on the server's own thread would wait for itself")
        while not self._ended.wait(_WAIT_SECONDS):
            pass
        if self._failure is not None:
            raise self._what_ended_it() from self._failure

    def _leave(self) -> None:
        if not self._stop.done():
            self._stop.set_result(None)
        self._thread.join()

    def _what_ended_it(self) -> BaseException:
        error = None if self._failure is None else exit_of(self._failure)
        if isinstance(error, ServerError | SystemExit):
            return error
        return ServerError(f"the event loop of the server was lost: {error!r}")

    def _run(self) -> None:
        backend, options = LOOPS[self._loop]
        try:
            anyio.run(self._serve, backend=backend, backend_options=options)
        except BaseException as error:
            # Raised on the caller's thread, also SystemExit and KeyboardInterrupt.
            self._failure = error
        if not self._up.done():
            self._up.set_exception(self._failure or NotRunning("the server was stopped before it was up"))
        self._ended.set()

    async def _serve(self) -> None:
        stop = anyio.Event()
        call_soon = call_soon_threadsafe()

        def leave(_: Future[None]) -> None:
            with contextlib.suppress(RuntimeError):  # The loop has already ended.
                call_soon(stop.set)

        self._stop.add_done_callback(leave)
        try:
            async with self._server, anyio.create_task_group() as tasks:
                tasks.start_soon(self._watch_end)
                self._up.set_result(None)
                await stop.wait()
                tasks.cancel_scope.cancel()
        except BaseException as error:
            # Do not raise: the cancellation of a loop's last task could not be handled any more.
            self._failure = error

    async def _watch_end(self) -> None:
        await self._server.ended()
        self._ended.set()


class BlockingNode(BlockingGraphNode):
    """Node with blocking methods, in the graph of its own server; see :class:`rwt_graph.Node`.

    Attributes:
        server: server of the graph.
    """

    def __init__(self, inner: Node, server: Server, thread: ServerThread) -> None:
        super().__init__(inner)
        self.server = server
        self._thread = thread

    def spin(self) -> None:
        """Announce the server, and wait for Ctrl-C, SIGTERM or the end of the service (:meth:`Server.ended`).

        Raises:
            WrongThread: called in a callback, on the graph's own thread.
            SystemExit: raised by a callback.
            ServerError: the server's event loop ended.
        """
        with contextlib.suppress(KeyboardInterrupt, Stopped):
            if not self._loop.here:
                self.server.announce()
            self._thread.wait()
