from __future__ import annotations

import random
import struct
import tracemalloc
import xmlrpc.client as standard
from contextlib import suppress
from typing import Any

import pytest

from rwt.extensions.ros1.wire import types as wire_types
from rwt.extensions.ros1.wire import xmlrpc
from rwt.extensions.ros1.wire.tcpros import (
    HEADER_BYTES,
    LARGE_BYTES,
    MESSAGE_BYTES,
    TcprosWire,
    decode_header,
    encode_header,
)
from rwt.extensions.ros1.wire.types import WireTypes
from rwt_graph.errors import WireError
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.fuzz.ros1_targets import call_of, response_of, xml

#: Header of a subscriber as the ROS wiki prints it, in part.
HEADER = (
    bytes.fromhex("37000000 20000000".replace(" ", ""))
    + b"message_definition=string data\n\n"
    + bytes.fromhex("0f000000")
    + b"callerid=/a=b/c"
)


def frame(body: bytes) -> bytes:
    return struct.pack("<I", len(body)) + body


class TestHeaders:
    def test_the_bytes_are_those_of_ros(self) -> None:
        fields = {"message_definition": "string data\n\n", "callerid": "/a=b/c"}
        assert encode_header(fields) == HEADER
        assert decode_header(HEADER[4:]) == fields

    @pytest.mark.parametrize(
        "body",
        [
            b"\1",
            b"\5\0\0\0a=b",
            b"\1\0\0\0a",
            b"\xff\xff\xff\xffa=b",
            b"".join(frame(b"%d=" % number) for number in range(65)),
        ],
    )
    def test_malformed_headers_are_rejected(self, body: bytes) -> None:
        with pytest.raises(WireError):
            decode_header(body)

    def test_random_bytes_raise_nothing_else(self) -> None:
        source = random.Random(1)
        for _ in range(5000):
            body = bytearray(HEADER[4:])
            for _ in range(source.randrange(1, 6)):
                body[source.randrange(len(body))] = source.randrange(256)
            with suppress(WireError):
                decode_header(bytes(body[: source.randrange(len(body) + 1)]))


class Receiver:
    """Wire whose frames are written down, with their status."""

    holder = Holder()

    def __init__(self, *, has_status: bool = False) -> None:
        self.pool = ReceiveBufferPool()
        self.wire = TcprosWire(lambda call: call(), has_status, self, Limits(), self.pool)
        self.wire.message = lambda body, success: self.found.append((body, success))
        self.found: list[tuple[bytes | memoryview, bool]] = []
        self.ends: list[str] = []

    @property
    def bodies(self) -> list[bytes]:
        return [bytes(body) for body, _ in self.found]

    def receive(self, data: bytes | memoryview, *, direct: bool = True) -> int:
        """Receive bytes as a driver does, into the wire's buffer if it has one; returns their number."""
        space = self.wire.get_buffer() if direct else None
        if space is None:
            self.wire.feed(bytes(data))
            return len(data)
        with space:
            count = min(len(space), len(data))
            space[:count] = data[:count]
        self.wire.buffer_updated(count)
        return count

    # WireEvents

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        self.ends.append(reason)

    def oversized(self, size: int) -> bool:
        raise AssertionError

    def oversized_head(self, size: int, head: bytes) -> None:
        raise AssertionError

    def answer(self, data: bytes) -> None:
        raise AssertionError

    def read_on_later(self) -> None:
        raise AssertionError

    def pong(self, data: bytes) -> None:
        raise AssertionError


