"""Requests to the republisher: the goal of its action, or the request of its service."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from rwt_tf2.transform import bare

DEFAULT_RATE: Final = 10.0
"""Messages a second where the request says 0."""

HIGHEST_RATE: Final = 100.0
"""Higher rates are taken as this one."""

LOWEST_RATE: Final = 0.001
"""Lower rates are taken as this one: those of the smallest floats have no period."""

MOST_FRAMES: Final = 1000
"""More frames in one request are refused."""


class RequestMessage(Protocol):
    """Fields common to the goal of the action and the request of the service."""

    source_frames: Sequence[str]
    target_frame: str
    angular_thres: float
    trans_thres: float
    rate: float


class RequestRefused(ValueError):
    """A request is rejected; the text says what to change."""


@dataclass(frozen=True, slots=True)
class Request:
    """Subscription to transforms.

    Attributes:
        target: target frame; empty for the parent of each frame, the mode that sends the tree.
        sources: source frames; empty for all.
        angular: minimum rotation for sending a transform again, in radians.
        linear: minimum translation for sending a transform again, in metres.
        period: seconds between updates.
    """

    target: str
    sources: tuple[str, ...]
    angular: float
    linear: float
    period: float

    @classmethod
    def read(cls, message: RequestMessage) -> Request:
        """Parse a message; a leading slash of names is removed (TFR-03).

        Raises:
            RequestRefused: a rate or threshold is NaN, a rate is negative, or there are too many frames.
        """
        for name in ("angular_thres", "trans_thres", "rate"):
            value = getattr(message, name)
            if not math.isfinite(value):
                raise RequestRefused(f"{name} must be a finite number, got {value}")
        if message.rate < 0:
            raise RequestRefused(f"rate must not be negative, got {message.rate:g}")
        if len(message.source_frames) > MOST_FRAMES:
            raise RequestRefused(
                f"at most {MOST_FRAMES} source_frames, got {len(message.source_frames)}; none means all"
            )
        # The original divides by a rate of 0 (TFR-01).
        rate = max(LOWEST_RATE, min(message.rate or DEFAULT_RATE, HIGHEST_RATE))
        sources = tuple(dict.fromkeys(map(bare, message.source_frames)))
        return cls(bare(message.target_frame), sources, message.angular_thres, message.trans_thres, 1 / rate)
