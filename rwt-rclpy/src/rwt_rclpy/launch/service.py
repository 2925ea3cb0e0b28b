"""`launch.LaunchService`: visits launch descriptions, and handles events one at a time."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import FrameType

from rwt_rclpy.launch.entities import (
    Event,
    LaunchContext,
    LaunchDescription,
    LaunchDescriptionEntity,
    LaunchError,
)
from rwt_rclpy.launch.events import IncludeLaunchDescription, Shutdown
from rwt_rclpy.launch.logging import get_logger


class LaunchService:
    """Runner of launch descriptions, until all started processes have ended.

    Ctrl-C ends the launch; a terminal also sends it to the started processes, and with `noninteractive` it is
    forwarded. SIGTERM ends it, too, and is forwarded as SIGINT. A second Ctrl-C has no effect: processes
    that do not end get stronger signals.

    Args:
        argv: command line, for `context.argv`.
        noninteractive: True without a terminal.
    """

    def __init__(
        self, *, argv: Iterable[str] | None = None, noninteractive: bool = False, debug: bool = False
    ) -> None:
        self.context = LaunchContext(argv=[*(argv or ())], noninteractive=noninteractive)
        self._log = get_logger("launch")
        if debug:
            self._log.setLevel("DEBUG")
        self._pending: set[asyncio.Future[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._return_code = 0

    def include_launch_description(self, launch_description: LaunchDescription) -> None:
        """Visit a description, now or once it runs; from any thread."""
        self.emit_event(IncludeLaunchDescription(launch_description))

    def emit_event(self, event: Event) -> None:
        """Emit an event; from any thread."""
        if self._loop is None:
            self.context.emit_event_sync(event)
        else:
            self._loop.call_soon_threadsafe(self.context.emit_event_sync, event)

    def shutdown(self, force_sync: bool = False) -> None:
        """End the launch; from any thread. No-op if it does not run."""
        if self._loop is not None:
            self.emit_event(Shutdown(reason="LaunchService.shutdown() called"))

    def run(self, *, shutdown_when_idle: bool = True) -> int:
        """Run the launch in the main thread.

        Returns:
            0, or 1 if the launch itself failed.

        Raises:
            LaunchError: it is called in another thread, which receives no signals.
        """
        if threading.current_thread() is not threading.main_thread():
            raise LaunchError("LaunchService.run() is for the main thread; use run_async() in others")
        return asyncio.run(self.run_async(shutdown_when_idle=shutdown_when_idle))

    async def run_async(self, *, shutdown_when_idle: bool = True) -> int:
        """Run in the current event loop; see :meth:`run`. Signals are handled in the main thread only."""
        self._loop, self._return_code = asyncio.get_running_loop(), 0
        self.context.begin()
        try:
            with self._signals(self._loop):
                while not (self.context.is_shutdown and self._is_idle()):
                    if shutdown_when_idle and self._is_idle():
                        self.context.emit_event_sync(Shutdown(reason="idle"))
                    if self.context.events:
                        self._guarded(self.context.events.popleft())
                        await asyncio.sleep(0)  # Let started tasks run.
                        continue
                    self.context.news.clear()
                    await self.context.news.wait()
        finally:
            self._loop = None
        return self._return_code

    def _is_idle(self) -> bool:
        return not self.context.events and not self._pending

    def _guarded(self, event: Event) -> None:
        try:
            self._handle(event)
        except Exception as error:
            # Launch files are programs: any exception ends the launch and its processes.
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        what = str(error) if isinstance(error, LaunchError) else f"{type(error).__name__}: {error}"
        self._log.error(f"caught exception in launch: {what}")
        self._return_code = 1
        if not self.context.is_shutdown:
            self.context.is_shutdown = True
            self.context.emit_event_sync(Shutdown(reason=what))

    def _handle(self, event: Event) -> None:
        if isinstance(event, Shutdown):
            self.context.is_shutdown = True
        if isinstance(event, IncludeLaunchDescription):
            self._visit([event.launch_description])
        for handler in tuple(self.context.handlers):
            if not handler.matches(event):
                continue
            self.context.push_locals()
            try:
                self._visit(handler.handle(event, self.context) or ())
            finally:
                self.context.pop_locals()

    def _visit(self, entities: Iterable[LaunchDescriptionEntity]) -> None:
        """Visit entities, and after each the entities that it returns, before the next one."""
        waiting: list[LaunchDescriptionEntity] = list(entities)
        while waiting:
            entity = waiting.pop(0)
            waiting[:0] = entity.visit(self.context) or ()
            future = entity.get_asyncio_future()
            if future is not None and not future.done() and future not in self._pending:
                self._pending.add(future)
                future.add_done_callback(self._done)

    def _done(self, future: asyncio.Future[None]) -> None:
        self._pending.discard(future)
        if not future.cancelled() and (error := future.exception()) is not None:
            self._fail(error)
        self.context.news.set()

    @contextmanager
    def _signals(self, loop: asyncio.AbstractEventLoop) -> Iterator[None]:
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def answer(number: int, frame: FrameType | None) -> None:
            loop.call_soon_threadsafe(partial(self._on_signal, signal.Signals(number)))

        before = {number: signal.signal(number, answer) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: signal.Signals) -> None:
        if self.context.is_shutdown:
            self._log.warning(f"interrupted again ({number.name}), ignoring: the launch ends already")
            return
        if number == signal.SIGINT:
            self._log.warning("user interrupted with ctrl-c (SIGINT)")
        self.context.emit_event_sync(Shutdown(reason=number.name, due_to_sigint=number == signal.SIGINT))


def run_description(
    description: LaunchDescription,
    arguments: dict[str, str],
    *,
    argv: Sequence[str] = (),
    noninteractive: bool = False,
) -> int:
    """Run a description with values for its arguments; return the exit code."""
    service = LaunchService(argv=argv, noninteractive=noninteractive)
    service.context.launch_configurations.update(arguments)
    service.include_launch_description(description)
    return service.run()
