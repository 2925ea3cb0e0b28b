"""How many lines of the log somebody outside may cause, so that no client fills a disk with its mistakes."""

from __future__ import annotations

from rwt_access.quotas import MessageRate


class LogRate:
    """A burst of lines, then so many a second; those beyond it are counted and told of with the next one.

    Args:
        per_second: lines in the long run.
        burst: lines at once.
    """

    __slots__ = ("_rate", "left_out")

    def __init__(self, per_second: int, burst: int) -> None:
        self._rate = MessageRate(per_second, burst)
        self.left_out = 0

    def admit(self, text: str, now: float) -> str | None:
        """The line to write in place of `text`, or None to leave it out.

        Args:
            text: the line.
            now: seconds on a clock that never goes back.
        """
        if not self._rate.take(now):
            self.left_out += 1
            return None
        left_out, self.left_out = self.left_out, 0
        return f"{text} ({left_out} lines like it were left out)" if left_out else text
