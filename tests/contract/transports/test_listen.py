"""One contract for every scheme, driver and event loop: what an accept function and a peer see is the
same."""

from __future__ import annotations

import datetime
import ipaddress
import json
import logging
import os
import select
import socket
import ssl
import struct
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Protocol

import anyio
import anyio.lowlevel
import pytest
from anyio.abc import ByteStream, ConnectedUDPSocket, SocketAttribute
from anyio.streams.tls import TLSStream
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from websockets.client import ClientProtocol
from websockets.frames import Frame as WebSocketFrame
from websockets.frames import Opcode
from websockets.uri import parse_uri

from rwt_protocol.frames import Frame
from rwt_transports import HttpRequest, HttpResponse, Limits, ListenError, Refused, Routes, listen
from rwt_transports.api import Driver, FlowControl
from rwt_transports.drivers.anyio_stream import AnyioDriver
from rwt_transports.drivers.asyncio_protocol import AsyncioDriver
from rwt_transports.drivers.sockets import UNSENT_BYTES
from rwt_transports.drivers.standard_streams import DescriptorStream, StandardStreamsDriver
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.limits import READY_BYTES
from rwt_transports.listener import Listener
from rwt_transports.outbox import TAKE_BYTES
from rwt_transports.scheduler import Budget

pytestmark = pytest.mark.anyio

UVLOOP = ("asyncio", {"use_uvloop": True})

STACKS = [
    pytest.param("asyncio", AsyncioDriver, id="asyncio-sockets"),
    pytest.param(UVLOOP, AsyncioDriver, id="uvloop-sockets"),
    pytest.param("asyncio", AnyioDriver, id="asyncio-streams"),
    pytest.param("trio", AnyioDriver, id="trio-streams"),
]


# -- clients that are not ours -----------------------------------------------------------------------------


class Client(Protocol):
    """A peer that speaks JSON objects, whatever is below."""

    @property
    def port(self) -> int: ...

    async def open(self) -> None: ...

    async def send(self, message: object) -> None: ...

    async def receive(self) -> object: ...

    async def ending(self) -> str:
        """Read to the end; says how it ended."""
        ...

    async def close(self) -> None: ...


class WebSocketClient:
    """On another implementation of the protocol."""

    def __init__(self, stream: ByteStream) -> None:
        self.stream = stream
        self.protocol = ClientProtocol(parse_uri("ws://localhost/robot"), max_size=None)
        self.messages: list[bytes] = []

    @property
    def port(self) -> int:
        return self.stream.extra(SocketAttribute.local_port)

    async def open(self) -> None:
        self.protocol.send_request(self.protocol.connect())
        await self._flush()
        while self.protocol.state.name == "CONNECTING":
            await self._read()
        assert self.protocol.state.name == "OPEN"

    async def send(self, message: object) -> None:
        self.protocol.send_text(json.dumps(message).encode())
        await self._flush()

    async def receive(self) -> object:
        while not self.messages:
            await self._read()
        return json.loads(self.messages.pop(0))

    async def ending(self) -> str:
        try:
            while True:
                await self._read()
        except anyio.EndOfStream:
            return f"{self.protocol.close_code} {self.protocol.close_reason}"

    async def close(self) -> None:
        self.protocol.send_close(1000, "bye")
        await self._flush()
        await self.ending()

    async def _read(self) -> None:
        try:
            self.protocol.receive_data(await self.stream.receive())
        except anyio.EndOfStream:
            self.protocol.receive_eof()
            raise
        for event in self.protocol.events_received():
            if isinstance(event, WebSocketFrame) and event.opcode is not Opcode.CLOSE:
                assert event.opcode is Opcode.TEXT and event.fin
                self.messages.append(bytes(event.data))
        await self._flush()

    async def _flush(self) -> None:
        for data in self.protocol.data_to_send():
            if data:
                await self.stream.send(data)


