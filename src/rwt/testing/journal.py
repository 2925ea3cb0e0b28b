"""The journal of what reached the robot: messages, calls and goals, in order, readable from any thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from operator import attrgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_participant.messages import Message

#: Entries kept of each kind and name; the oldest make room.
KEPT = 1000

#: Bytes kept of all together; the oldest of what takes most make room, so that a camera's pictures do not
#: push out the one command that a test waits for.
KEPT_BYTES = 64 * 1024 * 1024

#: What an entry counts besides its message.
_ENTRY = 512

#: What the server publishes under its clients' name, and every node by itself.
OF_THE_SERVER = frozenset(("/client_count", "/connected_clients", "/rosout", "/parameter_events", "/clock"))


class Kind(StrEnum):
    """The kinds of entries."""

    MESSAGE = "message"
    CALL = "call"
    GOAL = "goal"


@dataclass(frozen=True, slots=True)
class Received:
    """One message, request or goal.

    Attributes:
        kind: which of them.
        name: absolute name of the topic, service or action.
        payload: what it holds.
        node: absolute name of the node that published it; empty for calls and goals.
        stamp_ns: the graph clock's time, nanoseconds since the epoch.
    """

    kind: Kind
    name: str
    payload: Payload
    node: str
    stamp_ns: int

    @property
    def message(self) -> Message:
        """The typed message; shared, to be treated as read-only."""
        return self.payload.value()

    @property
    def json(self) -> str:
        """The message as clients of this distribution see it."""
        return bytes(self.payload.json()).decode()


class _Entries:
    """What came of one kind under one name, and how many bytes it takes."""

    __slots__ = ("bytes", "kept")

    def __init__(self) -> None:
        self.kept: deque[tuple[Received, int]] = deque()
        self.bytes = 0

    def add(self, entry: Received) -> int:
        """Add an entry; returns its size."""
        size = _ENTRY + entry.payload.kept_size
        self.kept.append((entry, size))
        self.bytes += size
        return size

    def drop_oldest(self) -> int:
        """Make room; returns how much."""
        _, size = self.kept.popleft()
        self.bytes -= size
        return size

    def drop(self, only: Callable[[Received], bool]) -> int:
        """Forget what `only` says yes to; returns how many bytes that makes free."""
        before = self.bytes
        self.kept = deque((entry, size) for entry, size in self.kept if not only(entry))
        self.bytes = sum(size for _, size in self.kept)
        return before - self.bytes


class Journal:
    """What was received, bounded. Written on the graph's thread, read from any.

    Args:
        kept: entries kept of each kind and name.
        kept_bytes: bytes kept of all together, each message in the form in which it came.

    Attributes:
        bytes: how many are kept.
    """

    def __init__(self, kept: int = KEPT, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept = kept
        self._kept_bytes = kept_bytes
        self._changed = threading.Condition()
        self._entries: dict[tuple[Kind, str], _Entries] = {}
        self._version = 0
        self.bytes = 0

    def add(self, entry: Received) -> None:
        """Add an entry, and wake threads that wait for one."""
        with self._changed:
            entries = self._entries.setdefault((entry.kind, entry.name), _Entries())
            self.bytes += entries.add(entry)
            if len(entries.kept) > self._kept:
                self.bytes -= entries.drop_oldest()
            while self.bytes > self._kept_bytes:
                largest = max(self._entries.values(), key=attrgetter("bytes"))
                self.bytes -= largest.drop_oldest()
            self._version += 1
            self._changed.notify_all()

    def of(self, kind: Kind, name: str) -> tuple[Received, ...]:
        """What came of one kind under one name, oldest first."""
        with self._changed:
            entries = self._entries.get((kind, name))
            return () if entries is None else tuple(entry for entry, _ in entries.kept)

    def everything(self, kind: Kind) -> Mapping[str, tuple[Received, ...]]:
        """What came of one kind, by name, the names sorted."""
        with self._changed:
            found = {
                name: tuple(entry for entry, _ in entries.kept)
                for (each, name), entries in self._entries.items()
                if each is kind
            }
        return dict(sorted(found.items()))

    @property
    def version(self) -> int:
        """Grows with every entry."""
        return self._version

    def wait(self, seen: int, seconds: float) -> None:
        """Block until there is more than at version `seen`, or for `seconds`."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != seen, seconds)

    def clear(self, only: Callable[[Received], bool] | None = None) -> None:
        """Forget everything, or what `only` says yes to."""
        with self._changed:
            if only is None:
                self._entries.clear()
                self.bytes = 0
            else:
                for entries in self._entries.values():
                    self.bytes -= entries.drop(only)
            self._version += 1
