"""ROS time as a number, and as a message spells it."""

from __future__ import annotations

from typing import Final

NANOSECONDS: Final = 1_000_000_000
"""Nanoseconds per second."""