class TestFrames:
    def test_any_division_of_the_stream_gives_the_same_frames(self) -> None:
        source = random.Random(2)
        bodies = [source.randbytes(source.choice((0, 1, 3, 4, 5, 100, 5000))) for _ in range(40)]
        stream = b"".join(map(frame, bodies))
        for _ in range(50):
            receiver, at = Receiver(), 0
            while at < len(stream):
                size = source.choice((1, 2, 3, 7, 64, 4096))
                receiver.receive(stream[at : at + size])
                at += size
            assert receiver.bodies == bodies

    def test_large_frames_are_the_same_however_they_are_received(self) -> None:
        source = random.Random(4)
        bodies = [source.randbytes(size) for size in (3, LARGE_BYTES, 10, 900_000, 5, 400_000, 2_000_000)]
        stream = memoryview(b"".join(map(frame, bodies)))
        for _ in range(20):
            receiver, at = Receiver(), 0
            while at < len(stream):
                size = source.randrange(1, 300_000)
                at += receiver.receive(stream[at : at + size], direct=source.random() < 0.7)
            assert receiver.bodies == bodies

    def test_no_frame_is_delivered_while_the_wire_is_held(self) -> None:
        receiver = Receiver()
        bodies = [b"%d" % number * 50_000 for number in range(5)]
        stream = b"".join(map(frame, bodies))

        def take(body: bytes, _success: bool) -> None:
            receiver.found.append((body, True))
            receiver.wire.hold()

        receiver.wire.message = take
        receiver.receive(stream[:120_000])
        for at in range(120_000, len(stream), 60_000):
            receiver.receive(stream[at : at + 60_000])
        for number in range(1, 6):
            assert receiver.bodies == bodies[:number]
            receiver.wire.go_on()

    def test_memory_of_large_frames_is_reused_without_views(self) -> None:
        receiver, body = Receiver(), bytes(range(256)) * 3600
        receiver.receive(frame(b""))

        def receive(body: bytes) -> memoryview:
            receiver.found.clear()
            receiver.receive(frame(body)[:100])
            receiver.wire.feed(frame(body)[100:])
            whole = receiver.found.pop()[0]
            assert isinstance(whole, memoryview)
            return whole

        kept, first = receive(body), receive(body[::-1])
        assert kept.obj is not first.obj
        used = id(first.obj)
        del first
        again = receive(body[::-1])
        assert id(again.obj) == used
        assert (bytes(kept), bytes(again)) == (body, body[::-1])
        with pytest.raises(TypeError):
            again[0] = 1

    def test_responses_have_a_status_and_their_header_has_none(self) -> None:
        receiver = Receiver(has_status=True)
        receiver.receive(frame(b"header") + b"\1" + frame(b"yes") + b"\0" + frame(b"no"))
        assert receiver.found == [(b"header", True), (b"yes", True), (b"no", False)]

    def test_an_announced_frame_takes_memory_in_proportion_to_what_has_arrived(self) -> None:
        receiver = Receiver()
        receiver.receive(frame(b""))
        tracemalloc.start()
        receiver.receive(struct.pack("<I", MESSAGE_BYTES) + b"a few")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MESSAGE_BYTES // 100
        assert len(receiver.found) == 1

    def test_a_frame_beyond_the_limit_ends_the_connection(self) -> None:
        receiver = Receiver()
        receiver.receive(b"\xff\xff\xff\xff" + bytes(100))
        receiver.receive(frame(b"more"))
        assert receiver.ends == [f"a frame of 4294967295 bytes was announced, {HEADER_BYTES} is the limit"]
        assert not receiver.found
        other = Receiver()
        other.receive(struct.pack("<I", HEADER_BYTES + 1))
        assert other.ends

    def test_what_an_endpoint_rejects_ends_the_connection(self) -> None:
        receiver = Receiver()

        def reject(_body: bytes, _success: bool) -> None:
            raise WireError("no such thing")

        receiver.wire.message = reject
        receiver.receive(frame(b"a") * 3)
        assert receiver.ends == ["no such thing"]


class TestXmlRpc:
    def test_values_survive_both_ways(self) -> None:
        value = [1, "text & <markup> é", {"a": [True, 2.5, -(2**31)], "b": {"c": ""}}, b"\0\xff", []]
        assert response_of(xml(xmlrpc.encode_response(value))) == value
        assert call_of(xml(xmlrpc.encode_call("getPid", ("/a", value)))) == ("getPid", ("/a", value))

    @pytest.mark.parametrize("value", [None, 2**31, "\0", {1: 2}, object(), {"a": "\ud800"}])
    def test_values_that_xml_rpc_lacks_are_rejected(self, value: object) -> None:
        with pytest.raises(WireError):
            xml(xmlrpc.encode_response(value))

    def test_a_document_type_is_rejected(self) -> None:
        bomb = b'<!DOCTYPE a [<!ENTITY b "cc">]>' + xml(xmlrpc.encode_response("b")).replace(b">b<", b">&b;<")
        with pytest.raises(WireError, match="document type"):
            response_of(bomb)

    @pytest.mark.parametrize(
        "value",
        [
            b"<int>" + b"9" * 100_000 + b"</int>",
            b"<array><data>" * 500,
            b"<int>x</int>",
            b"<boolean>7</boolean>",
        ],
    )
    def test_malformed_values_are_rejected(self, value: bytes) -> None:
        with pytest.raises(WireError):
            response_of(
                b"<methodResponse><params><param><value>%s</value></param></params></methodResponse>" % value
            )

    @pytest.mark.parametrize(
        "body",
        [
            b"<" + b"a" * 200_000,
            b"<!--" + b"- " * 100_000,
            b"<a " + b"b='c' " * 50_000,
            b"<a>" + b"<b/>" * 400_000,
        ],
    )
    def test_what_the_parser_would_read_again_and_again_is_rejected(self, body: bytes) -> None:
        with pytest.raises(WireError, match="not supported"):
            response_of(body)

    def test_values_are_those_of_the_standard_library(self) -> None:
        value = [1, "a & <b>", {"c": [True, 2.5, -(2**31), 1e300]}, b"\0\xff" * 100, [], "é"]
        assert standard.loads(xml(xmlrpc.encode_response(value)), use_builtin_types=True)[0] == (value,)

    def test_a_fault_is_an_error_with_its_text(self) -> None:
        with pytest.raises(WireError, match="no such method"):
            response_of(xmlrpc.encode_fault("no such method\0"))

    def test_mutated_calls_raise_nothing_else(self) -> None:
        source = random.Random(3)
        call = xml(xmlrpc.encode_call("publisherUpdate", ("/a", [1, {"b": 2.5}], True, b"raw")))
        for _ in range(5000):
            body = bytearray(call)
            for _ in range(source.randrange(1, 5)):
                at = source.randrange(len(body))
                body[at : at + source.randrange(3)] = source.choice((b"<", b"/", b"value", b"\xff", b""))
            with suppress(WireError):
                call_of(bytes(body))


