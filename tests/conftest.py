"""Fixtures that all folders share.

Tests marked ``anyio`` are coroutines. They run on asyncio and with the default distribution.
Every event loop is tried in ``tests/contract``, and where a module or folder overrides these fixtures.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from typing import Final, TypeVar

import pytest
from hypothesis import HealthCheck, settings

from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_interfaces.steps import Steps
from tests.processes import running

T = TypeVar("T")

# On a busy machine, slow examples of property tests say nothing about the code.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")

#: A day in 2026, so that stamps are neither 0 nor small.
START_NS: Final = 1_767_225_600_000_000_000

#: Compiled once for all tests: what these know does not change.
REGISTRIES: Final = {name: Registry(distro) for name, distro in DISTROS.items()}


def counted(steps: Steps[T]) -> tuple[T, int]:
    """Run all steps; their result, and the number of pauses between them."""
    pauses = 0
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result, pauses
        pauses += 1


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Where a demo robot is, in a process of its own."""
    with running("serve", "--demo", "ws://127.0.0.1:0", stderr=subprocess.DEVNULL) as (_, listening):
        yield listening


@pytest.fixture(scope="module")
def anyio_backend() -> object:
    """Event loop of the tests marked ``anyio``."""
    return "asyncio"


@pytest.fixture
def distro(request: pytest.FixtureRequest) -> str:
    """Name of the distribution, or of another by ``parametrize("distro", …, indirect=True)``."""
    return str(getattr(request, "param", "jazzy"))
