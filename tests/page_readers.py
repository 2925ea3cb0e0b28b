"""Readers of the pages of nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rwt_transports.http.routes import WorkAccount
from rwt_transports.shared_pool import Holder


class CountedWork(WorkAccount):
    """Work that is counted, and waits only if a test says so.

    Attributes:
        seconds: that were counted.
        excess: seconds that it is beyond its rate.
    """

    def __init__(self, excess: float = 0.0) -> None:
        self.seconds = 0.0
        self._excess = excess

    @property
    def excess(self) -> float:
        return self._excess

    def add(self, seconds: float, kind: str) -> None:
        self.seconds += seconds


class NobodyInParticular:
    """A reader of whom nothing is asked but whether an answer may last."""

    is_admitted = True
    holder = Holder()

    @property
    def work(self) -> CountedWork:
        raise NotImplementedError

    def may_subscribe(self, topic: str) -> bool:
        raise NotImplementedError

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        return lambda: None


class SeesNothing:
    """A reader who may subscribe to no topic."""

    is_admitted = True
    holder = Holder()

    def __init__(self) -> None:
        self.work = CountedWork()

    def may_subscribe(self, topic: str) -> bool:
        return False

    def while_allowed(self, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        raise NotImplementedError
