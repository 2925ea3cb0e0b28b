"""Data channels as connections, with peers of plain aiortc on the other side."""

from __future__ import annotations

import json
import logging
from contextlib import AsyncExitStack

import anyio
import pytest
from aiortc.rtcsctptransport import parse_packet

from rwt_protocol.frames import Frame
from rwt_transports.api import HEAD_BYTES
from rwt_transports.endpoint import DropReason, FlowRules, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import holder_of
from rwt_transports.http.routes import HttpRequest
from rwt_transports.limits import Limits
from rwt_webrtc.packets.ice_guard import CONSENT_EXPIRES_SECONDS
from rwt_webrtc.transport.ice_servers import IceServer
from rwt_webrtc.transport.peer import Peer
from rwt_webrtc.transport.signalling import PeerBounds
from rwt_webrtc.upstream.association import WINDOW_BYTES
from rwt_webrtc.upstream.ice_agent import CONSENT_ASKED, CONSENT_SECONDS
from tests.waiting import until
from tests.webrtc.peers import End, Side, answering, other_side, received, text_of

pytestmark = pytest.mark.anyio


async def test_each_channel_is_a_connection_of_its_own_whatever_its_label() -> None:
    async with answering() as side, other_side() as other:
        one = other.connection.createDataChannel("ws://example.org:9090")
        two = other.connection.createDataChannel("", ordered=False, maxRetransmits=0)
        heard = received(one), received(two)
        await other.connect(side, one, two)
        assert [end.peer.transport for end in side.ends] == ["webrtc", "webrtc"]
        one.send('{"op": "ü"}')
        one.send(b"\x00\xff")
        one.send("")
        two.send(b"")
        await until(lambda: len(side.ends[0].got) == 3 and side.ends[1].got)
        assert side.ends[0].got == [('{"op": "ü"}'.encode(), False), (b"\x00\xff", True), (b"", False)]
        assert side.ends[1].got == [(b"", True)]
        side.ends[0].sink.send(Frame('{"ä":'.encode(), b"1}"))
        side.ends[0].sink.send(Frame(b"\x01", binary=True))
        side.ends[1].sink.flow("/odom").send(Frame(b"{}"))
        await until(lambda: len(heard[0]) == 2 and heard[1])
        assert heard == (['{"ä":1}', b"\x01"], ["{}"])


async def test_a_client_is_who_has_sent_the_offer() -> None:
    infos: list[PeerInfo] = []

    def accept(sink: Sink, info: PeerInfo) -> End:
        infos.append(info)
        if len(infos) == 2:
            raise Refused(403, "one is enough")
        return End(sink, info)

    async with answering(accept=accept) as side, other_side() as other:
        one, two = (other.connection.createDataChannel("x") for _ in range(2))
        headers = {"authorization": "Bearer sesame", "origin": "https://example.org"}
        answer = await side.ask("POST", "/webrtc", await other.offer(), headers=headers)
        await other.take_answer(text_of(answer))
        await until(lambda: len(infos) == 2 and two.readyState == "closed")
        assert one.readyState == "open"
        assert infos[0].headers["authorization"] == "Bearer sesame"
        assert (infos[0].path, infos[0].address) == ("/webrtc", "127.0.0.1")


async def test_large_messages_go_whole_both_ways() -> None:
    text = b'{"data":"%s"}' % (b"x" * 1_500_000)
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        heard = received(channel)
        await other.connect(side, channel)
        side.ends[0].sink.send(Frame(text[:9], text[9:]))
        channel.send(text)
        await until(lambda: heard and side.ends[0].got)
        assert heard == [text.decode()]
        assert side.ends[0].got == [(text, True)]


