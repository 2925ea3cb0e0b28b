"""What tests of several rooms share.

Tests marked ``anyio`` are coroutines, and run on asyncio and on trio; those that are marked
``asyncio_only``, too, run on asyncio alone.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from typing import Final

import pytest
from hypothesis import settings

from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.processes import running

# Property tests have no deadline: on a busy machine a slow example says nothing about the code.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

#: A day in 2026, so that stamps are neither 0 nor small.
START_NS: Final = 1_767_225_600_000_000_000

#: Compiled once for all tests: what these know does not change.
REGISTRIES: Final = {name: Registry(distro) for name, distro in DISTROS.items()}


@pytest.hookimpl(tryfirst=True)
def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "anyio_backend" in metafunc.fixturenames and metafunc.definition.get_closest_marker("asyncio_only"):
        metafunc.definition.add_marker(pytest.mark.parametrize("anyio_backend", ["asyncio"]))


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Where a demo robot is, in a process of its own."""
    with running("serve", "--demo", "ws://127.0.0.1:0", stderr=subprocess.DEVNULL) as (_, listening):
        yield listening


@pytest.fixture(params=sorted(DISTROS))
def distro(request: pytest.FixtureRequest) -> str:
    """The name of each distribution."""
    return str(request.param)
