"""Greedy clients of the shared pools: each fills one over the wire, then another client asks for a part.

Every row of the table of pools has a driver here, under the name of the pool. Addresses of the loopback
network stand for clients of different machines.
"""

from __future__ import annotations

import json
import socket
import ssl
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from subprocess import Popen
from typing import Any, Final
from urllib.parse import urlencode

from websockets.exceptions import ConnectionClosed, InvalidStatus

from rwt.delivery.compact import MOST_COMPACT
from tests.faults.isolation.served import LONGEST_S, Client, Served, served
from tests.processes import free_port, running
from tests.waiting import wait_until

GREEDY: Final = "127.0.0.2"
OTHER: Final = "127.0.0.3"

MOST: Final = 300
"""More than any pool has here."""

IMAGE: Final = "/camera/image_raw"


@dataclass(frozen=True, slots=True)
class Driver:
    """Driver of one pool.

    Attributes:
        fill: takes as much of the pool as one client can.
        ask: asks for a part as another client, and fails unless it is served.
        settings: settings of the server in TOML.
        prepare: starts what both need; returns the server.
    """

    fill: Callable[[Served, ExitStack], None]
    ask: Callable[[Served, ExitStack], None]
    settings: str = ""
    prepare: Callable[[Path, str], Any] = field(default=served)


# -- requests and connections of an address --------------------------------------------------------------


def request(
    server: Served,
    address: str,
    method: str,
    path: str,
    body: bytes = b"",
    headers: Mapping[str, str] | None = None,
) -> tuple[HTTPResponse, HTTPConnection]:
    """Send a request from an address; returns the response, whose body is unread, and its connection."""
    host, port = server.host.split(":")
    connection = HTTPConnection(host, int(port), timeout=LONGEST_S, source_address=(address, 0))
    connection.request(method, path, body, dict(headers or {}))
    return connection.getresponse(), connection


def take_responses(make: Callable[[int], tuple[HTTPResponse, HTTPConnection]], stack: ExitStack) -> int:
    """Keep responses open until one is refused with 503; returns how many are open."""
    for number in range(MOST):
        response, connection = make(number)
        stack.callback(connection.close)
        if response.status == 503:
            assert "(" in response.read().decode()
            return number
        assert response.status in (200, 201), (response.status, response.read())
    raise AssertionError(f"one client has {MOST} of the pool")


def connected(server: Served, address: str, stack: ExitStack, path: str = "/", **options: Any) -> Client:
    """Return a rosbridge client of an address."""
    return stack.enter_context(server.connect(path, source_address=(address, 0), **options))


def take_connections(server: Served, stack: ExitStack, path: str = "/") -> int:
    """Keep connections of the greedy client open until one is refused with 503; returns how many."""
    for number in range(MOST):
        try:
            connected(server, GREEDY, stack, path)
        except InvalidStatus as refused:
            assert refused.response.status_code == 503
            return number
    raise AssertionError(f"one client has {MOST} connections")


def frame_head(size: int, opcode: int = 0x81) -> bytes:
    """Return the head of a masked frame whose key is zero."""
    return struct.pack(">BBQ", opcode, 0xFF, size) + bytes(4)


# -- connections -----------------------------------------------------------------------------------------


def fill_connections(server: Served, stack: ExitStack) -> None:
    assert take_connections(server, stack) == 4


def ask_connection(server: Served, stack: ExitStack) -> None:
    assert connected(server, OTHER, stack).call("/rosapi/get_time")["result"]


def fill_pending(server: Served, stack: ExitStack) -> None:
    host, port = server.host.split(":")
    for _ in range(8):
        link = socket.create_connection((host, int(port)), LONGEST_S, (GREEDY, 0))
        stack.callback(link.close)
    # The server accepts connections in their order: when it cuts this one, it has seen all of them.
    last = socket.create_connection((host, int(port)), LONGEST_S, (GREEDY, 0))
    with closing(last), suppress(ConnectionError):
        assert last.recv(1) == b""