class JsonClient:
    """Objects on a stream, split by the standard library's decoder."""

    def __init__(self, stream: ByteStream) -> None:
        self.stream = stream
        self.text = ""

    @property
    def port(self) -> int:
        return self.stream.extra(SocketAttribute.local_port)

    async def open(self) -> None:
        """No-op: this transport has no handshake."""

    async def send(self, message: object) -> None:
        await self.stream.send(json.dumps(message).encode())

    async def receive(self) -> object:
        while True:
            try:
                message, end = json.JSONDecoder().raw_decode(self.text)
            except json.JSONDecodeError:
                self.text += (await self.stream.receive()).decode()
            else:
                self.text = self.text[end:].lstrip()
                return message

    async def ending(self) -> str:
        try:
            while True:
                await self.stream.receive()
        except anyio.EndOfStream:
            return "end"

    async def close(self) -> None:
        await self.stream.aclose()


class DatagramClient:
    """One object in each datagram."""

    def __init__(self, socket: ConnectedUDPSocket) -> None:
        self.socket = socket

    @property
    def port(self) -> int:
        return self.socket.extra(SocketAttribute.local_port)

    async def open(self) -> None:
        """No-op: this transport has no handshake."""

    async def send(self, message: object) -> None:
        await self.socket.send(json.dumps(message).encode())

    async def receive(self) -> object:
        with anyio.fail_after(5):
            return json.loads(await self.socket.receive())

    async def ending(self) -> str:
        raise AssertionError("nothing tells a UDP client that it is over")

    async def close(self) -> None:
        await self.socket.aclose()


class Pipes(DescriptorStream):
    """The other program's ends of our standard input and output."""

    def __init__(self, read_from: int, write_to: int) -> None:
        super().__init__(read_from, write_to)
        os.set_blocking(write_to, False)
        self.open = [read_from, write_to]

    async def aclose(self) -> None:
        await super().aclose()
        while self.open:
            os.close(self.open.pop())


# -- the server under test ---------------------------------------------------------------------------------


class Echo:
    """Sends every message back."""

    def __init__(self, sink: Sink, peer: PeerInfo) -> None:
        self.sink = sink
        self.peer = peer
        self.closings: list[tuple[int, str]] = []
        self.over = anyio.Event()

    def receive(self, data: bytes, binary: bool) -> None:
        self.sink.send(Frame(data, binary=binary))

    def closed(self, code: int, reason: str) -> None:
        self.closings.append((code, reason))
        self.over.set()


