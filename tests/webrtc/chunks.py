"""Fragments as aiortc hands them over."""

from __future__ import annotations

from aiortc.rtcsctptransport import DataChunk


class Chunk(DataChunk):
    """DATA chunk."""

    def __init__(
        self,
        tsn: int,
        flags: int,
        stream_seq: int,
        user_data: bytes,
        stream_id: int = 7,
        protocol: int = 51,
    ) -> None:
        super().__init__(flags)
        self.tsn, self.stream_seq, self.user_data = tsn, stream_seq, user_data
        self.stream_id, self.protocol = stream_id, protocol
