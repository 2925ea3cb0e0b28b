"""Extensions: entry points of an installed distribution, used by name in settings and on the command line."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rwt import Server, SettingsError, connect
from rwt.cli import main
from rwt_client import Robot
from rwt_protocol import codecs
from rwt_transports import BadUrl
from rwt_transports.schemes import SCHEMES, parse_connect_url
from tests.core.cli.conftest import candidates

ENTRY_POINTS = """\
[rwt.commands]
dance = stage.commands:add_dance_command
faint = stage.commands:missing
serve = stage.commands:add_dance_command

[rwt.gateways]
shouting = stage.shouting:PART
old = tests.core.server.test_gateways:Shouting
fainting = stage.missing:Gateway

[rwt.nodes]
lamp = stage.lamp:PART

[rwt.services]
fog = stage.fog:PART

[rwt.graphs]
stage = stage.graph:PART

[rwt.codecs]
msgpack = stage.msgpack:ENCODING
clash = stage.msgpack:CLASH

[rwt.transports]
netstring = stage.netstring:SCHEME
broken = stage.lamp:Lamp
"""

MODULES = {
    "__init__": "",
    "commands": """
def add_dance_command(commands):
    parser = commands.add_parser("dance", description="Dance.")
    parser.add_argument("--times", type=int, default=1)
    verbs = parser.add_subparsers()
    verbs.add_parser("waltz").set_defaults(run=lambda arguments: print("waltz", arguments.times) or 0)
""",
    "shouting": """
from pydantic import Field
from rwt.access.settings import Count, Table
from rwt.declarations import GatewayPart
from tests.core.server.test_gateways import Shouting

class ShoutingSettings(Table):
    '''A protocol of capitals.'''

    times: Count = Field(1, description="repetitions of each word")

class Repeating(Shouting):
    def __init__(self, context, settings):
        super().__init__(context.graph, context.access)
        made.append((context.server, settings.times))

def check(settings, own):
    if own.times > 3 and settings.distro == "noetic":
        raise ValueError("`shouting.times`: too loud for noetic")

made = []
PART = GatewayPart(summary="capitals", settings=ShoutingSettings, check=check, make=Repeating)
""",
    "lamp": """
from rwt.declarations import NodePart

class Lamp:
    def __init__(self, graph):
        self._node = graph.participant("/lamp")
        self._node.advertise("/light", graph.registry.message("std_msgs/Bool"))
    def close(self):
        self._node.close()

PART = NodePart(summary="a lamp", make=lambda context, settings: Lamp(context.graph))
""",
    "fog": """
from contextlib import asynccontextmanager
from rwt.access.settings import Table
from rwt.declarations import ServicePart

class FogSettings(Table):
    '''A machine for fog.'''

    enabled: bool = False

states = []

@asynccontextmanager
async def run(context, settings):
    states.append("on")
    yield
    states.append("off")

PART = ServicePart(summary="fog", settings=FogSettings, is_on=lambda settings: settings.enabled, run=run)
""",
    "graph": """
from rwt.declarations import GraphPart
from rwt_graph import MemoryGraph

class StageGraph(MemoryGraph):
    pass

def make(context, settings):
    return StageGraph(context.registry, context.clock)

PART = GraphPart(summary="a stage", make=make)
""",
    "msgpack": """
from dataclasses import replace
import msgspec
from rwt_protocol.codecs import ENCODINGS, Encoding
from rwt_protocol.codecs.object_codec import ObjectCodec, members_within
from rwt_protocol.frames import Frame

class MessagePack(ObjectCodec):
    def split(self, data, limits):
        return (members_within(msgspec.msgpack.decode(data), len(data), limits.max_depth),)
    def frame(self, message):
        frames.append(message["msg"]["data"])
        return Frame(msgspec.msgpack.encode(message), binary=True)

frames = []
CODEC = MessagePack()
FIRST = bytes((*range(0x80, 0x90), 0xDE, 0xDF))
ENCODING = Encoding("msgpack", 1, CODEC.publish_encoder, binary=True, codec=MessagePack, first_bytes=FIRST)
CLASH = replace(ENCODINGS["cbor"], name="clash")
""",
    "netstring": """