class Hub:
    """An accept function that keeps its endpoints."""

    def __init__(self, make: type[Echo] = Echo) -> None:
        self.make = make
        self.endpoints: list[Echo] = []
        self.refuse = ""

    def __call__(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        if self.refuse:
            raise Refused(403, self.refuse)
        endpoint = self.make(sink, peer)
        self.endpoints.append(endpoint)
        return endpoint


class Site:
    """A listener, and how to reach it."""

    def __init__(
        self, scheme: str, make_driver: Callable[[], Driver], folder: Path, certificate: Path
    ) -> None:
        self.scheme = scheme
        self.make_driver = make_driver
        self.hub = Hub()
        self.path = folder / "s.sock"
        self.certificate = certificate
        self.pipes: list[tuple[int, int]] = []

    @property
    def url(self) -> str:
        if self.scheme == "stdio":
            return "stdio:"
        return f"unix://{self.path}" if self.scheme == "unix" else f"{self.scheme}://127.0.0.1:0"

    @asynccontextmanager
    async def listen(
        self, limits: Limits | None = None, routes: Routes | None = None
    ) -> AsyncIterator[Listener]:
        tls = None
        if self.scheme in ("wss", "tcps"):
            tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            tls.load_cert_chain(self.certificate)
        chosen = limits or Limits(close_seconds=1)
        async with listen(
            self.url, self.hub, limits=chosen, routes=routes, driver=self.driver(), tls=tls
        ) as listener:
            if self.scheme != "stdio":
                yield listener
                return
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(self.exit_with, listener)
                yield listener
                tasks.cancel_scope.cancel()

    def driver(self) -> Driver | None:
        if self.scheme == "udp":
            return None
        if self.scheme != "stdio":
            return self.make_driver()
        ours, theirs = os.pipe(), os.pipe()
        self.pipes = [(ours[0], theirs[1]), (theirs[0], ours[1])]
        return StandardStreamsDriver(self.pipes[0])

    async def exit_with(self, listener: Listener) -> None:
        """Close the pipes as a process does when its service ends."""
        await listener.ended()
        for each in self.pipes[0]:
            os.close(each)

    async def stream(self, listener: Listener) -> ByteStream:
        if self.scheme == "unix":
            return await anyio.connect_unix(self.path)
        if self.scheme == "stdio":
            return Pipes(*self.pipes[1])
        stream = await anyio.connect_tcp("127.0.0.1", int(listener.url.rpartition(":")[2]))
        if self.scheme not in ("wss", "tcps"):
            return stream
        trust = ssl.create_default_context(cafile=str(self.certificate))
        return await TLSStream.wrap(
            stream, hostname="127.0.0.1", ssl_context=trust, standard_compatible=False
        )

    @asynccontextmanager
    async def client(self, listener: Listener) -> AsyncIterator[Client]:
        if self.scheme == "udp":
            port = int(listener.url.rpartition(":")[2])
            async with await anyio.create_connected_udp_socket("127.0.0.1", port) as socket:
                yield DatagramClient(socket)
            return
        stream = await self.stream(listener)
        client: Client = WebSocketClient(stream) if self.scheme in ("ws", "wss") else JsonClient(stream)
        async with stream:
            await client.open()
            yield client

    async def endpoint(self, client: Client) -> Echo:
        """The endpoint of the client that connected last."""
        await client.send({"hello": 1})
        assert await client.receive() == {"hello": 1}
        return self.hub.endpoints[-1]


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A key and a certificate of its own for 127.0.0.1, in one file."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "robot")])
    start = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    signed = (
        x509.CertificateBuilder(name, name, key.public_key(), 1, start, start.replace(year=2120))
        .add_extension(address, critical=False)
        .sign(key, hashes.SHA256())
    )
    path = tmp_path_factory.mktemp("tls") / "robot.pem"
    path.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        + signed.public_bytes(serialization.Encoding.PEM)
    )
    return path


@pytest.fixture
def anyio_backend(backend: object) -> object:
    return backend


@pytest.fixture
def site(scheme: str, make_driver: Callable[[], Driver], tmp_path: Path, certificate: Path) -> Site:
    return Site(scheme, make_driver, tmp_path, certificate)


@pytest.fixture(autouse=True)
def no_noise(caplog: pytest.LogCaptureFixture) -> object:
    """Whatever peers do, nothing above INFO is logged unless a test says so."""
    yield
    assert [record for record in caplog.records if record.levelno > logging.INFO] == []


every_stack = pytest.mark.parametrize(("backend", "make_driver"), STACKS)
SERVERS = ["ws", "wss", "tcp", "tcps", "unix"]
every_scheme = pytest.mark.parametrize("scheme", [*SERVERS, "udp", "stdio"])
every_stream = pytest.mark.parametrize("scheme", [*SERVERS, "stdio"])
every_shared = pytest.mark.parametrize("scheme", [*SERVERS, "udp"])
every_server = pytest.mark.parametrize("scheme", SERVERS)
over_tcp = pytest.mark.parametrize("scheme", ["ws", "tcp"])
over_secure_ws = pytest.mark.parametrize("scheme", ["ws", "wss"])
over_ws = pytest.mark.parametrize("scheme", ["ws"])


MAP_BYTES = 1 << 20

# -- messages ----------------------------------------------------------------------------------------------