def ask_page(server: Served, stack: ExitStack) -> None:
    response, connection = request(server, OTHER, "GET", "/healthz")
    with closing(connection):
        assert response.status == 200


@contextmanager
def encrypted(folder: Path, settings: str) -> Iterator[Served]:
    with served(folder, settings, url="wss://127.0.0.1:0") as server:
        yield server


def hello(server: Served) -> tuple[ssl.SSLObject, ssl.MemoryBIO, ssl.MemoryBIO, socket.socket]:
    """Begin a TLS handshake as the other client, up to the server's answer."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    tls = context.wrap_bio(incoming, outgoing)
    host, port = server.host.split(":")
    link = socket.create_connection((host, int(port)), LONGEST_S, (OTHER, 0))
    try:
        tls.do_handshake()
    except ssl.SSLWantReadError:
        link.sendall(outgoing.read())
    incoming.write(link.recv(65536))
    return tls, incoming, outgoing, link


def fill_handshakes(server: Served, stack: ExitStack) -> None:
    host, port = server.host.split(":")
    for _ in range(MOST):
        link = socket.create_connection((host, int(port)), LONGEST_S, (GREEDY, 0))
        stack.callback(link.close)
    # The server accepts connections in their order: when it answers this one, it has seen all of them.
    _, _, _, link = hello(server)
    link.close()


def ask_handshake(server: Served, stack: ExitStack) -> None:
    tls, incoming, outgoing, link = hello(server)
    stack.callback(link.close)
    fill_handshakes(server, stack)
    while True:
        try:
            tls.do_handshake()
        except ssl.SSLWantReadError:
            link.sendall(outgoing.read())
            received = link.recv(65536)
            assert received, "the handshake was cut"
            incoming.write(received)
        else:
            break
    tls.write(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
    link.sendall(outgoing.read())
    incoming.write(link.recv(65536))
    # With TLS 1.3, session tickets may come first.
    while True:
        try:
            assert tls.read(12) == b"HTTP/1.1 200"
        except ssl.SSLWantReadError:
            received = link.recv(65536)
            assert received, "the connection was cut"
            incoming.write(received)
        else:
            return


# -- incomplete messages ---------------------------------------------------------------------------------

UNFINISHED: Final = 9_900_000


def send_unfinished(client: Client, size: int = UNFINISHED) -> None:
    """Send a message of which the last byte is missing; the server may close the connection meanwhile."""
    try:
        client.connection.socket.sendall(frame_head(size) + b" " * (size - 1))
    except OSError:
        return


def fill_buffers(server: Served, stack: ExitStack) -> None:
    for _ in range(7):
        send_unfinished(connected(server, GREEDY, stack))


def ask_buffer(server: Served, stack: ExitStack) -> None:
    client = connected(server, OTHER, stack)
    op = json.dumps({"op": "publish", "topic": "/large", "msg": {"data": "x" * 3_000_000}}).encode()
    client.send("advertise", topic="/large", type="std_msgs/String")
    half = len(op) // 2
    client.connection.socket.sendall(frame_head(len(op)) + op[:half])
    # Later messages of the greedy client are younger than this one.
    fill_buffers(server, stack)
    try:
        client.connection.socket.sendall(op[half:])
        assert client.call("/rosapi/get_time")["result"]
    except (ConnectionClosed, OSError):
        raise AssertionError(f"disconnected: {client.connection.close_reason}") from None


# -- images ----------------------------------------------------------------------------------------------


def stream(server: Served, address: str, **query: object) -> tuple[HTTPResponse, HTTPConnection]:
    """Open an image stream, and read its first bytes."""
    response, connection = request(
        server, address, "GET", f"/stream?{urlencode({'topic': IMAGE, **query}, safe='/')}"
    )
    if response.status == 200:
        assert response.read1(1)
    return response, connection


def ask_image(server: Served, stack: ExitStack) -> None:
    response, connection = request(server, OTHER, "GET", f"/snapshot?topic={IMAGE}&width=32&height=24")
    with closing(connection):
        assert response.status == 200, response.read()
        assert response.read()[:2] == b"\xff\xd8"


def fill_viewers(server: Served, stack: ExitStack) -> None:
    assert take_responses(lambda number: stream(server, GREEDY, quality=50), stack) == 4


def fill_encoders(server: Served, stack: ExitStack) -> None:
    def small(number: int) -> tuple[HTTPResponse, HTTPConnection]:
        return stream(server, GREEDY, quality=number + 1, width=16, height=12)

    assert take_responses(small, stack) == 16


def fill_pixels(server: Served, stack: ExitStack) -> None:
    def video(number: int) -> tuple[HTTPResponse, HTTPConnection]:
        return stream(server, GREEDY, type="vp8", width=64, height=48, bitrate=100_000 + number)

    assert take_responses(video, stack) == 2


def ask_video(server: Served, stack: ExitStack) -> None:
    response, connection = stream(server, OTHER, type="vp8", width=64, height=48, bitrate=300_000)
    stack.callback(connection.close)
    assert response.status == 200, response.read()


# -- HTTP, transforms and recordings ---------------------------------------------------------------------


def events(server: Served, address: str) -> tuple[HTTPResponse, HTTPConnection]:
    headers = {"Accept": "text/event-stream"}
    return request(server, address, "GET", "/api/topics/quiet?type=std_msgs/String", headers=headers)


def fill_streams(server: Served, stack: ExitStack) -> None:
    assert take_responses(lambda number: events(server, GREEDY), stack) == 4


def ask_stream(server: Served, stack: ExitStack) -> None:
    response, connection = events(server, OTHER)
    stack.callback(connection.close)
    assert response.status == 200, response.read()


def republished(client: Client) -> str:
    """Return the topic of a new stream of transforms."""
    wanted: dict[str, Any] = {
        "source_frames": ["base"],
        "target_frame": "map",
        "rate": 1.0,
        "timeout": {"sec": 60},
    }
    topic: str = client.call("/republish_tfs", **wanted)["values"]["topic_name"]
    return topic


def fill_transforms(server: Served, stack: ExitStack) -> None:
    client = connected(server, GREEDY, stack)
    for _ in range(MOST):
        republished(client)


def ask_transforms(server: Served, stack: ExitStack) -> None:
    client = connected(server, OTHER, stack)
    topic = republished(client)
    fill_transforms(server, stack)
    assert topic in client.call("/rosapi/topics")["values"]["topics"]


CLOUD: Final = "sensor_msgs/PointCloud2"


def whole(client: Client, topic: str) -> str:
    """Subscribe to the compact form of a topic; return the warning that it is sent whole, or nothing."""
    client.send("subscribe", topic=topic, type=CLOUD, compact={})
    client.send("call_service", service="/rosapi/get_time", id=topic)
    text = ""
    while (message := client.receive()).get("op") != "service_response":
        text += str(message.get("msg", ""))
    return text


def fill_compact(server: Served, stack: ExitStack) -> None:
    client = connected(server, GREEDY, stack)
    client.send("set_level", level="warning")
    for number in range(MOST_COMPACT + 1):
        text = whole(client, f"/points{number}")
    assert "subscriptions to compact messages" in text


def ask_compact(server: Served, stack: ExitStack) -> None:
    client = connected(server, OTHER, stack)
    client.send("set_level", level="warning")
    assert whole(client, "/points") == ""


ACTIONS: Final = ("/never", "/neither")
FIBONACCI: Final = "example_interfaces/action/Fibonacci"


def prepare_goals(server: Served, stack: ExitStack) -> None:
    """Offer actions whose goals never end."""
    robot = connected(server, "127.0.0.1", stack)
    for action in ACTIONS:
        robot.send("advertise_action", action=action, type=FIBONACCI)
    assert robot.call("/rosapi/get_time")["result"]


def leave_goals(server: Served, address: str, ids: Mapping[str, int]) -> None:
    """Send goals to actions, and leave: `ids` are the numbers of goals by action."""
    with server.connect(source_address=(address, 0)) as client:
        for action, count in ids.items():
            for number in range(count):
                members = {"action": action, "action_type": FIBONACCI, "args": {"order": 1}}
                client.send("send_action_goal", id=f"goal {number}", **members)
        assert client.call("/rosapi/get_time")["result"]


def fill_goals(server: Served, stack: ExitStack) -> None:
    prepare_goals(server, stack)
    leave_goals(server, GREEDY, dict.fromkeys(ACTIONS, 450))


def ask_goal(server: Served, stack: ExitStack) -> None:
    leave_goals(server, OTHER, {ACTIONS[0]: 1})
    leave_goals(server, GREEDY, dict.fromkeys(ACTIONS, 540))
    client = connected(server, OTHER, stack)
    client.send("set_level", level="info")
    client.send("cancel_action_goal", action=ACTIONS[0], id="goal 0")
    status = client.wait_for(op="status")
    assert status["level"] == "info", status


@contextmanager
def recorded(folder: Path, settings: str) -> Iterator[Served]:
    recordings = folder / "recordings"
    recordings.mkdir()
    with served(folder, f'{settings}recorder.folder = "{recordings}"\n') as server:
        yield server


def record(client: Client) -> dict[str, Any]:
    """Make a recording of 100 kB; returns the response of its start."""
    started: dict[str, Any] = client.call("/recorder/start", name="test")["values"]
    if started["success"]:
        client.send("advertise", topic="/noise", type="std_msgs/UInt8MultiArray")
        data = list(struct.pack(">Q", 0x9E3779B97F4A7C15)) * 12_500
        client.send("publish", topic="/noise", msg={"data": data})
        assert client.call("/recorder/stop")["result"]
    return started


def fill_recordings(server: Served, stack: ExitStack) -> None:
    client = connected(server, GREEDY, stack)
    for _ in range(MOST):
        started = record(client)
        if not started["success"]:
            assert "remove some of them" in started["message"]
            return
    raise AssertionError("the folder is not full")


def ask_recording(server: Served, stack: ExitStack) -> None:
    started = record(connected(server, OTHER, stack))
    assert started["success"], started


# -- WebRTC ----------------------------------------------------------------------------------------------

OFFER: Final = "\r\n".join(
    (
        "v=0", "o=- 1 1 IN IP4 127.0.0.1", "s=-", "t=0 0", "a=group:BUNDLE 0",
        "m=application 9 UDP/DTLS/SCTP webrtc-datachannel", "c=IN IP4 0.0.0.0", "a=ice-ufrag:abcd",
        "a=ice-pwd:abcdefghijklmnopqrstuvwx", f"a=fingerprint:sha-256 {':'.join(['AB'] * 32)}",
        "a=setup:actpass", "a=mid:0", "a=sctp-port:5000", "a=max-message-size:262144", "",
    )
)  # fmt: skip
"""Offer of a client that does not exist: its peer stays without a connection until `connect_seconds`."""


def offer(server: Served, address: str, more: str = "") -> tuple[HTTPResponse, HTTPConnection]:
    body = (OFFER + more).encode()
    return request(server, address, "POST", "/webrtc", body, {"Content-Type": "application/sdp"})


def fill_peers(server: Served, stack: ExitStack) -> None:
    assert take_responses(lambda number: offer(server, GREEDY), stack) == 4


def fill_connecting(server: Served, stack: ExitStack) -> None:
    for _ in range(4):  # A fifth would wait for some seconds.
        response, connection = offer(server, GREEDY)
        stack.callback(connection.close)
        assert response.status == 201, response.read()


def ask_peer(server: Served, stack: ExitStack) -> None:
    response, connection = offer(server, OTHER)
    stack.callback(connection.close)
    assert response.status == 201, response.read()


def fill_offers(server: Served, stack: ExitStack) -> None:
    fill_connecting(server, stack)
    long = "".join(f"a=x-padding:{'x' * 4000}\r\n" for _ in range(14))

    def wait() -> None:
        _, connection = offer(server, GREEDY, long)
        connection.close()

    threads = [threading.Thread(target=wait) for _ in range(20)]
    for thread in threads:
        thread.start()
        stack.callback(thread.join)


# -- files of packages -----------------------------------------------------------------------------------

FILE_BYTES: Final = 40 * 1024 * 1024
FOXGLOVE: Final = ["foxglove.sdk.v1"]


@contextmanager
def with_files(folder: Path, settings: str) -> Iterator[Served]:
    """Start a server with a large file of a package."""
    meshes = folder / "share" / "arm" / "meshes"
    meshes.mkdir(parents=True)
    with (meshes / "large.stl").open("wb") as large:
        large.truncate(FILE_BYTES)
    with served(folder, f"packages = [{json.dumps(str(folder / 'share'))}]\n{settings}") as server:
        yield server


def fetch_file(server: Served, address: str, stack: ExitStack) -> Client:
    client = connected(server, address, stack, subprotocols=FOXGLOVE, max_queue=1, close_timeout=0.1)
    asked = {"op": "fetchAsset", "uri": "package://arm/meshes/large.stl", "requestId": 1}
    client.connection.send(json.dumps(asked))
    return client


def fill_files(server: Served, stack: ExitStack) -> None:
    for _ in range(8):
        fetch_file(server, GREEDY, stack)  # It reads nothing.


def ask_file(server: Served, stack: ExitStack) -> None:
    client = fetch_file(server, OTHER, stack)
    with suppress(TimeoutError):
        while not isinstance(found := client.connection.recv(LONGEST_S), bytes):
            pass
        assert len(found) > FILE_BYTES
        return
    raise AssertionError("the file did not come")


# -- the hub ---------------------------------------------------------------------------------------------


@contextmanager
def hub(folder: Path, settings: str) -> Iterator[Served]:
    """Start a hub and a robot that dials in, with options of the hub in place of settings."""
    log = folder / "log"
    with log.open("w") as lines:
        command = ("hub", "ws://127.0.0.1:0", *settings.split())
        with running(*command, stderr=lines.fileno()) as (process, listening):
            dial = f"{listening}/robots/arm"
            with running("serve", "--demo", "--dial", dial, ready="dialing", stderr=lines.fileno()):
                server = Served(process, listening.rpartition("//")[2].strip("/"), log)
                wait_until(lambda: b"arm" in fetched(server, "/robots"))
                yield server


@contextmanager
def two_nodes(folder: Path, settings: str) -> Iterator[Served]:
    """Start two nodes of a hub, and three robots at one; the other one is attacked."""
    log = folder / "log"
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with log.open("w") as lines, ExitStack() as stack:

        def started(*command: str, ready: str = "listening on ") -> tuple[Popen[str], str]:
            return stack.enter_context(running(*command, ready=ready, stderr=lines.fileno()))

        _, home = started("hub", "ws://127.0.0.1:0", "--cluster-listen", endpoint)
        process, listening = started("hub", "ws://127.0.0.1:0", "--cluster", endpoint, *settings.split())
        dials = [part for name in ("arm", "leg", "eye") for part in ("--dial", f"{home}/robots/{name}")]
        started("serve", *dials, ready="dialing")
        server = Served(process, listening.rpartition("//")[2].strip("/"), log)
        wait_until(lambda: fetched(server, "/robots").count(b"path") == 3)
        yield server


def fill_links(server: Served, stack: ExitStack) -> None:
    for name in ("leg", "eye"):
        connected(server, GREEDY, stack, f"/{name}")


def fetched(server: Served, path: str) -> bytes:
    """Return the body of a page."""
    response, connection = request(server, "127.0.0.1", "GET", path)
    with closing(connection):
        return response.read()


def fill_places(server: Served, stack: ExitStack) -> None:
    assert take_connections(server, stack, "/arm") >= 3


def ask_robot(server: Served, stack: ExitStack) -> None:
    client = connected(server, OTHER, stack, "/arm")
    assert client.call("/rosapi/get_time")["result"]


def fill_waiting_bytes(server: Served, stack: ExitStack) -> None:
    for _ in range(8):
        client = connected(server, GREEDY, stack, "/arm")
        client.send("subscribe", topic=IMAGE, type="sensor_msgs/Image")  # It reads nothing.


def dial(server: Served, address: str, name: str, stack: ExitStack) -> socket.socket | None:
    """Return a robot's connection, which has not greeted; None if it is refused with 503."""
    host, port = server.host.split(":")
    link = stack.enter_context(socket.create_connection((host, int(port)), LONGEST_S, (address, 0)))
    link.sendall(
        f"GET /robots/{name} HTTP/1.1\r\nHost: {server.host}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: rwt-uplink.1\r\n"
        f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nRwt-Instance: {name}\r\n\r\n".encode()
    )
    status = link.recv(4096).split()[1]
    assert status in (b"101", b"503")
    return link if status == b"101" else None