from rwt_transports.schemes import Scheme
from tests.core.transports.test_new_scheme import NetstringWire

SCHEME = Scheme("netstring://127.0.0.1:9099", NetstringWire, NetstringWire)
""",
}


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path with an installed distribution, of which nothing is imported yet."""
    information = tmp_path / "stage-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(
        "Metadata-Version: 2.4\nName: stage\nVersion: 1.0\nSummary: 100 % of a show\n"
    )
    (information / "entry_points.txt").write_text(ENTRY_POINTS)
    (tmp_path / "stage").mkdir()
    for name, text in MODULES.items():
        (tmp_path / "stage" / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in imported():
        del sys.modules[name]
    SCHEMES.pop("netstring", None)
    codecs._REGISTERED.pop("msgpack", None)
    for first in [first for first, codec in codecs._BINARY.items() if codec is not codecs.cbor_codec]:
        del codecs._BINARY[first]


def imported() -> set[str]:
    """The modules of the distribution that are imported now."""
    return {name for name in sys.modules if name.partition(".")[0] == "stage"}


async def call(robot: Robot) -> str:
    return str((await robot.call("/beep")).message)


def server(*urls: str, **changes: Any) -> Server:
    """A server with a service, and a latched topic for clients."""
    made = Server(*(urls or ("ws://127.0.0.1:0",)), **changes)
    node = made.node("robot")
    node.advertise("/greeting", "std_msgs/String", latch=True).publish({"data": "hello"})
    node.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "ü"})
    return made


@pytest.mark.anyio
async def test_nothing_is_imported_because_it_is_installed(stage: Path) -> None:
    async with server() as running, connect(running.urls[0]) as robot:
        assert await call(robot) == "ü"
    assert imported() == set()


@pytest.mark.anyio
async def test_a_gateway(stage: Path) -> None:
    from websockets import Subprotocol
    from websockets.asyncio.client import connect as connect_websocket

    async with (
        server(gateways=["http", "shouting"]) as running,
        connect_websocket(running.urls[0], subprotocols=[Subprotocol("shout.v1")]) as client,
    ):
        await client.send("ho")
        assert await client.recv() == "HO"


@pytest.mark.anyio
async def test_a_gateway_has_settings_like_a_built_in_one(stage: Path) -> None:
    async with server(gateways=["http", "shouting"], shouting={"times": 2}):
        info, times = sys.modules["stage.shouting"].made[0]
    assert (info.gateways, times) == (("rosbridge", "http", "shouting"), 2)
    with pytest.raises(SettingsError, match=r"`shouting.times`: too loud for noetic"):
        Server(gateways=["shouting"], shouting={"times": 4}, distro="noetic")


