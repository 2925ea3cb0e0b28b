"""Pytest plugin: options, a marker and fixtures for robots in tests.

pytest imports this module at the start of every run, so the fixtures import their dependencies on first use.
"""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rwt.extensions.testing import ObservedGraph, ScriptedRobot
    from rwt.extensions.testing.pytest_plugin.environment import Environment, RobotServer
    from rwt.extensions.testing.virtual_time import VirtualTime

_SECTION = "rosbridge transcript"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--rwt-distro` and the ini values."""
    group = parser.getgroup("rwt", "robots for tests (robot-web-tools)")
    group.addoption(
        "--rwt-distro",
        metavar="DISTRO",
        help="ROS distribution of robots in tests, such as kilted; `both`: jazzy, then noetic (default"
        " jazzy)",
    )
    parser.addini("rwt_distro", "the same as --rwt-distro", default="")
    parser.addini("rwt_interfaces", "folders of .msg, .srv and .action files", type="paths", default=[])
    parser.addini(
        "rwt_settings",
        "settings of rwt_server, KEY=VALUE on each line, for example limits.connections=2",
        type="linelist",
        default=[],
    )
    parser.addini(
        "rwt_transcript_lines", "lines of the transcript in the report of a failing test", default="100"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line(
        "markers",
        "rwt(distro=None, demo=False, interfaces=(), settings={}): how the robot of this test is: its ROS"
        " distribution (or both), whether the demo robot takes part, folders of interfaces, server settings",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Parametrize a test that asks for several distributions."""
    if "rwt_distro" not in metafunc.fixturenames:
        return
    from rwt.extensions.testing.pytest_plugin.options import distros_of

    try:
        distros = distros_of(metafunc.config, list(metafunc.definition.iter_markers("rwt")))
    except pytest.UsageError as error:
        # Without pytest's own frames.
        raise pytest.Collector.CollectError(str(error)) from None
    if len(distros) > 1:
        metafunc.parametrize("rwt_distro", distros, indirect=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the wire transcript to the report of a failing test."""
    report = yield
    # Imported on first use.
    environments = sys.modules.get("rwt.extensions.testing.pytest_plugin.environment")
    if environments is not None and report.failed:
        from rwt.extensions.testing.pytest_plugin.options import transcript_lines

        for text in environments.transcripts(transcript_lines(item.config)):
            report.sections.append((_SECTION, text))
    return report


@pytest.fixture
def rwt_distro(request: pytest.FixtureRequest) -> str:
    """Return the ROS distribution of this test's robot, such as "jazzy" or "noetic"."""
    chosen = getattr(request, "param", None)
    if chosen is not None:
        return str(chosen)
    from rwt.extensions.testing.pytest_plugin.options import distros_of

    return distros_of(request.config, list(request.node.iter_markers("rwt")))[0]


@pytest.fixture
def _rwt_environment(request: pytest.FixtureRequest, rwt_distro: str) -> Iterator[Environment]:
    from rwt.extensions.testing.pytest_plugin.environment import open_environment
    from rwt.extensions.testing.pytest_plugin.options import options_of

    with ExitStack() as stack:
        try:
            environment = stack.enter_context(open_environment(options_of(request, rwt_distro)))
        except pytest.UsageError as error:
            pytest.fail(str(error), pytrace=False)
        yield environment


@pytest.fixture
def rwt_graph(_rwt_environment: Environment) -> ObservedGraph:
    """Return a robot graph that runs in its own thread; its nodes may be used from the test's thread."""
    return _rwt_environment.graph


@pytest.fixture
def rwt_clock(_rwt_environment: Environment) -> VirtualTime:
    """Return the virtual time of the robot: its clock only moves with `rwt_clock.advance(seconds)`."""
    return _rwt_environment.virtual_time


@pytest.fixture
def rwt_robot(_rwt_environment: Environment) -> ScriptedRobot:
    """Return a robot that the test scripts, and that records what it receives."""
    return _rwt_environment.robot


@pytest.fixture
def rwt_server(_rwt_environment: Environment) -> RobotServer:
    """Return a rosbridge server in front of the robot, on a free port: `rwt_server.url`."""
    return _rwt_environment.server
