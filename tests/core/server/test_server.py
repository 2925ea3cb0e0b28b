"""`rwt.Server` inside a program that has an event loop of its own."""

from __future__ import annotations

import urllib.request
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import pytest

from rwt import MemoryGraph, Node, Server, Settings, SettingsError, SimulatedClock, connect, read_settings
from rwt.extensions.testing import ObservedGraph
from rwt_graph import NotRunning
from rwt_graph.api import Graph
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from rwt_transports import ListenError
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from tests.zenoh_links import free_endpoint

URL = "ws://127.0.0.1:0"

pytestmark = pytest.mark.anyio


async def get(url: str, path: str) -> bytes:
    """A page of the server, as a browser asks for it."""

    def ask() -> bytes:
        with urllib.request.urlopen(url.replace("ws", "http", 1) + path, timeout=60) as answer:
            body: bytes = answer.read()
        return body

    return await anyio.to_thread.run_sync(ask)


async def test_a_program_has_its_graph_and_rosapi_and_pictures_without_asking() -> None:
    async with Server(URL) as server:
        robot = server.node("my_robot")
        robot.advertise("/battery", "std_msgs/Float32", latch=True).publish({"data": 12.5})
        async with connect(server.urls[0]) as client:
            assert (await client.once("/battery")).data == 12.5
            assert {"/rosapi", "/my_robot", "/web_video_server"} <= set(await client.api.nodes())
            assert server.bridge.client_count == 1
        assert b"Image topics" in await get(server.urls[0], "/index")
        assert b'rwt_connections_total{gateway="rosbridge"} 1' in await get(server.urls[0], "/metrics")


async def test_what_there_is_only_while_it_runs_says_so() -> None:
    server = Server(URL)
    for name in ("urls", "bridge", "dials", "metrics"):
        with pytest.raises(NotRunning, match="async with server:"):
            getattr(server, name)
    with pytest.raises(NotRunning, match="async with server:"):
        await server.ended()
    async with server:
        pass
    with pytest.raises(NotRunning, match="entered only once"):
        await server.__aenter__()


async def test_every_setting_takes_effect_in_a_program(tmp_path: Path) -> None:
    (tmp_path / "my_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "my_msgs" / "msg" / "Mood.msg").write_text("string name\n")
    (tmp_path / "my_msgs" / "meshes").mkdir()
    (tmp_path / "my_msgs" / "meshes" / "hand.stl").write_text("solid hand")
    settings = Settings(
        listen=(URL,),
        demo=True,
        distro="noetic",
        interfaces=(tmp_path,),
        packages=(tmp_path,),
        nodes=("rosapi",),
    )
    async with Server(settings=settings) as server, connect(server.urls[0]) as client:
        assert server.graph.distro is NOETIC
        assert await client.api.topic_type("/odom") == "nav_msgs/Odometry"
        assert server.graph.registry.message("my_msgs/Mood").name == "my_msgs/Mood"
        assert "/tf2_web_republisher" not in await client.api.nodes()
        assert await get(server.urls[0], "/packages/my_msgs/meshes/hand.stl") == b"solid hand"


async def test_settings_by_name_win_over_settings() -> None:
    settings = Settings(distro="jazzy", nodes=())
    server = Server(URL, settings=settings, distro="noetic")
    assert (server.settings.distro, server.settings.listen, server.settings.nodes) == ("noetic", (URL,), ())
    assert server.graph.distro is NOETIC


async def test_a_robot_that_only_dials_out_needs_no_port() -> None:
    dial = {"urls": ["ws://127.0.0.1:1/robots/rosie"]}
    async with Server(dial=dial) as server:
        assert (server.urls, [relay.url for relay in server.dials]) == ((), dial["urls"])
    assert Server(URL, dial=dial).settings.listen == (URL,)


JAZZY_GRAPH = MemoryGraph()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"distor": "noetic"}, "unknown setting `distor`; did you mean `distro`?"),
        ({"distro": "kinetic"}, '`distro`: expected "humble" or "jazzy" or "kilted" or "lyrical" or '),
        ({"listen": [URL]}, "`listen`: given twice"),
        ({"graph": "zeno"}, '`graph`: expected "memory" or "ros1" or "ros1-master" or "ros2" or "zenoh"'),
        ({"workers": 4}, "4 processes cannot share the graph of this program"),
        ({"workers": 4, "script": Path("robot.toml")}, "script: sees one process only"),
        ({"interfaces": ["/nowhere"]}, "`interfaces`: /nowhere"),
        ({"zenoh": {"listen": ["tcp/127.0.0.1:7447"]}}, '`graph = "zenoh"`'),
        ({"graph": JAZZY_GRAPH, "distro": "noetic"}, "`distro`: 'noetic', but the given graph"),
        ({"graph": JAZZY_GRAPH, "interfaces": ["/tmp"]}, "`interfaces`: cannot be added to the given graph"),
        ({"graph": JAZZY_GRAPH, "zenoh": {"domain": 3}}, "`graph`, `zenoh`: cannot change the given graph"),
        ({"graph": JAZZY_GRAPH, "clock": SimulatedClock()}, "registry, clock: the given graph has its own"),
        ({"graph": JAZZY_GRAPH, "registry": Registry()}, "registry, clock: the given graph has its own"),
        (
            {"registry": Registry(NOETIC), "distro": "jazzy"},
            "`distro`: 'jazzy', but the given graph or registry",
        ),
        ({"graph": MemoryGraph, "settings": Settings(graph="zenoh")}, "makes the graph; leave out one"),
        ({"graph": JAZZY_GRAPH, "settings": Settings(graph="zenoh")}, "cannot change the given graph"),
        ({"packages": ["/nowhere"]}, "`packages`: /nowhere"),
        ({"script": Path("/nowhere/robot.toml")}, "script: /nowhere/robot.toml"),
        ({"script": Path("robot.toml"), "graph": MemoryGraph}, "script: needs a graph in memory"),
        ({"introspection": True, "distro": "noetic"}, "introspection: is of ROS 2"),
        ({"workers": 2, "recorder": {"folder": "."}}, "`recorder.folder`: a recorder sees one process"),
    ],
)
async def test_what_cannot_take_effect_is_refused(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError) as refused:
        async with Server(URL, **arguments):
            raise AssertionError("it serves")
    assert text in str(refused.value)