class TestTypes:
    def test_a_new_name_joins_the_registry(self) -> None:
        registry = Registry(NOETIC)
        kept = registry.message("std_msgs/String")
        other = Registry(NOETIC)
        other.add_text("std_msgs/String text\nInner[2] inner", "never/Outer")
        other.add_text("time when", "never/Inner")
        sent = other.message("never/Outer")
        found = WireTypes(registry).find("never/Outer", sent.md5, other.full_text(sent))
        assert found is registry.message("never/Outer")
        assert found.md5 == sent.md5
        assert registry.message("std_msgs/String") is kept

    def test_another_definition_of_a_known_name_has_a_registry_of_its_own(self) -> None:
        registry, other = Registry(NOETIC), Registry(NOETIC)
        other.add_text("string data\nint8 number", "std_msgs/String")
        sent = other.message("std_msgs/String")
        types = WireTypes(registry)
        found = types.find("std_msgs/String", sent.md5, other.full_text(sent))
        assert found is types.find("std_msgs/String", sent.md5, "")
        assert found is not registry.message("std_msgs/String")
        value: Any = Payload.relayed_ros1(found, b"\2\0\0\0hi\7").value()
        assert value.number == 7

    @pytest.mark.parametrize(
        ("definition", "text"),
        [
            ("", "MD5 sum"),
            ("int32 other", "MD5 sum"),
            ("Missing field", "invalid"),
            ("not a definition", "invalid"),
            ("int8 a\n" * 100_000, "too large"),
            ("\n".join(f"int8 f{number}" for number in range(4000)), "too large"),
            ("int8 a" + ("\n" + "=" * 80 + "\nMSG: a/B") * 600, "more than 500"),
        ],
    )
    def test_definitions_that_do_not_fit_are_rejected(self, definition: str, text: str) -> None:
        with pytest.raises(WireError, match=text):
            WireTypes(Registry(NOETIC)).find("never/Seen", "0" * 32, definition)

    def test_definitions_are_limited_together_and_rejected_ones_do_not_count(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(wire_types, "ALL_LINES", 7)
        types = WireTypes(Registry(NOETIC))

        def find(name: str, text: str) -> None:
            other = Registry(NOETIC)
            other.add_text(text, name)
            types.find(name, other.message(name).md5, text)

        for _ in range(10):
            with pytest.raises(WireError, match="MD5 sum"):
                types.find("never/Seen", "0" * 32, "int8 a")
        find("never/First", "int8 a\nint8 b\n# Comments do not count.\n\nint8 c")
        with pytest.raises(WireError, match="lines of others"):
            find("never/Second", "int8 a\nint8 b\nint8 c")
        find("never/Third", "int8 a\nint8 b")

    def test_the_md5_of_a_service_is_that_of_ros(self) -> None:
        registry = Registry(NOETIC)
        assert registry.service("std_srvs/SetBool").md5 == "09fb03525b03e7ea1fd3992bafd87e16"
        assert registry.service("std_srvs/Empty").md5 == "d41d8cd98f00b204e9800998ecf8427e"
