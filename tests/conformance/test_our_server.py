"""Our server by the suite, in memory on a virtual clock and over WebSockets, and our server with faults."""

from __future__ import annotations

import asyncio
import itertools
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Coroutine
from pathlib import Path

import pytest
from anyio.lowlevel import checkpoint

from rosbridge_conformance.command import main
from rosbridge_conformance.reports.terminal import failure
from rosbridge_conformance.runner import Conditions, Run, run_cases, select
from rosbridge_conformance.suite.loading import load_cases
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.target import find_target
from rosbridge_conformance.wire.wires import Wire
from rwt.extensions.zenoh import ZenohGraph
from rwt_graph import MemoryGraph
from tests.conformance.fault_list import FAULTS
from tests.conformance.loopback import Transport, served
from tests.conformance.memory_server import MemoryServer, MemoryWire, VirtualPace, memory_server
from tests.conformance.mutants import hunt_all, table
from tests.conformance.transports import PIPES, server
from tests.conformance.two_servers import two_servers

pytestmark = pytest.mark.usefixtures("quiet")


def _passes(played: Coroutine[None, None, Run], least: int = 500) -> None:
    """Run cases, and check that so many were played, and all as expected."""
    run = asyncio.run(played)
    assert len(run.results) > least
    assert not [failure(result, load_rules()) for result in run.results if result.unexpected]
    assert not run.stale


async def _in_memory(distro: str, make_graph: type[MemoryGraph] = MemoryGraph) -> Run:
    target = find_target(f"rwt-{distro}")
    async with memory_server(distro, make_graph=make_graph) as server:
        return await server.play(select(load_cases(), target), target)


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
def test_every_case_in_memory(distro: str) -> None:
    _passes(_in_memory(distro))


class _BusyWire(MemoryWire):
    """A connection to a machine that does too much: messages take a while, and some answers come late."""

    def __init__(self, server: MemoryServer, pace: VirtualPace) -> None:
        super().__init__(server.accept)
        self._pace = pace
        self._late = itertools.cycle((0.0, 0.05, 0.1))

    async def send(self, data: str | bytes) -> None:
        await self._pace.sleep(0.001)
        await super().send(data)

    async def receive(self) -> str | bytes:
        received = await super().receive()
        due = self._pace.now() + next(self._late)
        while self._pace.now() < due:
            await checkpoint()  # The player lets the time pass.
        return received


async def _timed_cases_on_a_busy_machine() -> Run:
    target = find_target("rwt-jazzy")
    cases = [case for case in select(load_cases(), target) if case.section == "throttle"]
    async with memory_server("jazzy") as server:
        pace = VirtualPace(server.clock)

        async def dial(tag: str) -> Wire:
            return _BusyWire(server, pace)

        return await run_cases(cases, target, dial, "memory", Conditions(jobs=1), pace)


def test_cases_that_measure_time_go_by_the_time_of_the_server() -> None:
    _passes(_timed_cases_on_a_busy_machine(), 20)


@pytest.mark.extended
def test_every_case_with_a_graph_over_zenoh() -> None:
    _passes(_in_memory("jazzy", ZenohGraph))


async def _between_two_servers() -> Run:
    target = find_target("rwt-two-servers")
    async with two_servers() as servers:
        return await servers.play(select(load_cases(), target), target, jobs=24)


@pytest.mark.extended
@pytest.mark.timeout(900)
def test_every_case_between_two_servers_of_one_graph() -> None:
    """In real time, most of which is waiting."""
    _passes(_between_two_servers())


OF_A_THOUSAND = ("throttle/queue-thousand", "fragments/in/many-lists")
"""Cases that send a thousand messages at once."""


async def _over(transport: Transport, distro: str, folder: Path) -> Run:
    target = find_target(f"rwt-{distro}")
    cases = select(load_cases(), target)
    if transport == "webrtc":
        # SCTP sends no more than is acknowledged: a thousand messages take many turns of the event loop, in
        # each of which the simulated time goes on. `tests.conformance.transports` plays it in real time.
        cases = tuple(case for case in cases if case.id not in OF_A_THOUSAND)
    async with (
        memory_server(distro) as server,
        served(server.accept, transport, folder, server.clock) as (url, dial),
    ):
        return await server.play(cases, target, url, dial)


@pytest.mark.extended
@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("transport", "distro"),
    [
        ("ws", "jazzy"),
        ("ws", "noetic"),
        *((other, "jazzy") for other in ("tcp", "unix", "stdio", "webrtc", "hub", "nodes")),
    ],
)
def test_every_case_over_every_transport(transport: Transport, distro: str, tmp_path: Path) -> None:
    """Second distribution over one transport only, as transports do not depend on it."""
    _passes(_over(transport, distro, tmp_path))