@every_stack
@every_scheme
async def test_messages_come_back_in_order(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        for at in range(50):
            await client.send({"n": at, "text": 'grün {"} \\'})
        assert [await client.receive() for _ in range(50)] == [
            {"n": at, "text": 'grün {"} \\'} for at in range(50)
        ]
        assert listener.connections == 1


@every_stack
@every_stream
async def test_a_large_message_both_ways(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        message = {"data": "x" * 3_000_000}
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(client.send, message)
            assert await client.receive() == message


class TurnsOfMessages(Hub):
    """Counts the turns of the event loop, and notes in which of them each message was complete."""

    def __init__(self) -> None:
        hub = self

        class Noted(Echo):
            def receive(self, data: bytes, binary: bool) -> None:
                hub.turns.append(hub.turn)

        super().__init__(Noted)
        self.turn = 0
        self.turns: list[int] = []

    async def count(self) -> None:
        while True:
            await anyio.lowlevel.checkpoint()
            self.turn += 1

    def received(self) -> int:
        """Bytes of all connections."""
        return sum(endpoint.sink.received for endpoint in self.endpoints)


@asynccontextmanager
async def all_but_the_end_of_large_messages(
    site: Site, many: int, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[TurnsOfMessages, list[ByteStream], bytes]]:
    """Clients of which each has sent a large message up to its last byte, where a turn is full at once."""
    for driver in ("asyncio_protocol", "anyio_stream"):
        monkeypatch.setattr(f"rwt_transports.drivers.{driver}.READING", Budget(turn=0.0, share=0.0))
    site.hub = hub = TurnsOfMessages()
    message = json.dumps({"data": "x" * 1_100_000}).encode()
    header = struct.pack(">BBQ", 0x81, 0xFF, len(message)) + bytes(4)
    async with site.listen() as listener, AsyncExitStack() as stack, anyio.create_task_group() as tasks:
        streams = []
        for _ in range(many):
            client = await stack.enter_async_context(site.client(listener))
            assert isinstance(client, WebSocketClient)
            streams.append(client.stream)
            tasks.start_soon(client.stream.send, header + message[:-1])
        with anyio.fail_after(20):
            while hub.received() < many * (len(header) + len(message) - 1):
                await anyio.lowlevel.checkpoint()
            yield hub, streams, message[-1:]
        tasks.cancel_scope.cancel()


@every_stack
@over_secure_ws
async def test_large_messages_that_end_at_once_are_taken_in_turns(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    many = 8
    async with (
        all_but_the_end_of_large_messages(site, many, monkeypatch) as (hub, streams, end),
        anyio.create_task_group() as tasks,
    ):
        tasks.start_soon(hub.count)
        for stream in streams:
            tasks.start_soon(stream.send, end)
        while len(hub.turns) < many:
            await anyio.lowlevel.checkpoint()
        tasks.cancel_scope.cancel()
    # One message fills a turn. On trio, whose tasks run in random order, the last message of a turn can be
    # counted with the first of the next.
    assert max(Counter(hub.turns).values()) <= 2


@every_stack
@over_secure_ws
async def test_a_large_message_that_waits_for_its_turn_outlives_its_sender(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def end_and_leave(stream: ByteStream) -> None:
        await stream.send(end)
        await stream.aclose()

    many = 4
    async with (
        all_but_the_end_of_large_messages(site, many, monkeypatch) as (hub, streams, end),
        anyio.create_task_group() as tasks,
    ):
        for stream in streams:
            tasks.start_soon(end_and_leave, stream)
        for endpoint in hub.endpoints:
            await endpoint.over.wait()
    assert len(hub.turns) == many
    assert [len(endpoint.closings) for endpoint in hub.endpoints] == [1] * many


class HeldBack(Echo):
    """Takes nothing from the moment at which it is told so."""

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self.flow_control = flow_control


async def cut(stream: ByteStream) -> None:
    """End a connection with a reset, as when its process is killed."""
    peer = stream.extra(SocketAttribute.raw_socket)
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    await anyio.aclose_forcefully(stream)


@pytest.mark.skipif(not hasattr(select, "POLLRDHUP"), reason="the system does not tell")
@every_stack
@over_secure_ws
async def test_a_peer_that_is_cut_while_it_is_held_back_is_missed(site: Site) -> None:
    site.hub = Hub(HeldBack)
    async with site.listen() as listener, site.client(listener) as client:
        assert isinstance(client, WebSocketClient)
        endpoint = await site.endpoint(client)
        assert isinstance(endpoint, HeldBack)
        endpoint.flow_control.pause()
        for _ in range(3):
            await client.send({"data": "x" * 100_000})
        await cut(client.stream)
        with anyio.fail_after(20):
            await endpoint.over.wait()


class Slow(HeldBack):
    """Takes one message, and for the time being no other."""

    taken = 0

    def receive(self, data: bytes, binary: bool) -> None:
        self.taken = len(data)
        self.flow_control.pause()


@every_stack
@every_server
async def test_few_large_messages_wait_to_be_read_and_the_rest_with_their_senders(site: Site) -> None:
    def taken() -> list[Slow]:
        return [each for each in site.hub.endpoints if isinstance(each, Slow) and each.taken]

    async def takes(count: int) -> None:
        with anyio.fail_after(60):
            while len(taken()) < count:
                await anyio.lowlevel.checkpoint()

    site.hub = Hub(Slow)
    # A quarter of the bytes that come in may wait.
    limits = Limits(close_seconds=1, message_bytes=1 << 20, incoming_bytes=3_500_000)
    async with site.listen(limits) as listener, AsyncExitStack() as stack:
        clients = []
        async with anyio.create_task_group() as tasks:
            for _ in range(3):
                client = await stack.enter_async_context(site.client(listener))
                assert isinstance(client, WebSocketClient | JsonClient)
                clients.append(client)
                tasks.start_soon(client.send, {"data": "x" * 900_000})
            await takes(1)
            for _ in range(500):  # Turns, in which the others would long have been taken.
                await anyio.lowlevel.checkpoint()
            assert len(taken()) == 1
            first = taken()[0]
            first.flow_control.resume()
            await takes(2)
            second = next(each for each in taken() if each is not first)
            await cut(clients[site.hub.endpoints.index(second)].stream)
            await takes(3)
            tasks.cancel_scope.cancel()


@every_stack
@every_shared
async def test_one_frame_to_many(site: Site) -> None:
    async with (
        site.listen() as listener,
        site.client(listener) as a,
        site.client(listener) as b,
        site.client(listener) as c,
    ):
        for client in (a, b, c):
            await site.endpoint(client)
        frame = Frame(b'{"to":', b'"all"}')
        for endpoint in site.hub.endpoints:
            endpoint.sink.flow("/all").send(frame)
        assert [await client.receive() for client in (a, b, c)] == [{"to": "all"}] * 3


@every_stack
@over_tcp
async def test_a_frame_that_cannot_be_written_costs_its_own_connection_only(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    class Impossible(Frame):
        def framed(self, framing: Callable[[Frame], bytes]) -> bytes:
            raise RuntimeError("no bytes")

    async with site.listen() as listener, site.client(listener) as victim, site.client(listener) as bystander:
        for client in (victim, bystander):
            await site.endpoint(client)
        first, second = site.hub.endpoints
        first.sink.send(Frame(b"{" + b" " * 200_000 + b"}"))
        first.sink.send(Impossible(b"x"))
        second.sink.send(Frame(b'{"good":1}'))
        with anyio.fail_after(5):
            await first.over.wait()
            assert await bystander.receive() == {"good": 1}
    assert "failed" in caplog.text
    caplog.clear()


@every_stack
@every_scheme
async def test_what_the_endpoint_knows_of_its_peer(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        peer = (await site.endpoint(client)).peer
        assert peer.transport == site.scheme
        if site.scheme not in ("unix", "stdio"):
            assert peer.address == "127.0.0.1"
            assert peer.port == client.port
        if site.scheme in ("ws", "wss"):
            assert peer.path == "/robot" and peer.headers["host"] == "localhost"


# -- endings -----------------------------------------------------------------------------------------------


@every_stack
@every_stream
async def test_the_client_closes(site: Site) -> None:
    async with site.listen() as listener:
        async with site.client(listener) as client:
            endpoint = await site.endpoint(client)
            await client.close()
            await endpoint.over.wait()
        assert [code for code, _ in endpoint.closings] == [1000 if site.scheme in ("ws", "wss") else 1006]


@every_stack
@over_tcp
async def test_the_client_is_killed_in_the_midst_of_a_message(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as bystander:
        async with site.client(listener) as client:
            endpoint = await site.endpoint(client)
            assert isinstance(client, WebSocketClient | JsonClient)
            await client.stream.send(b"\x81\xff\0\0\0\0\0\1\0\0abcd{")
            await cut(client.stream)
        with anyio.fail_after(5):
            await endpoint.over.wait()
        assert [code for code, _ in endpoint.closings] == [1006]
        await site.endpoint(bystander)


@every_stack
@every_stream
async def test_the_endpoint_closes(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        endpoint = await site.endpoint(client)
        endpoint.sink.send(Frame(b'{"last":1}'))
        endpoint.sink.close(4000, "enough")
        endpoint.sink.send(Frame(b'{"late":1}'))
        assert await client.receive() == {"last": 1}
        assert await client.ending() == ("4000 enough" if site.scheme in ("ws", "wss") else "end")
        with anyio.fail_after(5):
            await endpoint.over.wait()
        assert endpoint.closings == [(4000, "enough")]


@every_stack
@every_server
async def test_leaving_the_block_closes_everyone(site: Site) -> None:
    async with anyio.create_task_group() as tasks:
        endings: list[str] = []

        async def stay(client: Client) -> None:
            endings.append(await client.ending())

        async with anyio.create_task_group() as inner:
            clients = []
            async with site.listen() as listener:
                for _ in range(3):
                    client = site.client(listener)
                    clients.append(client)
                    entered = await client.__aenter__()
                    await site.endpoint(entered)
                    inner.start_soon(stay, entered)
            assert listener.connections == 0
        for client in clients:
            await client.__aexit__(None, None, None)
        tasks.cancel_scope.cancel()
    said = "1001 the server is going away" if site.scheme in ("ws", "wss") else "end"
    assert endings == [said] * 3
    assert [endpoint.closings for endpoint in site.hub.endpoints] == [
        [(1001, "the server is going away")]
    ] * 3


@every_stack
@over_tcp
async def test_a_client_that_does_not_react_to_the_end_is_cut(site: Site) -> None:
    async with site.listen(Limits(close_seconds=0)) as listener:
        stream = await site.stream(listener)
    async with stream:
        with pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
            await stream.receive()


# -- slow readers ------------------------------------------------------------------------------------------


@every_stack
@over_tcp
async def test_a_stopped_reader_costs_bounded_memory_and_hurts_nobody(site: Site) -> None:
    limits = Limits(data_bytes=1_000_000, close_seconds=0)
    async with (
        site.listen(limits) as listener,
        site.client(listener) as healthy,
        site.client(listener) as stopped,
    ):
        await site.endpoint(healthy)
        sink = (await site.endpoint(stopped)).sink
        images = sink.flow("/image")
        for at in range(300):
            images.send(Frame(b'{"at":%d,"x":"%s"}' % (at, b"x" * 100_000)))
            if at % 20 == 0:
                await healthy.send({"at": at})
                assert await healthy.receive() == {"at": at}
        assert sink.backlog < 2_000_000
        last: object = None
        while last != 299:
            message = await stopped.receive()
            assert isinstance(message, dict)
            last = message["at"]


@every_stack
@over_ws
async def test_behind_many_maps_a_small_message_waits_for_the_one_being_written(site: Site) -> None:
    limits = Limits(data_bytes=1 << 30, close_seconds=0)
    async with site.listen(limits) as listener, site.client(listener) as client:
        sink = (await site.endpoint(client)).sink
        maps = sink.flow("/map")
        for _ in range(50):
            maps.send(Frame(b'{"map":"%s"}' % (b"x" * MAP_BYTES)))
        before = -1
        while before != sink.backlog:  # Until the network takes nothing more.
            before = sink.backlog
            await anyio.wait_all_tasks_blocked()
            await anyio.sleep(0.02)
        assert sink.traffic.queued_messages > 40
        sink.flow("/odom").send(Frame(b'{"odom":1}'))
        whole = 0
        while await client.receive() != {"odom": 1}:
            whole += 1
    in_kernels = 2 * UNSENT_BYTES + 512 * 1024  # Ours, and what the peer's takes in before it is read.
    assert whole * MAP_BYTES < MAP_BYTES + READY_BYTES + TAKE_BYTES + in_kernels


# -- datagrams: no connection, so sessions by address ------------------------------------------------------


def short_silence() -> Limits:
    return Limits(idle_peer_seconds=0.01)


@every_stack
@pytest.mark.parametrize("scheme", ["udp"])
async def test_a_silent_peer_is_forgotten_and_may_come_again(site: Site) -> None:
    async with site.listen(short_silence()) as listener, site.client(listener) as client:
        endpoint = await site.endpoint(client)
        with anyio.fail_after(5):
            await endpoint.over.wait()
        assert [code for code, _ in endpoint.closings] == [1006]
        assert listener.connections == 0
        assert await site.endpoint(client) is not endpoint


@every_stack
@pytest.mark.parametrize("scheme", ["udp"])
async def test_peers_are_bounded(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    async with (
        site.listen(Limits(connections=1)) as listener,
        site.client(listener) as first,
        site.client(listener) as second,
    ):
        await site.endpoint(first)
        await second.send({"let": "me in"})
        await site.endpoint(first)
        assert len(site.hub.endpoints) == listener.connections == 1
    assert "no room" in caplog.text
    caplog.clear()


@every_stack
@pytest.mark.parametrize("scheme", ["udp"])
async def test_a_datagram_holds_one_or_more_messages_and_none_goes_on_in_the_next(site: Site) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        assert isinstance(client, DatagramClient)
        await client.socket.send(b'{"a":1}{"b":2} {"c":"cut off')
        assert [await client.receive() for _ in range(2)] == [{"a": 1}, {"b": 2}]
        assert await client.socket.receive() == b'{"c":"cut off'
        await client.send({"d": 4})
        assert await client.receive() == {"d": 4}


@every_stack
@pytest.mark.parametrize("scheme", ["udp"])
async def test_what_does_not_fit_a_datagram_is_left_out_and_logged(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    async with site.listen() as listener, site.client(listener) as client:
        sink = (await site.endpoint(client)).sink
        for size in (65_508, 300_000, 65_507, 40_000):
            sink.send(Frame(b'{"x":"%s"}' % (b"x" * (size - 8))))
        sink.send(Frame(b"\0\1", binary=True))
        sink.send(Frame(b'{"last":1}'))
        sizes = [len(json.dumps(await client.receive(), separators=(",", ":"))) for _ in range(3)]
        assert sizes == [65_507, 40_000, 10]
    assert caplog.text.count("fragment_size") == 2
    assert "binary" in caplog.text
    caplog.clear()


# -- what is refused ---------------------------------------------------------------------------------------


@every_stack
@over_tcp
async def test_a_port_in_use(site: Site) -> None:
    async with site.listen() as listener:
        port = listener.url.rpartition(":")[2]
        with pytest.raises(ListenError, match=rf"^port {port} on 127\.0\.0\.1 is in use; [^\n]*$"):
            async with listen(listener.url, site.hub, driver=site.make_driver()):
                pass


@every_stack
@pytest.mark.parametrize("scheme", ["unix"])
async def test_a_path_in_use_and_one_left_behind(site: Site) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(site.path))
    async with site.listen():
        with pytest.raises(ListenError, match="is in use"):
            async with listen(site.url, site.hub, driver=site.make_driver()):
                pass
    assert not site.path.exists()


@every_stack
@pytest.mark.parametrize("scheme", ["tcp", "unix"])
async def test_a_refused_peer_without_a_handshake_is_let_go(site: Site) -> None:
    site.hub.refuse = "not you"
    async with site.listen() as listener, site.client(listener) as client:
        assert await client.ending() == "end"
        assert not site.hub.endpoints


@every_stack
@over_tcp
async def test_an_address_that_is_not_ours(site: Site) -> None:
    for host, says in (
        ("192.0.2.1", "not an address of this machine"),
        ("no.such.host.invalid", "is not known"),
    ):
        with pytest.raises(ListenError, match=says) as raised:
            async with listen(f"{site.scheme}://{host}:0", site.hub, driver=site.make_driver()):
                pass
        assert "\n" not in str(raised.value)


@every_stack
@pytest.mark.parametrize("scheme", ["tcp", "unix"])
async def test_one_connection_too_many_without_a_handshake_is_cut(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    async with site.listen(Limits(connections=1)) as listener, site.client(listener) as client:
        await site.endpoint(client)
        async with await site.stream(listener) as second:
            with pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
                await second.receive()
        await site.endpoint(client)
        assert len(site.hub.endpoints) == 1
    assert "no room" in caplog.text
    caplog.clear()


@every_stack
@over_ws
async def test_the_programs_own_exception_comes_out_as_it_is(site: Site) -> None:
    with pytest.raises(KeyError):
        async with site.listen() as listener, site.client(listener):
            raise KeyError("own")


# -- plain HTTP --------------------------------------------------------------------------------------------


@every_stack
@over_ws
async def test_plain_http_on_the_same_port(site: Site) -> None:
    async def slow(request: HttpRequest) -> HttpResponse:
        await anyio.lowlevel.checkpoint()
        return HttpResponse(b"later\n")

    def stream(request: HttpRequest) -> HttpResponse:
        async def chunks() -> AsyncIterator[bytes]:
            for at in range(3):
                yield b"%d" % at * 5

        return HttpResponse(chunks(), content_type="text/x")

    routes = Routes()
    routes.get("/now", lambda request: HttpResponse(b"now\n"))
    routes.get("/slow", slow)
    routes.get("/stream", stream)
    async with site.listen(routes=routes) as listener, await site.stream(listener) as peer:
        for path, body in (
            ("/now", b"now\n"),
            ("/slow", b"later\n"),
            ("/stream", b"5\r\n00000\r\n5\r\n11111"),
        ):
            await peer.send(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            answer = b""
            while body not in answer:
                answer += await peer.receive()
            assert answer.startswith(b"HTTP/1.1 200 OK\r\n")
        await peer.send(b"GET /now HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        answer = b""
        with pytest.raises(anyio.EndOfStream):
            while True:
                answer += await peer.receive()
        assert answer.endswith(b"now\n")


@every_stack
@over_ws
async def test_a_handler_that_answers_nonsense_costs_its_own_connection_only(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    async def later(request: HttpRequest) -> HttpResponse:
        return HttpResponse(b"", 999)

    routes = Routes()
    routes.get("/now", lambda request: HttpResponse(b"", 999))
    routes.get("/later", later)
    async with site.listen(routes=routes) as listener, site.client(listener) as bystander:
        for path in ("/now", "/later"):
            async with await site.stream(listener) as peer:
                await peer.send(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
                with pytest.raises((anyio.EndOfStream, anyio.BrokenResourceError)):
                    await peer.receive()
        await site.endpoint(bystander)
    assert "999" in caplog.text
    caplog.clear()


@every_stack
@over_ws
async def test_an_endless_body_ends_with_its_reader(site: Site) -> None:
    finished = anyio.Event()

    async def chunks() -> AsyncIterator[bytes]:
        try:
            while True:
                yield b"x" * 100_000
        finally:
            finished.set()

    routes = Routes()
    routes.get("/video", lambda request: HttpResponse(chunks()))
    async with site.listen(routes=routes) as listener:
        async with await site.stream(listener) as peer:
            await peer.send(b"GET /video HTTP/1.1\r\nHost: localhost\r\n\r\n")
            for _ in range(10):
                await peer.receive()
        with anyio.fail_after(5):
            await finished.wait()
