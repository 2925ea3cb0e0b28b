"""Budgets of the audit: bytes that one source may fill, and repeated events that are counted."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from rwt.access.quotas import RateLimit

if TYPE_CHECKING:
    from collections.abc import Iterator

Source = tuple[str, str]
"""Source of events: the name of a credential, and a network address."""

OTHERS: Final[Source] = ("", "others")
"""Source that is charged for those above the maximum number."""

#: Maximum number of sources with a budget of their own.
_MAX_SOURCES: Final = 1000

#: Fraction of a file that one source may fill at once.
_SOURCE_FRACTION: Final = 1 / 8

#: Number of sources that one credential may be, each with all of its budget.
_SOURCES_OF_CREDENTIAL: Final = 4

#: Smallest burst in bytes, where files are tiny.
_MIN_BURST_BYTES: Final = 16 * 1024


class AuditBudget:
    """Budget of one kind of lines, for each source and for each credential.

    A source gets an eighth of a file at once, then an eighth of all files in `keep_seconds`; a credential
    four times as much. So one credential needs nearly twice that time to rotate away what others did. What
    exceeds the budget is counted by decision.

    Args:
        keep_seconds: time in which two credentials that write all they may fill the files.
    """

    def __init__(self, file_bytes: int, files: int, keep_seconds: float) -> None:
        self._burst = max(file_bytes * _SOURCE_FRACTION, _MIN_BURST_BYTES)
        self._rate = file_bytes * max(files - 1, 0.5) / keep_seconds * _SOURCE_FRACTION
        self._sources: dict[Source, RateLimit] = {}
        self._credentials: dict[str, RateLimit] = {}
        self._left_out: dict[Source, Counter[str]] = {}

    def take(self, source: Source, size: int, now: float) -> bool:
        """Return True if a line of this size may be written; `now` in seconds on a monotonic clock."""
        bucket = self._bucket_of(source, now)
        credential = self._credentials.get(source[0])
        if credential is None:
            times = _SOURCES_OF_CREDENTIAL
            credential = self._credentials[source[0]] = RateLimit(self._rate * times, self._burst * times)
        if not bucket.take(now, size):
            return False
        if not credential.take(now, size):
            bucket.give_back(size)
            return False
        return True

    def _bucket_of(self, source: Source, now: float) -> RateLimit:
        bucket = self._sources.get(source)
        if bucket is None and len(self._sources) >= _MAX_SOURCES:
            self._sources = {each: left for each, left in self._sources.items() if not left.is_full(now)}
            if len(self._sources) >= _MAX_SOURCES:
                source = OTHERS
                bucket = self._sources.get(source)
        if bucket is None:
            bucket = self._sources[source] = RateLimit(self._rate, self._burst)
        return bucket

    def leave_out(self, source: Source, decision: str, count: int = 1) -> None:
        """Count events that are over the budget."""
        if source not in self._left_out and len(self._left_out) >= _MAX_SOURCES:
            source = OTHERS
        self._left_out.setdefault(source, Counter())[decision] += count

    @property
    def has_left_out(self) -> bool:
        """True if events were counted that no line states yet."""
        return bool(self._left_out)

    def take_left_out(self, size: int, now: float, *, at_end: bool) -> Iterator[tuple[Source, Counter[str]]]:
        """Yield the counted events of each source whose budget admits a line again.

        Args:
            size: size of such a line.
            now: seconds on a monotonic clock.
            at_end: True to yield all of them: the audit is closed.
        """
        for source in tuple(self._left_out):
            if at_end or self.take(source, size, now):
                yield source, self._left_out.pop(source)
