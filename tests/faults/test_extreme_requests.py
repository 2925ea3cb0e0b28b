"""Every page is asked for with extreme numbers and shapes, by every method: it answers or refuses, never
fails, and leaves nothing in the graph."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import pytest
from anyio.from_thread import start_blocking_portal
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt import Server
from rwt.extensions.http import services, topics
from rwt.extensions.video import server as video
from rwt_graph import Node
from rwt_graph.api import Graph
from tests.faults.server_log import Failures
from tests.waiting import wait_until

PATIENCE: Final = 20.0
EXAMPLES: Final = int(os.environ.get("SWEEP_EXAMPLES", "200"))
"""Requests; `make fuzz` asks for more."""


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split())


NUMBERS: Final = (
    *_words("""0 1 -1 -0 1.5 +1 1_0 0x10 1e3 1e308 -1e308 1e400 5e-324 inf -inf nan 2147483648 4294967296
    9007199254740993
    9223372036854775808 18446744073709551616 63 64 100 4096 4097 10000 1e-9 true null [] None % %00 %ff"""),
    "", "1" * 400, "9" * 5000, "\u0661\u0662", "\u00b2",
)  # fmt: skip
"""Texts where numbers are expected."""

TEXTS: Final = (
    *_words("""/ // /image /label image ~x /a//b a%20b a%0d%0ab %2e%2e%2f ..%2f..%2fetc%2fpasswd
    ../../etc/passwd ..\\..
    %c0%ae%c0%ae/ * /* {} $x /label/ std_msgs/String std_msgs/msg/String std_msgs/Nothing /robot/speed
    robot:speed
    rcl_interfaces/srv/SetParameters /add /count goals %F0%9F%A4%96 vp8 vp9 h264 mjpeg png ros_compressed
    ultrafast
    best compressedDepth sensor_data"""),
    "\u00e9", "a" * 300, "/a" * 2000, "0" * 32, "goals/" + "f" * 32,
)  # fmt: skip
"""Texts where names are expected."""

PARAMETERS: Final = (
    *_words("""topic type width height quality bitrate qmin qmax gop preset invert qos_profile
    default_transport wait throttle
    queue timeout latch token robot layout"""),
    "",
)  # fmt: skip
"""Of the queries of every page."""

PATHS: Final = _words("""/ /index /role /healthz /metrics /version /api /api/openapi.json /api/types/
    /api/topics /api/topics/
    /api/services /api/services/ /api/actions /api/actions/ /api/actions/count/goals
    /api/actions/count/goals/
    /api/parameters /api/parameters/ /stream /stream_viewer /snapshot /packages/rwt_demo/meshes/ /web/ /lib/
    /web/settings.json /web/layouts/ /mcp /webrtc /webrtc/ /whep /whep/ /whip /whip/ /nothing *_words(""")

WHOLE_PATHS: Final = _words("""/stream /stream /snapshot /snapshot /stream_viewer /api/topics/label
    /api/topics/image
    /api/topics/twist /api/services/add /api/actions/count/goals /api/parameters/robot:speed /mcp /webrtc
    /whep
    /whip""")
"""Paths to which nothing is added, so that what is asked for is there."""

HEADERS: Final = _words("""Range If-None-Match If-Match If-Modified-Since If-Range Last-Event-ID Accept
    Accept-Encoding
    Content-Type Host Origin Authorization Cookie Forwarded X-Forwarded-For X-Forwarded-Prefix
    X-Forwarded-Proto
    X-Forwarded-Host Expect Upgrade Connection Sec-WebSocket-Key Sec-WebSocket-Version
    Sec-WebSocket-Protocol
    Access-Control-Request-Headers Mcp-Session-Id MCP-Protocol-Version Prefer Transfer-Encoding
    Content-Length""")

VALUES: Final = (
    *_words("""* , ; = q=1e400 application/json;q=1e308 text/event-stream application/cbor */*;q=nan
    bytes=0- bytes=-1
    bytes=9223372036854775808- bytes=0-0,0-0 W/"x","" null http://[ for="[::1]:99999999999"
    for=_hidden;proto=https
    1.2.3.4,, " chunked gzip;q=0.0001 br Bearer websocket Upgrade 13 keep-alive,Upgrade application/sdp
    application/trickle-ice-sdpfrag multipart/form-data /x/../.. javascript:alert(1) localhost"""),
    "", "http://\u00e9", "Bearer \u00ff", "a" * 4000,
)  # fmt: skip
"""Of headers."""

BODIES: Final = (
    *(word.encode() for word in _words("""{} [] null 1 -1e400 " {"data":1e308} {"order":1e400}
    {"order":2147483648} {"data":"\\ud800"} v=0
    {"a":9223372036854775808,"b":-9223372036854775809} {"linear":{"x":NaN}} {"linear":{"x":1e999}}
    {"jsonrpc":"2.0","id":1e400,"method":"initialize"} {"jsonrpc":"2.0","id":1,"method":"tools/list"}
    {"jsonrpc":"2.0","id":1,"method":"tools/call","params":{"name":"call_service","arguments":{"timeout":1e308}}}
    """)),
    b"", b"\xff\xfe", b'{"a":9' + b"9" * 400 + b"}", b"[" * 5000, b"\xa0", b"\x9f\xff",
    b"\xa1aa\xc2\x50" + b"\xff" * 16,
    b"\xa1\x61a\xfb\x7f\xf0" + bytes(6), b"v=0\r\no=- 9 9 IN IP4 0\r\ns=-\r\nt=0 0\r\n",
    b"v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\nm=video 99999999999 UDP/TLS/RTP/SAVPF 96\r\n",
)  # fmt: skip

METHODS: Final = (*["GET"] * 8, *["POST"] * 6, *_words("HEAD PUT PATCH DELETE OPTIONS TRACE CONNECT BREW"))

INCOMPLETE: Final = re.compile(
    rb"\r\n(Expect|Content-Length|Transfer-Encoding|Upgrade|Connection): (?!\d+\r\nConnection: close)"
)
"""Requests that may make the server wait for more bytes than arrive."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A server that is asked.

    Attributes:
        port: where it listens.
        graph: its robot's.
        failures: what it says of failures of its own.
    """

    port: int
    graph: Graph
    failures: Failures

    def endpoints(self) -> tuple[object, ...]:
        """All that the graph lists."""
        graph = self.graph
        return graph.topics(), graph.services(), graph.actions(), graph.nodes()

    def ask(self, request: bytes) -> bytes:
        """Return the beginning of the answer."""
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE) as connection:
            connection.sendall(request)
            if INCOMPLETE.search(request):
                connection.shutdown(socket.SHUT_WR)
            return connection.recv(65536)


def _robot(graph: Graph) -> Node:
    node = Node(graph, "robot")
    node.advertise("/label", "std_msgs/String", latch=True).publish({"data": "x"})
    picture = {"width": 4, "height": 2, "step": 12, "encoding": "rgb8", "data": bytes(24)}
    node.advertise("/image", "sensor_msgs/Image", latch=True).publish(picture)
    node.subscribe("/twist", lambda message: None, "geometry_msgs/Twist")
    node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda asked: {"sum": 1})

    async def count(goal: Any) -> dict[str, Any]:
        return {"sequence": []}

    node.advertise_action("/count", "example_interfaces/Fibonacci", count)
    node.parameters.declare("speed", 1.5)
    return node


@pytest.fixture(scope="module")
def asked() -> Iterator[Asked]:
    server = Server(
        "ws://127.0.0.1:0",
        extra_nodes=[_robot],
        gateways=("foxglove", "http", "mcp"),
        webrtc={"enabled": True},
        unregister_timeout=0.01,
    )
    with pytest.MonkeyPatch.context() as patch, Failures() as failures:
        patch.setattr(video, "PATIENCE", 0.01)
        patch.setattr(services, "MAX_WAIT_SECONDS", 0.01)
        patch.setattr(topics, "MAX_WAIT_SECONDS", 0.01)
        with start_blocking_portal("asyncio") as portal, portal.wrap_async_context_manager(server):
            yield Asked(int(server.urls[0].rpartition(":")[2]), server.graph, failures)


_numbers, _texts = st.sampled_from(NUMBERS), st.sampled_from(TEXTS)
_queries = st.lists(st.tuples(st.sampled_from(PARAMETERS), _numbers | _texts), max_size=4)
_headers = st.lists(st.tuples(st.sampled_from(HEADERS), st.sampled_from(VALUES) | _numbers), max_size=3)
_paths = st.sampled_from(WHOLE_PATHS) | st.tuples(
    st.sampled_from(PATHS), st.just("") | _texts | _numbers
).map("".join)


@st.composite
def requests(draw: st.DrawFn) -> bytes:
    """The bytes of a request."""
    path, topic = draw(_paths), draw(st.sampled_from(["", "topic=/image&"]))
    query = topic + "&".join(f"{name}={value}" for name, value in draw(_queries))
    headers, body = draw(_headers), draw(st.sampled_from(BODIES))
    given = {name for name, _ in headers}
    lines = [f"{draw(st.sampled_from(METHODS))} {path}{'?' if query else ''}{query} HTTP/1.1"]
    lines += [f"{name}: {value}" for name, value in headers]
    if "Host" not in given:
        lines.append("Host: 127.0.0.1")
    if not given & {"Content-Length", "Transfer-Encoding"}:
        lines.append(f"Content-Length: {len(body)}")
    return "\r\n".join([*lines, "Connection: close"]).encode("latin-1", "replace") + b"\r\n\r\n" + body


@settings(max_examples=EXAMPLES, derandomize=EXAMPLES == 200)
@given(request=requests())
def _ask_anything(asked: Asked, request: bytes) -> None:
    answer = asked.ask(request)
    asked.failures.check()
    assert answer[:9] == b"HTTP/1.1 " or (not answer and INCOMPLETE.search(request)), (request, answer)
    assert answer[9:12] != b"500", (request, answer)


def test_a_request_is_answered_or_refused_and_leaves_nothing(asked: Asked) -> None:
    before = asked.endpoints()
    _ask_anything(asked)
    wait_until(lambda: asked.endpoints() == before, lambda: f"{asked.endpoints()}, not {before}")
    asked.failures.check()
