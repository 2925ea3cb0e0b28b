"""Fragments as aiortc hands them over."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Chunk:
    tsn: int
    flags: int
    stream_seq: int
    user_data: bytes
    stream_id: int = 7
    protocol: int = 51

    @property
    def body(self) -> bytes:
        return self.user_data