async def test_a_graph_that_runs_already_goes_on() -> None:
    async with MemoryGraph() as graph:
        async with Server(URL, graph=graph) as server:
            assert server.graph is graph
            async with Server(URL, graph=graph, nodes=()) as second, connect(second.urls[0]) as client:
                assert "/rosapi" in await client.api.nodes()
        assert graph.running
        assert not [node for node in graph.nodes() if node.name == "/rosapi"]


async def test_a_graph_may_be_made_of_another_class_with_a_clock_of_its_own() -> None:
    clock = SimulatedClock()
    async with Server(URL, graph=ObservedGraph, clock=clock, distro="noetic") as server:
        assert isinstance(server.graph, ObservedGraph)
        assert (server.graph.clock, server.graph.distro) == (clock, NOETIC)


@pytest.mark.skipif(find_spec("zenoh") is None, reason="needs the extra zenoh")
async def test_graphs_of_two_programs_are_joined_over_zenoh() -> None:
    endpoint = free_endpoint()
    async with (
        Server(URL, graph="zenoh", zenoh={"listen": [endpoint]}, demo=True),
        Server(URL, settings=Settings(graph="zenoh"), zenoh={"connect": [endpoint]}) as gateway,
        connect(gateway.urls[0]) as client,
    ):
        with anyio.fail_after(10):
            assert (await client.once("/odom")).child_frame_id == "base_link"


class Lamp:
    """A node with a page."""

    def __init__(self, graph: Graph) -> None:
        assert graph.running
        self._node = Node(graph, "lamp")
        self.http = HttpExtension((Route("/lamp", self._page, Audience.ADMITTED),))
        self.closed = False

    def _page(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        return HttpResponse(b"it shines")

    def close(self) -> None:
        self.closed = True
        self._node.close()


async def test_nodes_of_the_program_are_served_and_closed_even_if_it_cannot_start() -> None:
    lamps: list[Lamp] = []

    def make(graph: Graph) -> Lamp:
        lamps.append(Lamp(graph))
        return lamps[-1]

    async with Server(URL, extra_nodes=[make]) as first:
        assert await get(first.urls[0], "/lamp") == b"it shines"
        second = Server(*first.urls, extra_nodes=[make])
        with pytest.raises(ListenError, match="in use"):
            await second.__aenter__()
        assert [lamp.closed for lamp in lamps] == [False, True]
    assert lamps[0].closed
    assert not second.running and not second.graph.running


async def test_middleware_stands_between_the_transports_and_the_clients() -> None:
    addresses: list[str] = []

    def middleware(accept: Accept) -> Accept:
        def accept_noted(sink: Sink, info: PeerInfo) -> Endpoint:
            addresses.append(info.address)
            return accept(sink, info)

        return accept_noted

    async with Server(URL, middleware=middleware) as server, connect(server.urls[0]):
        pass
    assert addresses == ["127.0.0.1"]


@pytest.mark.parametrize("table", ["web", "webrtc"])
def test_a_table_that_can_be_enabled_is_switched_by_a_boolean(table: str, tmp_path: Path) -> None:
    for switch in (True, False):
        settings = Server("ws://127.0.0.1:0", **{table: switch}).settings  # type: ignore[arg-type]
        assert getattr(settings, table).enabled is switch
        file = tmp_path / "robot.toml"
        file.write_text(f"{table} = {str(switch).lower()}\n")
        assert getattr(read_settings(file), table).enabled is switch
