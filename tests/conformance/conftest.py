"""Fixtures shared by the tests of the suite."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture
def quiet() -> Iterator[None]:
    """Without the log of servers that are asked wrong things on purpose."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)
