"""Parameters of the master, mirrored: reading is synchronous, and changes are sent in order."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Final

import anyio
import anyio.lowlevel

from rwt.extensions.ros1.wire import xmlrpc
from rwt_graph.backend import ParameterTree
from rwt_graph.errors import Ros1Error, WireError
from rwt_participant.errors import ParameterRejected

if TYPE_CHECKING:
    from rwt.extensions.ros1.session import Session
    from rwt_participant.messages import ParameterValue

logger = logging.getLogger(__name__)

#: Maximum bytes of the parameters, which contain robot descriptions.
_MOST_BYTES: Final = 64 * 1024 * 1024

#: Seconds after a change by this process in which an update may be older than it, and is read again.
_SETTLE_SECONDS: Final = 2.0

#: Seconds between attempts while the master does not answer.
_RETRY_SECONDS: Final = 1.0


class MasterParameters(ParameterTree):
    """Tree of parameters that follows the master's.

    Values of this process that the master lacks, as before joining and after its restart, are set there.
    """

    def __init__(self) -> None:
        super().__init__(max_bytes=_MOST_BYTES)
        self._own: dict[str, None] = {}
        # Names whose values are sent, deleted or read, in order.
        self._requests: deque[tuple[str, str]] = deque()
        self._wake = anyio.Event()
        self._is_joined = False
        self._settled_at = 0.0
        self.warn_once: Callable[[str], None] = logger.warning

    def set(self, name: str, value: ParameterValue) -> None:
        try:
            for _ in xmlrpc.encode_response(value):
                pass
        except WireError as error:
            raise ParameterRejected(f"parameter {name[:80]}: {error}") from error
        super().set(name, value)
        self._own[name] = None
        self._request("setParam", name)

    def delete(self, name: str) -> None:
        super().delete(name)
        self._own.pop(name, None)
        self._request("deleteParam", name)

    def _request(self, method: str, name: str) -> None:
        if self._is_joined:
            self._requests.append((method, name))
            self._wake.set()

    def on_update(self, key: str, value: ParameterValue) -> None:
        """Apply a change by another node; an empty table means that the name was deleted."""
        name = "/" + key.strip("/")
        if self._requests or time.monotonic() < self._settled_at:
            self._request("getParam", name)
        else:
            self._apply(name, value)

    def _apply(self, name: str, value: ParameterValue) -> None:
        try:
            if value == {} or value is None:
                if self.has(name):
                    super().delete(name)
            else:
                super().set(name, value)
        except ParameterRejected as error:
            self.warn_once(f"parameter {name[:200]} of the ROS 1 master is not used: {error}")

    def resynchronise(self) -> None:
        """Read all parameters again, and set those of this process again if they are missing."""
        self._is_joined = False
        self._wake.set()

    async def run(self, session: Session) -> None:
        """Follow the master until the task is cancelled."""
        while True:
            self._wake = anyio.Event()
            try:
                if not self._is_joined:
                    await self.join(session)
                while self._requests and self._is_joined:
                    await self._send(session, *self._requests[0])
                    self._requests.popleft()
                    self._settled_at = time.monotonic() + _SETTLE_SECONDS
            except Ros1Error as error:
                session.on_master_error(error)
                await anyio.sleep(_RETRY_SECONDS)
                continue
            if self._is_joined:
                await self._wake.wait()

    async def _send(self, session: Session, method: str, name: str) -> None:
        """Carry out one request. A value is set as it is now; nothing is set if it was deleted meanwhile."""
        if method == "getParam":
            self._apply(name, await session.try_master(method, name))
        elif method == "deleteParam":
            await session.try_master(method, name)
        elif self.has(name):
            await session.call_master(method, session.monitor.name, name, self.get(name))

    async def join(self, session: Session) -> None:
        """Read all parameters, and follow their changes; raises Ros1Error."""
        monitor = session.monitor
        found = await session.call_master("subscribeParam", monitor.name, monitor.uri, "/")
        tables = found if isinstance(found, dict) else {}
        self._is_joined = True
        self._requests.clear()
        self._settled_at = inf  # What changes meanwhile is read again.
        lost = {name: self.get(name) for name in self._own if not _holds(tables, name) and self.has(name)}
        for key in self.get("/").keys() - tables.keys():
            super().delete(key)
        for key, value in tables.items():
            self._apply(f"/{key}", value)
            await anyio.lowlevel.checkpoint()
        for name, value in lost.items():
            super().set(name, value)
            self._request("setParam", name)
        self._settled_at = time.monotonic() + _SETTLE_SECONDS


def is_below(name: str, ancestor: str) -> bool:
    """Return True if a parameter is another one, or within it."""
    return name == ancestor or name.startswith(ancestor.rstrip("/") + "/")


def _holds(table: ParameterValue, name: str) -> bool:
    """Return True if a tree of parameters has a value of that name."""
    for part in name.strip("/").split("/"):
        if not isinstance(table, dict) or part not in table:
            return False
        table = table[part]
    return True
