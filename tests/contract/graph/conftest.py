"""Parameters and fixtures of the contract tests: a running harness of each backend."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Final

import pytest

from rwt_graph.api import Limitation
from tests.contract.graph.harness import LIMITED, UNSTABLE, GoalDiary, Harness, load
from tests.contract.graph.ros2_pair import HAS_ROS

#: Harnesses by name; loaded on use.
BACKENDS: Final = {
    "memory": "tests.contract.graph.backends:MemoryHarness",
    "queue": "tests.contract.graph.queue_backend:QueueHarness",
    "ros1-alone": "tests.contract.graph.backends:LoneRos1Harness",
    "zenoh": "tests.contract.graph.backends:ZenohHarness",
    "zenoh-alone": "tests.contract.graph.backends:LoneZenohHarness",
} | ({"ros2": "tests.contract.graph.backends:Ros2Harness"} if HAS_ROS else {})

_OPTION: Final = "--graph-backend"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(_OPTION, action="append", default=[], help="harness of a backend, as MODULE:CLASS")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "harness" in metafunc.fixturenames:
        others = {each: each for each in metafunc.config.getoption(_OPTION, default=[])}
        backends = others or BACKENDS
        metafunc.parametrize("harness", backends.values(), ids=backends.keys(), indirect=True)


def _case(test: pytest.Function) -> str:
    """Return the name of a test, with its parameter `how` if it has one."""
    how = test.callspec.params.get("how")
    return test.originalname if how is None else f"{test.originalname}[{how}]"


@pytest.fixture
async def harness(
    request: pytest.FixtureRequest, anyio_backend: object, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Harness]:
    made, test = load(request.param)(), request.node
    if Limitation.GOAL_REASONS in made.graph.limitations and test.originalname in UNSTABLE:
        pytest.skip(Limitation.GOAL_REASONS.value)
    limitation = LIMITED.get(_case(test))
    if limitation in made.graph.limitations:
        request.applymarker(pytest.mark.xfail(reason=limitation.value))
    elif why := made.differences.get(test.originalname):
        request.applymarker(pytest.mark.xfail(reason=why))
    made.patch(monkeypatch)
    async with made.graph:
        yield made


@pytest.fixture
def diary() -> GoalDiary:
    return GoalDiary()
