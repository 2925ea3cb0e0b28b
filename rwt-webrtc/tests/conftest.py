"""Fixtures of `tests/conftest.py`, which pytest does not load for this folder."""

from __future__ import annotations

from tests.conftest import anyio_backend, distro, url

__all__ = ["anyio_backend", "distro", "url"]