@pytest.mark.extended
@pytest.mark.timeout(300)
def test_the_suite_finds_every_fault() -> None:
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names) >= 60
    hunts = asyncio.run(hunt_all())
    assert not [one.fault.name for one in hunts if not one.found], table(hunts)


@pytest.mark.extended
def test_over_websockets_with_every_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {kind: tmp_path / kind for kind in ("json", "junit", "html", "badge", "summary")}
    options = [part for kind, path in files.items() for part in (f"--{kind}", str(path))]
    long = ["throttle/*", "unadvertise/gone*", "advertise/*", "malformed/object-over*"]
    skips = [part for glob in long for part in ("--skip", glob)]
    with server("ws://127.0.0.1:0", "--distro", "noetic") as url:
        code = main([url, "--target", "rwt-noetic", *options, *skips])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "grade" in said.out
    results = json.loads(files["json"].read_text())
    assert results["ok"] is True
    assert len(results["results"]) > 400
    suite = ElementTree.parse(files["junit"]).getroot()
    assert (suite.get("failures"), suite.get("errors")) == ("0", "0")
    assert int(suite.get("tests", "0")) == len(results["results"])
    page = files["html"].read_text()
    assert all(f'id="{entry["id"]}"' in page for entry in results["results"])
    assert "https://" not in page.replace("https://www.w3.org", "")
    ElementTree.parse(files["badge"])
    assert "| section |" in files["summary"].read_text()


def _globs(*names: str) -> list[str]:
    return [part for name in names for part in ("--run", name)]


@pytest.mark.extended
def test_over_tcp(capsys: pytest.CaptureFixture[str]) -> None:
    with server("tcp://127.0.0.1:0") as url:
        code = main([url, "--target", "rwt-jazzy", *_globs("tcp/*", "fragments/*", "services/*", "json/*")])
    assert code == 0, capsys.readouterr().err


@pytest.mark.extended
def test_over_the_pipes_of_a_program(capsys: pytest.CaptureFixture[str]) -> None:
    globs = _globs("publish/subset", "services/unknown", "providers/request", "providers/result-*")
    code = main([PIPES, "--target", "rwt-jazzy", "--jobs", "2", *globs])
    assert code == 0, capsys.readouterr().err


def test_with_rosauth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    secret = tmp_path / "secret"
    secret.write_text("abcdefghijklmnop\n")
    secret.chmod(0o600)
    settings = (f"auth.rosauth_secret_file={secret}", "auth.rosauth_role=admin")
    with server("ws://127.0.0.1:0", *(part for setting in settings for part in ("--set", setting))) as url:
        code = main([url, "--target", "rwt-auth", *_globs("auth/*", "services/*")])
    assert code == 0, capsys.readouterr().err


def test_with_globs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "globs.toml"
    guarded = ("publish", "subscribe", "call", "provide", "goals")
    rules = "\n".join(f'{name} = ["/c*"]' for name in guarded)
    config.write_text(f'[auth]\ndefault_role = "c"\n[roles.c]\n{rules}\n')
    with server("ws://127.0.0.1:0", "--config", str(config)) as url:
        code = main([url, "--target", "rwt-globs", *_globs("globs/*", "publish/*")])
    assert code == 0, capsys.readouterr().err


def test_a_server_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ws://127.0.0.1:9", "--run", "publish/*"]) == 3
    assert capsys.readouterr().err == (
        "rosbridge-conformance: ws://127.0.0.1:9: cannot connect: the connection was refused\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["ws://x", "--target", "nobody"], "shipped targets"),
        (["ws://x", "--profile", "NOPE"], "known are CORE"),
        (["ws://x", "--run", "nothing/like/it"], "no case fits"),
        (["ws://x", "--cases", "/no/such/cases"], "--cases /no/such/cases: there is no such folder"),
        (["ws://x", "--json", "/no/such/folder/x"], "/no/such/folder/x: cannot be written"),
        (["x"], "expected ws://"),
        (["http://x"], "expected ws://"),
        (["tcp://x"], "expected tcp://HOST:PORT"),
        (["ws://x:99999"], "expected ws://HOST:PORT"),
        (["stdio:"], "expected stdio:COMMAND"),
        (["diff", "/nope.json", "/nope.json"], "cannot be read"),
    ],
)
def test_wrong_calls(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert said in capsys.readouterr().err


def test_list_and_dry_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list", "--run", "FRG-01", "--target", "rwt-jazzy"]) == 0
    assert "fragments/in/reversed" in capsys.readouterr().out
    assert main(["--dry-run", "--run", "fragments/in/reversed"]) == 0
    out = capsys.readouterr().out
    assert "not asked: lacks profile FRAGMENT-IN" in out
    assert "1. a sends" in out
