"""How fast a recording can be played."""

from __future__ import annotations

from typing import Final

SLOWEST: Final = 0.001
FASTEST: Final = 1000.0


def checked_rate(rate: float) -> float:
    """A rate that can be played; raises ValueError for any other."""
    if not SLOWEST <= rate <= FASTEST:
        raise ValueError(f"a recording is played at a rate from {SLOWEST} to {FASTEST:g}, not {rate}")
    return rate


__all__ = ["FASTEST", "SLOWEST", "checked_rate"]
