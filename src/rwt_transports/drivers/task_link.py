"""A driver's link that two tasks of anyio serve: one reads, one writes."""

from __future__ import annotations

from abc import ABC, abstractmethod

import anyio

from rwt_transports.api import DriverCallbacks


class TaskLink(ABC):
    """What two tasks move between the network and a connection; satisfies :class:`rwt_transports.api.Link`.

    A subclass says how to read and how to write. Its :meth:`_write` waits with :meth:`_woken` until there may
    be something to take, and ends once `_closing` is set and what was taken has been sent.
    """

    __slots__ = ("_awake", "_callbacks", "_closing", "_reading", "_scope")

    def __init__(self) -> None:
        self._scope = anyio.CancelScope()
        self._awake = anyio.Event()
        self._reading = anyio.Event()
        self._reading.set()
        self._closing = False

    # -- Link --------------------------------------------------------------------------------------------

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        """Call `callbacks` from now on."""
        self._callbacks = callbacks

    def wake(self) -> None:
        """Let the writing task take what there is."""
        self._awake.set()

    @abstractmethod
    def finish(self) -> None:
        """End what is sent, once what was taken has been sent."""

    def close(self) -> None:
        """Close once what was taken has been sent."""
        self._closing = True
        self._awake.set()

    def abort(self) -> None:
        """Close at once."""
        self._scope.cancel()

    def pause(self) -> None:
        """Let the reading task wait before its next read."""
        if self._reading.is_set():
            self._reading = anyio.Event()

    def resume(self) -> None:
        """Let the reading task go on."""
        self._reading.set()

    # -- tasks -------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Read and write until either ends the connection."""
        try:
            with self._scope:
                async with anyio.create_task_group() as tasks:
                    tasks.start_soon(self._read)
                    await self._write()
                    tasks.cancel_scope.cancel()
        finally:
            self._callbacks.lost()

    async def _woken(self) -> None:
        await self._awake.wait()
        self._awake = anyio.Event()

    @abstractmethod
    async def _read(self) -> None: ...

    @abstractmethod
    async def _write(self) -> None: ...
