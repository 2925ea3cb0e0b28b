"""Next sample of a topic, for clients that want only one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.delivery.throttle import Encoded
    from rwt_graph.api import Sample
    from rwt_protocol.frames import Burst, Frame


class NextSample:
    """Gate that keeps only the first sample, undecoded and not encoded.

    Attributes:
        sample: that one, None before it has come.

    Args:
        on_sample: called once it is there.
    """

    is_open: Final = False

    def __init__(self, on_sample: Callable[[], None]) -> None:
        self._on_sample = on_sample
        self.sample: Sample | None = None

    def offer(self, encoded: Encoded) -> None:
        """Take the sample, if it is the first."""
        if self.sample is None:
            self.sample = encoded.sample.detach()
            self._on_sample()

    def send(self, frame: Frame) -> None:
        """No-op: a gate that is not open is offered samples."""

    def join(self, burst: Burst) -> bool:
        """No-op, like :meth:`send`."""
        return False

    def note_sent(self, at: float) -> None:
        """No-op: no sample bypasses this gate."""
