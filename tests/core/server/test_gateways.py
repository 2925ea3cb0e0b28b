"""A gateway of one's own speaks another protocol on the same port, and cannot pass by a rule."""

from __future__ import annotations

import asyncio
import http.client
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from websockets.asyncio.client import connect

from rwt import Server, Settings
from rwt.access.errors import AccessError
from rwt.gateways.base import Gateway
from rwt_interfaces.payload import Payload
from rwt_protocol.frames import Frame
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Route

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.access.graph_view import GraphView
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import Endpoint, PeerInfo, Sink

pytestmark = pytest.mark.anyio

VIEWER = Settings.model_validate(
    {"auth": {"default_role": "viewer"}, "roles": {"viewer": {"subscribe": ["*"]}}}
)


class Shout:
    """A client of the gateway: what it says comes back in capitals."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink

    def receive(self, data: bytes, binary: bool) -> None:
        self._sink.send(Frame(data.upper()))

    def closed(self, code: int, reason: str) -> None:
        pass


class Shouting(Gateway):
    """A gateway whose WebSocket says things in capitals, and whose page publishes what is posted."""

    name = "shouting"

    def __init__(self, graph: Graph, access: Access) -> None:
        super().__init__(graph, access, "/shouting", 0.0)
        self.reloads = 0
        self.is_closed = False
        self.websockets = {"shout.v1": self._accept, "shout.v2": self._accept}
        self.http = HttpExtension(
            (
                Route("/said", self._publish, Audience.ADMITTED, "POST"),
                Route("/said", lambda request, reader: HttpResponse(b"nothing"), Audience.ADMITTED),
            )
        )

    def _accept(self, sink: Sink, info: PeerInfo, *, loopback: bool) -> Endpoint:
        self.access.admission.admit(info, loopback=loopback)
        return Shout(sink)

    def _publish(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        client = self.access.client(self.shared, reader.role, request.address)
        try:
            said = client.publisher("/said", "std_msgs/String")
        except AccessError as error:
            return HttpResponse(str(error).encode(), 403)
        said.publish(Payload.from_value(said.type, {"data": request.body.decode()}))
        client.close()
        return HttpResponse(status=204)

    def reload_roles(self) -> None:
        self.reloads += 1

    def close(self) -> None:
        super().close()
        self.is_closed = True


def ask(
    url: str, method: str, path: str, body: str = "", **headers: str
) -> tuple[int, Mapping[str, str], str]:
    address = urlsplit(url)
    connection = http.client.HTTPConnection(str(address.hostname), address.port, timeout=60)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): it for name, it in headers.items()})
        answer = connection.getresponse()
        headers = {name.lower(): value for name, value in answer.getheaders()}
        return answer.status, headers, answer.read().decode()
    finally:
        connection.close()


@pytest.mark.parametrize(
    ("offered", "agreed"),
    [
        (["shout.v1"], "shout.v1"),
        (["other", "shout.v2", "shout.v1"], "shout.v2"),
        (["rwt", "shout.v1"], "rwt"),
        (["other"], None),
        ([], None),
    ],
)
async def test_the_first_offered_subprotocol_that_is_spoken_decides(
    offered: list[Any], agreed: str | None
) -> None:
    async with (
        Server("ws://127.0.0.1:0", gateways=[Shouting]) as server,
        connect(server.urls[0], subprotocols=offered or None) as client,
    ):
        assert client.subprotocol == agreed
        await client.send('{"op": "call_service", "service": "/none", "id": "1"}')
        answer = await asyncio.wait_for(client.recv(), 20)
        shouts = agreed is not None and agreed.startswith("shout")
        assert ("CALL_SERVICE" in str(answer)) is shouts
        assert ("service_response" in str(answer)) is not shouts


@pytest.mark.parametrize(
    ("gateways", "names"),
    [
        (None, ["foxglove", "http"]),
        ([], []),
        (["http"], ["http"]),
        ([Shouting], []),
        (["http", Shouting], ["http"]),
    ],
)
async def test_the_gateways_of_a_server_are_those_of_the_argument_or_else_of_the_setting(
    gateways: list[Any] | None, names: list[str]
) -> None:
    async with Server("ws://127.0.0.1:0", gateways=gateways) as server:
        assert list(server.settings.gateways) == names
        spoken = {text.split('"')[1] for text in server.metrics.text().decode().split("gateway=")[1:]}
        own = {"shouting"} if Shouting in (gateways or []) else set()
        assert spoken == {"rosbridge", *names, *own}
        status, *_ = await asyncio.to_thread(ask, server.urls[0], "GET", "/api/topics")
        assert status == (200 if "http" in names else 404)


async def test_a_page_that_acts_does_what_its_role_may() -> None:
    async with Server("ws://127.0.0.1:0", gateways=[Shouting]) as server:
        heard: asyncio.Queue[str] = asyncio.Queue()
        server.node("listener").subscribe(
            "/said", lambda message: heard.put_nowait(message.data), "std_msgs/String"
        )
        status, *_ = await asyncio.to_thread(ask, server.urls[0], "POST", "/said", "hello")
        assert status == 204
        assert await asyncio.wait_for(heard.get(), 20) == "hello"
    async with Server("ws://127.0.0.1:0", settings=VIEWER, gateways=[Shouting]) as server:
        status, _, text = await asyncio.to_thread(ask, server.urls[0], "POST", "/said", "hello")
        assert status == 403 and "roles.viewer.publish" in text


async def test_a_foreign_page_cannot_act_and_is_told_so_before() -> None:
    async with Server("ws://127.0.0.1:0", gateways=[Shouting]) as server:
        url, foreign = server.urls[0], "https://elsewhere.example"
        status, _, text = await asyncio.to_thread(ask, url, "POST", "/said", "hello", Origin=foreign)
        assert status == 403 and "origins.allow" in text
        assert server.graph.topic("/said") is None
        status, headers, _ = await asyncio.to_thread(ask, url, "OPTIONS", "/said", Origin=foreign)
        assert status == 403 and "access-control-allow-origin" not in headers
        own = url.replace("ws:", "http:")
        status, headers, _ = await asyncio.to_thread(
            ask, url, "OPTIONS", "/said", Origin=own, Access_Control_Request_Headers="authorization"
        )
        assert status == 204 and headers["access-control-allow-methods"] == "GET, POST"
        assert headers["access-control-allow-headers"] == "authorization"
        status, headers, _ = await asyncio.to_thread(ask, url, "POST", "/said", "hello", Origin=own)
        assert status == 204 and headers["access-control-allow-origin"] == own


async def test_it_is_told_of_other_roles_and_closed_with_the_server() -> None:
    made: list[Shouting] = []

    def make(graph: Graph, access: Access) -> Shouting:
        made.append(Shouting(graph, access))
        return made[0]

    async with Server("ws://127.0.0.1:0", gateways=[make]) as server:
        server.reload()
        assert made[0].reloads == 1 and not made[0].is_closed
    assert made[0].is_closed
