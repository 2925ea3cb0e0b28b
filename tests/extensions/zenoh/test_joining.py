"""Opening and closing: configuration, errors, and that a process always ends."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import anyio
import pytest

from rwt.extensions.zenoh import ZenohError, ZenohGraph, ZenohOptions
from rwt.extensions.zenoh.session import configuration
from rwt_graph import NotRunning
from tests.waiting import PATIENCE, until
from tests.zenoh_links import QUICK, free_endpoint


def setting(options: ZenohOptions, key: str) -> object:
    """Configuration of the session."""
    value: object = json.loads(configuration(options).get_json(key))
    return value


def test_by_default_nothing_is_listened_on_and_nobody_is_looked_for() -> None:
    assert setting(ZenohOptions(), "listen/endpoints") == []
    assert setting(ZenohOptions(), "connect/endpoints") == []
    assert setting(ZenohOptions(), "scouting/multicast/enabled") is False
    assert setting(ZenohOptions(), "timestamping/enabled") is True


def test_what_is_given_wins_over_the_file_and_the_file_over_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        "{ mode: 'client', // as JSON5 allows\n"
        "  listen: { endpoints: ['tcp/127.0.0.1:1'] }, scouting: { multicast: { enabled: true } },\n"
        "  transport: { link: { tls: { root_ca_certificate: '/ca.pem' } } } }"
    )
    asked = ZenohOptions(config=file)
    assert setting(asked, "mode") == "client"
    assert setting(asked, "listen/endpoints") == ["tcp/127.0.0.1:1"]
    assert setting(asked, "scouting/multicast/enabled") is True
    assert setting(asked, "transport/link/tls/root_ca_certificate") == "/ca.pem"
    given = ZenohOptions(("tcp/127.0.0.1:2",), ("tcp/127.0.0.1:3",), "peer", False, file)
    assert setting(given, "mode") == "peer"
    assert setting(given, "listen/endpoints") == ["tcp/127.0.0.1:2"]
    assert setting(given, "connect/endpoints") == ["tcp/127.0.0.1:3"]
    assert setting(given, "scouting/multicast/enabled") is False


def test_a_file_that_is_not_there_or_not_zenohs(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.json5"
    wrong.write_text("{ nothing: 1 }")
    for path in (tmp_path / "none.json5", wrong):
        with pytest.raises(ZenohError, match=f"^the Zenoh configuration {path} cannot be used"):
            configuration(ZenohOptions(config=path))


@pytest.mark.parametrize("endpoint", ["here", "tcp", "tcp/"])
def test_endpoints_that_are_none(endpoint: str) -> None:
    with pytest.raises(ZenohError, match="Zenoh does not take"):
        configuration(ZenohOptions(listen=(endpoint,)))


def test_a_negative_domain() -> None:
    with pytest.raises(ZenohError, match="-1 is not a domain"):
        ZenohGraph(domain=-1)


@pytest.mark.anyio
async def test_an_address_that_is_taken() -> None:
    endpoint = free_endpoint()
    async with ZenohGraph(listen=[endpoint]):
        with pytest.raises(ZenohError, match=f"^Zenoh cannot listen on {endpoint}: "):
            async with ZenohGraph(listen=[endpoint]):
                pass


@pytest.mark.anyio
async def test_a_client_needs_somebody_to_connect_to() -> None:
    with pytest.raises(ZenohError, match="a client needs a router that is there"):
        async with ZenohGraph(mode="client"):
            pass


@pytest.mark.anyio
async def test_what_is_there_before_the_graph_is_entered_is_known_to_others_then() -> None:
    endpoint = free_endpoint()
    early = ZenohGraph(listen=[endpoint], namespace="/robot7")
    node = early.node("talker")
    node.advertise("chatter", "std_msgs/String", latch=True).publish({"data": "kept"})
    node.advertise_service("~/go", "std_srvs/Trigger", lambda _: {"success": True})
    async with early, ZenohGraph(connect=[endpoint], config=QUICK) as other:
        # Joining looks around first, but no longer than a busy machine may take to connect.
        await until(lambda: other.topic("/robot7/chatter") is not None)
        heard: list[str] = []
        other.node("ear").subscribe("/robot7/chatter", lambda message: heard.append(message.data))
        await until(lambda: heard == ["kept"])
        response = await other.node("caller").call("/robot7/talker/go", timeout=PATIENCE)
        assert response.success
        with pytest.raises(NotRunning):
            await early.__aenter__()


@pytest.mark.anyio
async def test_who_connects_before_there_is_anybody_finds_him_later(
    caplog: pytest.LogCaptureFixture,
) -> None:
    endpoint = free_endpoint()
    async with ZenohGraph(connect=[endpoint], config=QUICK) as early:
        assert f"no process answers at {endpoint} yet; connecting is tried" in caplog.text
        async with ZenohGraph(listen=[endpoint], config=QUICK) as late:
            late.node("late")
            await until(lambda: [node.name for node in early.nodes()] == ["/late"])
        await until(lambda: early.nodes() == ())


@pytest.mark.anyio
async def test_peers_of_one_peer_find_each_other_if_they_listen() -> None:
    middle, left, right = (free_endpoint() for _ in range(3))
    async with (
        ZenohGraph(listen=[middle], config=QUICK),
        ZenohGraph(listen=[left], connect=[middle], config=QUICK) as a,
        ZenohGraph(listen=[right], connect=[middle], config=QUICK) as b,
    ):
        a.node("a")
        b.node("b")
        await until(lambda: [node.name for node in a.nodes()] == ["/a", "/b"])
        await until(lambda: a.nodes() == b.nodes())


_PROGRAM = """
import sys
import anyio
from rwt.extensions.zenoh import ZenohGraph