def greet(link: socket.socket) -> bytes:
    """Send the greeting of a robot; returns what the hub answers, which is empty if it hangs up."""
    hello = b"\x40\0\0\0\0\0{}"
    link.sendall(bytes((0x82, 0x80 | len(hello))) + bytes(4) + hello)
    with suppress(ConnectionError):
        return link.recv(4096)
    return b""


def fill_greetings(server: Served, stack: ExitStack) -> None:
    assert any(dial(server, GREEDY, f"greedy{number}", stack) is None for number in range(MOST))


def fill_robots(server: Served, stack: ExitStack) -> None:
    for number in range(MOST):
        link = dial(server, GREEDY, f"greedy{number}", stack)
        if link is None:
            return
        assert greet(link)[:1] == b"\x82"
    raise AssertionError(f"one client has {MOST} robots")


def ask_for_robot(server: Served, stack: ExitStack) -> None:
    link = dial(server, OTHER, "other", stack)
    assert link is not None
    assert b"session" in greet(link)


DRIVERS: Final[Mapping[str, Driver]] = {
    "connections": Driver(fill_connections, ask_connection, "limits.connections = 4\n"),
    "pending connections": Driver(
        fill_pending, ask_page, "limits.connections = 4\nlimits.handshake_seconds = 3600.0\n"
    ),
    "TLS handshakes": Driver(
        fill_handshakes, ask_handshake, "tls.auto = true\nlimits.handshake_seconds = 60.0\n", encrypted
    ),
    "receive buffers": Driver(fill_buffers, ask_buffer),
    "viewers of images": Driver(fill_viewers, ask_image, "demo = true\nlimits.video_viewers = 4\n"),
    "image encoders": Driver(fill_encoders, ask_image, "demo = true\n"),
    "pixels of videos": Driver(fill_pixels, ask_video, "demo = true\nlimits.video_pixels = 7000\n"),
    "event streams and long polls": Driver(fill_streams, ask_stream, "api.streams = 4\n"),
    "transform streams": Driver(fill_transforms, ask_transforms),
    "compact subscriptions": Driver(fill_compact, ask_compact),
    "goals without their clients": Driver(fill_goals, ask_goal),
    "files in transit": Driver(fill_files, ask_file, "", with_files),
    "recordings": Driver(fill_recordings, ask_recording, "recorder.folder_bytes = 200000\n", recorded),
    "WebRTC peers": Driver(
        fill_peers, ask_peer, "webrtc.enabled = true\nwebrtc.peers = 4\nwebrtc.handshakes = 100\n"
    ),
    "WebRTC handshakes": Driver(fill_connecting, ask_peer, "webrtc.enabled = true\nwebrtc.handshakes = 4\n"),
    "waiting WebRTC offers": Driver(fill_offers, ask_peer, "webrtc.enabled = true\nwebrtc.handshakes = 4\n"),
    "waiting bytes of a hub": Driver(fill_waiting_bytes, ask_robot, "--waiting-bytes 65536", hub),
    "clients of a hub": Driver(fill_places, ask_robot, "--connections 6", hub),
    "robots of a hub": Driver(fill_robots, ask_for_robot, "--robots 4", hub),
    "robots that dial in": Driver(fill_greetings, ask_for_robot, "", hub),
    "links of a node": Driver(fill_links, ask_robot, "--links 2", two_nodes),
}
"""Drivers by the name of the pool."""
