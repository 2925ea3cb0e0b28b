"""Decompression of recordings, piece by piece: no claim about the size of the result is trusted."""

from __future__ import annotations

from bz2 import BZ2Decompressor
from collections.abc import Iterator
from io import BytesIO
from typing import IO, Final, cast

_PIECE_BYTES: Final = 1024 * 1024
_INPUT_BYTES: Final = 64 * 1024


def unpack(data: bytes, compression: str, most_bytes: int) -> bytes | bytearray:
    """Return the content of compressed data.

    Args:
        compression: ``zstd``, ``lz4``, ``bz2``, or empty or ``none`` for data that is not compressed.
        most_bytes: maximum size of the content.

    Raises:
        ValueError: the content is larger, or the compression is not supported.
        Exception: the data is damaged; each library has errors of its own.
    """
    if compression in ("", "none"):
        if len(data) > most_bytes:
            raise too_large(most_bytes)
        return data
    content = bytearray()
    for piece in unpacked_pieces(BytesIO(data), compression):
        if len(content) + len(piece) > most_bytes:
            raise too_large(most_bytes)
        content += piece
    return content


def too_large(most_bytes: int) -> ValueError:
    """Return the error for content above the limit."""
    return ValueError(f"unpacked, it has more than {most_bytes} bytes; --chunk-bytes allows more")


def unpacked_pieces(source: IO[bytes], compression: str) -> Iterator[bytes]:
    """Yield the content of a compressed file in pieces of at most 1 MiB.

    Raises:
        ValueError: the compression is not supported.
        Exception: the data is damaged; each library has errors of its own.
    """
    if compression == "zstd":
        from zstandard import ZstdDecompressor

        with ZstdDecompressor().stream_reader(source, read_across_frames=True, closefd=False) as reader:
            while piece := reader.read(_PIECE_BYTES):
                yield piece
        return
    decompressor = _decompressor(compression)
    while data := source.read(_INPUT_BYTES):
        while piece := decompressor.decompress(data, _PIECE_BYTES):
            yield piece
            if decompressor.eof or decompressor.needs_input:
                break
            data = b""
        if decompressor.eof:
            return


def _decompressor(compression: str) -> BZ2Decompressor:
    if compression == "bz2":
        return BZ2Decompressor()
    if compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return cast("BZ2Decompressor", LZ4FrameDecompressor())  # It has the same methods.
    raise ValueError(f"the compression {compression[:40]!r} is not supported")