async def test_received_data_is_acknowledged_every_second_packet_or_with_the_response(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        heard = received(channel)
        await other.connect(side, channel)
        sctp = other.connection.sctp
        assert sctp is not None
        await until(lambda: not sctp._sent_queue)  # SACK_SECONDS after a lone packet.
        chunks: list[tuple[str, ...]] = []
        handle = sctp._handle_data

        async def count(data: bytes) -> None:
            chunks.append(tuple(type(each).__name__ for each in parse_packet(data)[3]))
            await handle(data)

        monkeypatch.setattr(sctp, "_handle_data", count)
        channel.send("x" * 100_000)
        await until(lambda: side.ends[0].got and not sctp._sent_queue)
        assert len(chunks) <= 50  # 87 packets.
        chunks.clear()
        channel.send("x")
        await until(lambda: len(side.ends[0].got) == 2)
        side.ends[0].sink.send(Frame(b"y"))
        await until(lambda: heard and not sctp._sent_queue)
        assert chunks == [("SackChunk", "DataChunk")]


async def test_a_message_over_the_limit_is_reported_and_the_connection_goes_on() -> None:
    async with answering(Limits(message_bytes=50_000)) as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        await other.connect(side, channel)
        # The other side is told the limit, and keeps to it; one that does not is made here.
        assert other.connection.sctp is not None
        assert other.connection.sctp._remote_max_message_size == 50_000
        other.connection.sctp._remote_max_message_size = 0
        channel.send("y" * 200_000)
        channel.send("{}")
        (end,) = side.ends
        await until(lambda: end.got)
        assert end.heads == [(200_000, 50_000, b"y" * HEAD_BYTES)]
        assert end.got == [(b"{}", False)]


async def test_text_that_is_no_utf8_comes_as_it_was_sent() -> None:
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        await other.connect(side, channel)
        assert other.connection.sctp is not None
        await other.connection.sctp._send(channel.id or 0, 51, b"\xff\xfe")
        channel.send("{}")
        await until(lambda: len(side.ends[0].got) == 2)
        assert side.ends[0].got == [(b"\xff\xfe", False), (b"{}", False)]


async def test_a_topic_that_comes_faster_than_it_can_be_sent_loses_its_oldest() -> None:
    drops: list[DropReason] = []
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x", ordered=False, maxRetransmits=0)
        heard = received(channel)
        await other.connect(side, channel)
        flow = side.ends[0].sink.flow("/odom", FlowRules(depth=1), on_drop=drops.append)
        for number in range(200):
            flow.send(Frame(b'{"n":%d,"pad":"%s"}' % (number, b"x" * 800)))
        # All in one turn of the event loop, of which a kilobyte is out of reach.
        assert side.ends[0].sink.backlog < 5000
        await until(lambda: any('"n":199,' in str(message) for message in heard))
        assert len(drops) + len(heard) == 200
        assert set(drops) == {DropReason.QUEUE}


async def test_what_is_fresh_goes_before_what_is_large() -> None:
    async with answering() as side, other_side() as other:
        large = other.connection.createDataChannel("large")
        fresh = other.connection.createDataChannel("fresh", ordered=False, maxRetransmits=0)
        order: list[str] = []
        large.on("message", lambda message: order.append("large"))
        fresh.on("message", lambda message: order.append("fresh"))
        await other.connect(side, large, fresh)
        for _ in range(20):
            side.ends[0].sink.send(Frame(b"x" * 100_000))
        side.ends[1].sink.send(Frame(b"{}"))
        await until(lambda: len(order) == 21)
        # At most what had begun to leave goes before it.
        assert order.index("fresh") <= 2


async def test_a_client_that_is_held_back_is_told_a_smaller_window_and_gets_all_of_it_later() -> None:
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        await other.connect(side, channel)
        (end,) = side.ends
        assert end.flow_control is not None
        end.flow_control.pause()
        sent = [str(number) * 1000 for number in range(300)]
        for text in sent:
            channel.send(text)
        association = next(iter(side.peers._peers.values())).connection.association
        assert association is not None
        total = sum(map(len, sent))
        await until(lambda: association.unread_bytes == total)
        assert association._advertised_rwnd == WINDOW_BYTES - total
        assert end.got == []
        end.flow_control.resume()
        await until(lambda: len(end.got) == 300)
        assert [data.decode() for data, _ in end.got] == sent
        assert association._advertised_rwnd == WINDOW_BYTES


async def test_closing_ends_the_channel_after_what_was_sent() -> None:
    async with answering() as side, other_side() as other:
        one, two = (other.connection.createDataChannel("x") for _ in range(2))
        heard = received(one)
        await other.connect(side, one, two)
        side.ends[0].sink.send(Frame(b"last"))
        side.ends[0].sink.close(1000, "")
        two.close()
        await until(lambda: one.readyState == "closed" and side.ends[1].closed_with)
        assert heard == ["last"]
        assert len(side.peers) == 1


async def test_more_channels_than_a_peer_may_have_are_closed() -> None:
    async with answering(channels=1) as side, other_side() as other:
        one = other.connection.createDataChannel("one")
        await other.connect(side, one)
        two = other.connection.createDataChannel("two")
        await until(lambda: two.readyState == "closed")
        assert len(side.ends) == 1
        one.close()
        await until(lambda: side.ends[0].closed_with)
        three = other.connection.createDataChannel("three")
        await until(lambda: len(side.ends) == 2)
        assert three.readyState == "open"


async def test_a_peer_that_breaks_the_protocol_is_ended_and_no_other(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    async with answering() as side, other_side() as good, other_side() as bad:
        mine, theirs = good.connection.createDataChannel("x"), bad.connection.createDataChannel("x")
        await good.connect(side, mine)
        await bad.connect(side, theirs)
        await until(lambda: len(side.ends) == 2)
        assert bad.connection.sctp is not None
        await bad.connection.sctp._send(theirs.id or 0, 50, b"\x03" + bytes(11))
        await until(lambda: side.ends[1].closed_with)
        assert "about channel" in caplog.text
        mine.send("{}")
        await until(lambda: side.ends[0].got)
        assert len(side.peers) == 1


def test_a_peer_that_vanishes_is_missed_within_five_seconds() -> None:
    # The last answer, then the time it may take, then the longest time until that is looked at.
    assert CONSENT_EXPIRES_SECONDS + 1.2 * CONSENT_SECONDS < 5.0
    assert (CONSENT_ASKED + 1) * 1.2 * CONSENT_SECONDS < 5.0


async def test_a_peer_that_vanishes_is_gone() -> None:
    async with answering() as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        await other.connect(side, channel)
        (end,) = side.ends
        assert other.connection.sctp is not None
        ice = other.connection.sctp.transport.transport._connection
        for protocol in ice._protocols:
            protocol.transport.abort()  # Its sockets are gone, and it says nothing.
        await until(lambda: end.closed_with)
        assert len(side.peers) == 0


async def test_signalling() -> None:
    servers = (IceServer("turn:turn.example.org", 'a"b', "secret"),)
    async with answering(servers=()) as side, other_side() as other:
        channel = other.connection.createDataChannel("x")
        offer = await other.offer()
        wrong = await side.ask("POST", "/webrtc", offer, "text/plain")
        assert (wrong.status, wrong.headers["Accept-Post"]) == (415, "application/sdp")
        refused = await side.ask("POST", "/webrtc", b"hello")
        assert refused.status == 400
        assert "not a line of a session description" in text_of(refused)
        await other.connect(side, channel)
        fragment = "application/trickle-ice-sdpfrag"
        path = other.location
        candidate = b"a=mid:0\r\na=candidate:1 1 udp 1 127.0.0.1 9 typ host\r\n"
        assert (await side.ask("PATCH", path, candidate, fragment)).status == 204
        restart = await side.ask("PATCH", path, b"a=ice-ufrag:zzzz\r\n" + candidate, fragment)
        assert (restart.status, text_of(restart)) == (
            422, "an ICE restart is not possible here: DELETE this, and POST an offer\n",
        )  # fmt: skip
        many = b"a=mid:0\r\n" + b"a=candidate:1 1 udp 1 127.0.0.1 9 typ host\r\n" * 70
        assert "webrtc.candidates" in text_of(await side.ask("PATCH", path, many, fragment))
        assert (await side.ask("DELETE", path)).status == 200
        await until(lambda: channel.readyState == "closed" and side.ends[0].closed_with)
        assert (await side.ask("DELETE", path)).status == 404
        assert (await side.ask("PATCH", path, candidate, fragment)).status == 404
    assert servers[0].link == (
        '<turn:turn.example.org>; rel="ice-server"; username="a\\"b"; credential="secret"; '
        'credential-type="password"'
    )


async def test_who_asks_first_learns_the_servers() -> None:
    servers = (IceServer("stun:192.0.2.1"), IceServer("turn:192.0.2.1", "me", "secret"))
    async with answering(servers=servers) as side:
        answer = await side.ask("GET", "/webrtc")
        assert json.loads(text_of(answer)) == {
            "iceServers": [
                {"urls": "stun:192.0.2.1"},
                {"urls": "turn:192.0.2.1", "username": "me", "credential": "secret"},
            ]
        }


async def test_offers_of_something_else_are_refused() -> None:
    async with answering() as side, other_side() as other:
        other.connection.addTransceiver("video", "recvonly")
        answer = await side.ask("POST", "/webrtc", await other.offer())
        assert answer.status == 400
        assert "sections video are offered, where /webrtc takes one of data channels" in text_of(answer)
        assert len(side.peers) == 0


async def test_an_offer_without_a_fingerprint_is_rejected_and_keeps_nothing() -> None:
    async with answering() as side, other_side() as other:
        other.connection.createDataChannel("x")
        lines = (await other.offer()).splitlines(keepends=True)
        bare = b"".join(line for line in lines if not line.startswith(b"a=fingerprint:"))
        answer = await side.ask("POST", "/webrtc", bare)
        assert (answer.status, len(side.peers)) == (400, 0)
        assert "a=fingerprint" in text_of(answer)


async def test_there_are_no_more_peers_and_handshakes_than_there_may_be() -> None:
    async with (
        answering(bounds=PeerBounds(peers=2, handshakes=1, queue_seconds=0)) as side,
        other_side() as other,
    ):
        channel = other.connection.createDataChannel("x")
        offer = await other.offer()
        assert (await side.ask("POST", "/webrtc", offer)).status == 201
        answer = await side.ask("POST", "/webrtc", offer)
        assert answer.status == 503
        assert (
            text_of(answer) == "1 of 1 are in use, 1 by this client: connecting peers (webrtc.handshakes)\n"
        )
        assert channel.readyState == "connecting"


async def test_ten_clients_that_connect_at_once() -> None:
    async with AsyncExitStack() as stack:
        side = await stack.enter_async_context(answering(bounds=PeerBounds(handshakes=2)))
        others = [await stack.enter_async_context(other_side()) for _ in range(10)]
        channels = [other.connection.createDataChannel("x") for other in others]
        async with anyio.create_task_group() as tasks:
            for other, channel in zip(others, channels, strict=True):
                tasks.start_soon(other.connect, side, channel)
        assert [channel.readyState for channel in channels] == ["open"] * 10


async def test_offers_that_wait_are_limited_by_their_bytes() -> None:
    bounds = PeerBounds(handshakes=1, queue_bytes=100)
    async with answering(bounds=bounds) as side, anyio.create_task_group() as tasks:
        await _open(side, "127.0.0.1")
        for _ in range(2):
            tasks.start_soon(_open, side, "127.0.0.1", 50)
        await anyio.wait_all_tasks_blocked()
        with pytest.raises(Refused, match=r"bytes of waiting offers \(webrtc\.handshakes\)"):
            await _open(side, "127.0.0.1", 1)
        tasks.cancel_scope.cancel()
    assert side.peers._offers.used == 0


@pytest.mark.parametrize("bounds", [PeerBounds(4, 100), PeerBounds(100, 4, queue_seconds=0)])
async def test_a_client_with_every_place_loses_its_oldest_to_another(bounds: PeerBounds) -> None:
    async with answering(bounds=bounds) as side:
        for number in range(4):
            await _open(side, f"2001:db8::{number}")
        of_greedy = tuple(side.peers._peers.values())
        with pytest.raises(Refused, match=r"4 of 4 are in use, 4 by this client.*\(webrtc\."):
            await _open(side, "2001:db8::ffff")
        for _ in range(2):
            await _open(side, "2001:db8:1::1")
        await until(lambda: len(side.peers) == 4)
        assert [peer.closed for peer in of_greedy] == [True, True, False, False]
        assert "4 of 4 were this client's" in of_greedy[0].reason
        # Both have two: neither takes one of the other.
        for address in ("2001:db8::1", "2001:db8:1::1"):
            with pytest.raises(Refused):
                await _open(side, address)


async def _open(side: Side, address: str, size: int = 0) -> None:
    """Open a peer that is never described, for an offer of a size."""

    async def answer(peer: Peer) -> str:
        return ""

    request = HttpRequest("POST", "/webrtc", body=bytes(size), address=address)
    await side.peers.open(request, holder_of(address), side.accept, answer)


async def test_a_peer_that_is_never_reached_is_given_up() -> None:
    async with answering(connect_seconds=0.05) as side, other_side() as other:
        other.connection.createDataChannel("x")
        assert (await side.ask("POST", "/webrtc", await other.offer())).status == 201
        await until(lambda: len(side.peers) == 0)
        counted = {family.name: list(family.samples) for family in side.peers.metrics()}
        assert counted["rwt_webrtc_ended_total"] == [({"was": "connected"}, 0), ({"was": "unconnected"}, 1)]


async def test_leaving_closes_every_peer() -> None:
    async with other_side() as other:
        async with answering() as side:
            channel = other.connection.createDataChannel("x")
            await other.connect(side, channel)
        await until(lambda: channel.readyState == "closed")
        assert side.ends[0].closed_with == (1001, "the server is going away")
