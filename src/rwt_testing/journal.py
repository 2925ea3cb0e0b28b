"""The journal of what reached the robot: messages, calls and goals, in order, readable from any thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_program.messages import Message

#: Entries kept of each kind and name; the oldest make room.
KEPT = 1000

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


class Journal:
    """What was received, bounded. Written on the graph's thread, read from any.

    Args:
        kept: entries kept of each kind and name.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._kept = kept
        self._changed = threading.Condition()
        self._entries: dict[tuple[Kind, str], deque[Received]] = {}
        self._version = 0

    def add(self, entry: Received) -> None:
        """Add an entry, and wake threads that wait for one."""
        with self._changed:
            entries = self._entries.setdefault((entry.kind, entry.name), deque(maxlen=self._kept))
            entries.append(entry)
            self._version += 1
            self._changed.notify_all()

    def of(self, kind: Kind, name: str) -> tuple[Received, ...]:
        """What came of one kind under one name, oldest first."""
        with self._changed:
            return tuple(self._entries.get((kind, name), ()))

    def everything(self, kind: Kind) -> Mapping[str, tuple[Received, ...]]:
        """What came of one kind, by name, the names sorted."""
        with self._changed:
            found = {name: tuple(kept) for (each, name), kept in self._entries.items() if each is kind}
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
            else:
                for key, entries in self._entries.items():
                    self._entries[key] = deque((e for e in entries if not only(e)), maxlen=self._kept)
            self._version += 1
