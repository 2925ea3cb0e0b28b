"""The GID of an entity: XXH3-128 of its liveliness token, the lower 64 bits first, each little-endian."""

from __future__ import annotations


def gid_of(token_key: str) -> bytes:
    """The 16 bytes that identify who declared that token."""
    import xxhash  # Comes with the extra `zenoh`; needed by nothing else.

    return xxhash.xxh3_128(token_key.encode()).digest()[::-1]


__all__ = ["gid_of"]