async def main():
    async with ZenohGraph(listen=[sys.argv[1]]) as graph:
        node = graph.node("n")
        node.subscribe("/t", lambda _: None, "std_msgs/String")
        print("up", flush=True)
        {body}

{run}
"""

_FORGET = """
graph = ZenohGraph(listen=[sys.argv[1]])

async def forget():
    await graph.__aenter__()
    print("up", flush=True)
    sys.exit(4)

anyio.run(forget)
"""

ENDINGS = {
    "an exception": ("raise ZeroDivisionError", "anyio.run(main)", 1),
    "its end": ("await anyio.sleep(0)", "anyio.run(main)", 0),
    "an exit": ("sys.exit(3)", "anyio.run(main)", 3),
    "never being left": (
        "",
        _FORGET,
        4,
    ),
}


@pytest.mark.parametrize("how", ENDINGS)
def test_a_process_ends_after(how: str) -> None:
    body, run, code = ENDINGS[how]
    program = _PROGRAM.format(body=body, run=run)
    done = subprocess.run(
        [sys.executable, "-c", program, free_endpoint()],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.stdout == "up\n"
    assert done.returncode == code


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_ends_on_a_signal(number: signal.Signals) -> None:
    """Ctrl-C ends it in order; SIGTERM, which Python does not turn into anything, ends it too."""
    program = _PROGRAM.format(body="await anyio.sleep_forever()", run="anyio.run(main)")
    process = subprocess.Popen(
        [sys.executable, "-c", program, free_endpoint()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(number)
        process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode in (-number, 1, 130)


@pytest.mark.anyio
async def test_who_joins_finds_hundreds_at_once() -> None:
    endpoint = free_endpoint()
    async with ZenohGraph(listen=[endpoint], config=QUICK) as fleet:
        node = fleet.node("fleet")
        for number in range(600):
            node.advertise(f"topic{number}", "std_msgs/String")
        with anyio.fail_after(PATIENCE):
            async with ZenohGraph(connect=[endpoint], config=QUICK) as other:
                # At once, but on a machine so busy that joining does not wait for the connection.
                await until(
                    lambda: len([each for each in other.topics() if each.name.startswith("/topic")]) == 600
                )
