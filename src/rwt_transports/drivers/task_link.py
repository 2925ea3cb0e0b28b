"""Link of a driver that is served by two anyio tasks: one reads, one writes."""

from __future__ import annotations

from abc import ABC, abstractmethod

import anyio

from rwt_transports.api import NO_CALLBACKS, DriverCallbacks


class TaskLink(ABC):
    """Link whose bytes are moved by two tasks; implements :class:`rwt_transports.api.Link`.

    Subclasses read and write. Their :meth:`_write` waits with :meth:`_woken` until there may be something to
    take, and ends once `_closing` is True and everything taken has been sent.

    Life cycle: **new** until :meth:`run`; **running**; **closing** after :meth:`close`, until everything is
    sent; **lost** when either task ends: callbacks are `NO_CALLBACKS`.

    Attributes by purpose: ``_callbacks`` (connection), ``_scope`` (cancels both tasks), ``_awake`` (set if
    there may be something to take), ``_reading`` (set unless reading is paused), ``_closing``.
    """

    __slots__ = ("_awake", "_callbacks", "_closing", "_reading", "_scope")

    def __init__(self) -> None:
        self._callbacks: DriverCallbacks = NO_CALLBACKS
        self._scope = anyio.CancelScope()
        self._awake = anyio.Event()
        self._reading = anyio.Event()
        self._reading.set()
        self._closing = False

    # -- Link --------------------------------------------------------------------------------------------

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        self._callbacks = callbacks

    def wake(self) -> None:
        self._awake.set()

    @abstractmethod
    def finish(self) -> None:
        """Half-close, once everything taken has been sent."""

    def close(self) -> None:
        self._closing = True
        self._awake.set()

    def abort(self) -> None:
        self._scope.cancel()

    def pause(self) -> None:
        if self._reading.is_set():
            self._reading = anyio.Event()

    def resume(self) -> None:
        self._reading.set()

    # -- tasks -------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Read and write until either ends the connection."""
        try:
            with self._scope:
                async with anyio.create_task_group() as tasks:
                    tasks.start_soon(self._read)
                    await self._write()
                    # The reader would wait for a peer that has no more to be written to.
                    tasks.cancel_scope.cancel()
        finally:
            self._callbacks.lost()
            self._callbacks = NO_CALLBACKS

    async def _woken(self) -> None:
        await self._awake.wait()
        self._awake = anyio.Event()

    @abstractmethod
    async def _read(self) -> None: ...

    @abstractmethod
    async def _write(self) -> None: ...