def test_faults_in_the_table_of_an_extension_name_file_and_line(
    stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = stage / "robot.toml"
    file.write_text('gateways = ["shouting"]\n\n[shouting]\ntimes = 0\n')
    assert main(["serve", "--config", str(file)]) == 2
    error = capsys.readouterr().err
    assert f"{file}:4: `shouting.times`: expected a whole number of at least 1" in error
    file.write_text('gateways = ["shouting"]\n\n[shouting]\ntime = 1\n')
    assert main(["serve", "--config", str(file)]) == 2
    error = capsys.readouterr().err
    assert f"{file}:4: unknown setting `shouting.time`; did you mean `shouting.times`?" in error


def test_the_table_of_an_extension_is_shown_with_its_sources(
    stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    set_ = ["--set", "gateways=shouting", "--set", "shouting.times=3"]
    assert main(["config", "show", *set_]) == 0
    shown = capsys.readouterr().out
    assert "[shouting]\ntimes = 3" in shown and "# --set shouting.times" in shown


@pytest.mark.anyio
async def test_a_factory_of_version_0_1_works_with_a_warning(stage: Path) -> None:
    with pytest.warns(DeprecationWarning, match="'old' of the group rwt.gateways is a factory"):
        async with server(gateways=["old"]) as running:
            assert running.running


@pytest.mark.anyio
async def test_a_node(stage: Path) -> None:
    async with server(nodes=["rosapi", "lamp"]) as running, connect(running.urls[0]) as robot:
        assert "/lamp" in await robot.api.nodes()
    assert imported() == {"stage", "stage.lamp"}


@pytest.mark.anyio
async def test_a_graph(stage: Path) -> None:
    async with server(graph="stage") as running, connect(running.urls[0]) as robot:
        assert type(running.graph).__name__ == "StageGraph"
        assert await call(robot) == "ü"
    with pytest.raises(SettingsError, match="`graph`: 'stage' is of one process"):
        Server(graph="stage", workers=2)


@pytest.mark.anyio
async def test_an_encoding(stage: Path) -> None:
    async with server(encodings=["msgpack"]) as running, connect(running.urls[0]) as robot:
        assert (await robot.once("/greeting", compression="msgpack")).data == "hello"
    assert sys.modules["stage.msgpack"].frames == ["hello"]
    with pytest.raises(SettingsError, match=r"`encodings`: the encoding 'clash' begins with a byte of"):
        async with server(encodings=["clash"]):
            pass


@pytest.mark.anyio
async def test_a_transport(stage: Path) -> None:
    async with server("netstring://127.0.0.1:0") as running, connect(running.urls[0]) as robot:
        assert running.urls[0].startswith("netstring://")
        assert await call(robot) == "ü"
    with pytest.raises(BadUrl, match=r"'broken' of rwt\.transports is not a Scheme"):
        parse_connect_url("broken://robot")
    with pytest.raises(BadUrl, match=r"use one of ws://.*, broken://"):
        parse_connect_url("braken://robot")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"gateways": ["soap"]}, r'`gateways`: expected a list of "foxglove" .* or "shouting", got \'soap\''),
        ({"nodes": ["lump"]}, r'`nodes`: .* or "lamp", got \'lump\''),
        (
            {"graph": "state"},
            r'`graph`: expected "memory" or "ros1" .* or "zenoh" or "stage", got \'state\'',
        ),
        ({"encodings": ["none"]}, r'`encodings`: .* "msgpack", got \'none\''),
    ],
)
def test_an_unknown_name_lists_the_known_ones(stage: Path, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        Server(**changes)
    assert imported() == set()


@pytest.mark.anyio
async def test_a_gateway_that_cannot_be_imported(stage: Path) -> None:
    with pytest.raises(
        SettingsError, match=r"`gateways`: the entry point 'fainting' .* cannot be imported: No"
    ):
        async with server(gateways=["fainting"]):
            pass


def test_a_command_with_options_and_verbs(stage: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "dance 100 % of a show (stage)" in text
    assert imported() == set()
    assert main(["dance", "--times", "3", "waltz"]) == 0
    assert capsys.readouterr().out == "waltz 3\n"
    assert main(["faint"]) == 2
    assert "`rwt faint` is not available: the entry point 'faint'" in capsys.readouterr().err


def test_a_built_in_command_cannot_be_replaced(stage: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["serve", "--help"])
    assert "--workers" in capsys.readouterr().out
    assert imported() == set()


def test_commands_of_a_missing_distribution_name_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rwt.cli.extension_names", lambda group: [])
    assert [main([name, "anything"]) for name in ("run", "launch")] == [2, 2]
    assert capsys.readouterr().err.count("pip install rwt-rclpy\n") == 2


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("rwt dan", "dance"),
        ("rwt dance wa", "waltz"),
        ("rwt dance --ti", "--times"),
        ("rwt laun", "launch"),
        ("rwt launch --ser", "--serve"),
    ],
)
def test_completion_of_a_command(stage: Path, line: str, found: str) -> None:
    path = os.pathsep.join((str(stage), os.environ.get("PYTHONPATH", "")))
    assert candidates("", line, PYTHONPATH=path) == [found]


@pytest.mark.anyio
@pytest.mark.usefixtures("stage")
async def test_service_that_its_table_turns_on() -> None:
    for table, states in (({"enabled": False}, []), ({"enabled": True}, ["on", "off"])):
        async with Server("ws://127.0.0.1:0", fog=table):
            pass
        assert sys.modules["stage.fog"].states == states
