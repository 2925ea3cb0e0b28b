"""A driver's link that two tasks of anyio serve: one reads, one writes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

import anyio

from rwt_transports.api import DriverCallbacks


class NoCallbacks:
    """Stands in for those of a connection that has ended, so that its link does not keep it; satisfies
    :class:`rwt_transports.api.DriverCallbacks`."""

    def receive(self, data: bytes) -> None:
        """Drop it."""

    def get_buffer(self) -> None:
        """There is none."""

    def buffer_updated(self, count: int) -> None:
        """Drop it."""

    def take(self) -> None:
        """There is nothing."""

    def progress(self) -> None:
        """Nobody waits for it."""

    def eof(self) -> None:
        """It is over already."""

    def lost(self) -> None:
        """It is over already."""


NO_CALLBACKS: Final[DriverCallbacks] = NoCallbacks()


class TaskLink(ABC):
    """What two tasks move between the network and a connection; satisfies :class:`rwt_transports.api.Link`.

    A subclass says how to read and how to write. Its :meth:`_write` waits with :meth:`_woken` until there may
    be something to take, and ends once `_closing` is set and what was taken has been sent.
    """

    __slots__ = ("_awake", "_callbacks", "_closing", "_reading", "_scope")

    def __init__(self) -> None:
        self._callbacks: DriverCallbacks = NO_CALLBACKS  # until it is attached
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
            self._callbacks = NO_CALLBACKS

    async def _woken(self) -> None:
        await self._awake.wait()
        self._awake = anyio.Event()

    @abstractmethod
    async def _read(self) -> None: ...

    @abstractmethod
    async def _write(self) -> None: ...
