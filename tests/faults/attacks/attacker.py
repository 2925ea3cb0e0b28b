"""Clients that attack, each in a process of its own: `python -m tests.faults.attacks.attacker DISTRO WS WSS
TCP`, with a port for each scheme.

For each line that it reads, the name of an attack, it lets a new process do that for a while, prints a line,
and lets the process stay connected until the next line, which is empty: then it is killed. Several names in a
line are attacks at the same time, each with a line of its own at its end.
"""

from __future__ import annotations

import base64
import ctypes
import json
import math
import os
import signal
import socket
import ssl
import struct
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from itertools import islice, repeat
from typing import Final, NoReturn

from tests.core.transports.rfc6455.frames import BINARY, TEXT, frame
from tests.faults.attacks import by_http, refused
from tests.faults.blocking_client import PATIENCE, BlockingClient, Refused

SCHEMES: Final = ("ws", "wss", "tcp")
"""Over which the server listens, each on a port of its own."""

_PORTS: Final[dict[str, int]] = {}
"""The port of each."""

SECONDS: Final = 0.6
"""For which most attacks last."""

LARGEST: Final = 9_900_000
"""Bytes of a message that the server takes by default."""

_MB: Final = 1_000_000
_LETTERS: Final = "x" * _MB
_LONG: Final = _LETTERS[:60_000]
_BOOL: Final = "std_srvs/SetBool"
_FIBONACCI: Final = "example_interfaces/Fibonacci"
_NOETIC: Final = "noetic" in sys.argv

Messages = Iterator[bytes | dict[str, object]]
"""Messages sent in turn until the time is over: CBOR, or the members of an op."""


class Attacker:
    """A connection that sends as fast as the server takes it, and reads and forgets what comes.

    Args:
        port: of the server.
        first: ops that are done before anything else.
        headers: of its handshake.
        reads: whether it reads at all.
        tls: whether the port is one of TLS.
    """

    def __init__(
        self,
        port: int,
        *first: Mapping[str, object],
        headers: tuple[bytes, ...] = (),
        reads: bool = True,
        tls: bool = False,
    ) -> None:
        self.port = port
        self._client = BlockingClient(port, *headers, tls=tls)
        for op in first:
            self._client.socket.sendall(frame(TEXT, json.dumps(op).encode(), key=bytes(4)))
        if first:
            self._client.ask_something()
        self._socket = self._client.socket
        if reads:
            threading.Thread(target=self._drain, daemon=True).start()

    def _drain(self) -> None:
        try:
            while self._socket.recv(1 << 20):
                pass
        except OSError:
            return

    def send(self, messages: Messages, seconds: float = SECONDS) -> None:
        """Send until there is nothing more, the time is over, or the server has closed."""
        over = time.monotonic() + seconds
        for message in messages:
            data = json.dumps(message).encode() if isinstance(message, dict) else message
            opcode = TEXT if data[:1] == b"{" else BINARY
            if not self.send_raw(frame(opcode, data, key=bytes(4)), over) or time.monotonic() > over:
                return

    def send_raw(self, data: bytes, over: float | None = None) -> bool:
        """Send bytes until the time is over; whether all were taken."""
        return _send_all(self._socket, data, time.monotonic() + SECONDS if over is None else over)


def _send_all(connection: socket.socket, data: bytes, over: float) -> bool:
    """Send bytes until the time is over; whether all were taken."""
    view = memoryview(data)
    while view:
        connection.settimeout(max(0.01, over - time.monotonic()))
        try:
            view = view[connection.send(view) :]
        except OSError:
            return False
    return True


def _held_connections(attacker: Attacker, count: int, headers: tuple[bytes, ...] = ()) -> list[Attacker]:
    """Many more connections, which stay until this process ends."""
    many = [Attacker(attacker.port, headers=headers) for _ in range(count)]
    _held.extend(many)
    return many


def _together(acts: Iterable[Callable[[], object]]) -> None:
    """Do several things at the same time."""
    threads = [threading.Thread(target=act, daemon=True) for act in acts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _ops(op: str, **members: object) -> Messages:
    """The same op again and again, `#` in its members the number."""
    for number in range(1_000_000):
        yield json.dumps({"op": op, **members}).replace("#", str(number)).encode()


def _head(major: int, count: int) -> bytes:
    return bytes((major << 5 | 26,)) + count.to_bytes(4, "big")


def _cbor_publish(msg: bytes) -> bytes:
    return b"\xa3\x62op\x67publish\x65topic\x62/a\x63msg" + msg


# -- kept by the server ------------------------------------------------------------------------------------


def throttled_queue(attacker: Attacker) -> None:
    """A queue without an end behind a throttle that lets nothing out, on a topic of large samples."""
    Attacker(
        attacker.port,
        {"op": "subscribe", "topic": "/camera", "type": "std_msgs/String", "queue_length": 10**9,
         "throttle_rate": 10**9},
    )  # fmt: skip
    attacker.send(_ops("publish", topic="/camera", type="std_msgs/String", msg={"data": f"#{_LETTERS}"}))


def endless_depth(attacker: Attacker) -> None:
    """A topic that keeps its last million samples."""
    qos = {"depth": 1_000_000, "durability": "transient_local"}
    attacker.send(iter([{"op": "advertise", "topic": "/kept", "type": "std_msgs/String", "qos": qos}]))
    attacker.send(_ops("publish", topic="/kept", msg={"data": f"#{_LETTERS}"}))


def latched_topics(attacker: Attacker) -> None:
    """A large sample kept on each of very many topics."""
    attacker.send(_ops("publish", topic="/kept#", type="std_msgs/String", msg={"data": _LETTERS}, latch=True))


def lingering_publishers(attacker: Attacker) -> None:
    """Latched topics that are given up at once: they outlive their publishers for a while."""

    def messages() -> Messages:
        for number in range(1_000_000):
            topic = f"/lingers{number}"
            yield {"op": "advertise", "topic": topic, "type": "std_msgs/String", "latch": True}
            yield {"op": "publish", "topic": topic, "msg": {"data": _LETTERS[:100_000]}}
            yield {"op": "unadvertise", "topic": topic}

    attacker.send(messages())


def endless_goals(attacker: Attacker) -> None:
    """Large goals to an action that never ends one."""
    kind = "control_msgs/FollowJointTrajectory"
    Attacker(attacker.port, {"op": "advertise_action", "action": "/never", "type": kind})
    args = {"trajectory": {"joint_names": [f"#{_LETTERS}"]}}
    attacker.send(_ops("send_action_goal", action="/never", action_type=kind, id="#", args=args))


def unanswered_calls(attacker: Attacker) -> None:
    """Large calls of a service that never answers."""
    kind = "rcl_interfaces/SetParameters"
    Attacker(attacker.port, {"op": "advertise_service", "service": "/deaf", "type": kind})
    args = {"parameters": [{"name": f"#{_LETTERS}"}]}
    attacker.send(_ops("call_service", service="/deaf", id="#", args=args, timeout=1000))


def fragments_left_open(attacker: Attacker) -> None:
    """Pieces of messages that never get their last."""
    attacker.send(_ops("fragment", id="#", num=0, total=2, data=_LETTERS))


def long_ids(attacker: Attacker) -> None:
    """Small calls of a service that never answers, whose ids are large."""
    Attacker(attacker.port).send(iter([{"op": "advertise_service", "service": "/deaf", "type": _BOOL}]))
    attacker.send(_ops("call_service", service="/deaf", id=f"#{_LONG}", timeout=1000))


def long_goal_ids(attacker: Attacker) -> None:
    """Goals whose ids are large, to an action that never ends one."""
    Attacker(attacker.port).send(iter([{"op": "advertise_action", "action": "/never", "type": _FIBONACCI}]))
    attacker.send(_ops("send_action_goal", action="/never", action_type=_FIBONACCI, id=f"#{_LONG}"))


def long_names_to_hear(attacker: Attacker) -> None:
    """Subscriptions of topics whose names are large, each under a large id."""
    attacker.send(_ops("subscribe", topic=f"/t#{_LONG}", id=f"#{_LONG}", type="std_msgs/String"))


def long_names_to_offer(attacker: Attacker) -> None:
    """Topics whose names are large, given up at once."""

    def messages() -> Messages:
        for number in range(1_000_000):
            topic = f"/t{number}{_LONG}"
            yield {"op": "advertise", "topic": topic, "type": "std_msgs/String", "id": _LONG}
            yield {"op": "unadvertise", "topic": topic}

    attacker.send(messages())


def long_names_of_services(attacker: Attacker) -> None:
    """Services whose names are large."""
    attacker.send(_ops("advertise_service", service=f"/s#{_LONG}", type=_BOOL))


def long_questions(attacker: Attacker) -> None:
    """Questions about names of megabytes, whose answers would repeat them."""
    args = {"name": f"/#{_LETTERS * 2}"}
    attacker.send(_ops("call_service", service="/rosapi/get_param", id="#", args=args))


def unread_answers(attacker: Attacker) -> None:
    """Answers that nobody reads, over many connections."""
    for _ in range(40):
        deaf = Attacker(attacker.port, reads=False)
        _held.append(deaf)
        deaf.send(_ops("call_service", service="/rosapi/topics_and_raw_types", id="#"), SECONDS / 20)


def half_messages(attacker: Attacker) -> None:
    """Messages of which the last byte never comes, over many connections."""
    message = frame(TEXT, b"x" * LARGEST, key=bytes(4))[:-1]
    for _ in range(20):
        half = Attacker(attacker.port)
        _held.append(half)
        half.send_raw(message, time.monotonic() + SECONDS / 4)


def pieces_of_a_frame(attacker: Attacker) -> None:
    """The same in WebSocket's own fragments, the last of which never comes."""
    piece = bytearray(frame(TEXT, b"x" * LARGEST, key=bytes(4)))
    piece[0] &= 0x7F
    for _ in range(20):
        half = Attacker(attacker.port)
        _held.append(half)
        half.send_raw(bytes(piece), time.monotonic() + SECONDS / 4)


_LONG_TEXT: Final = (
    b'{"op":"publish","topic":"/a","type":"std_msgs/String","msg":{"data":"' + b"x" * (LARGEST - 100) + b'"}}'
)


_DEFLATE: Final = b"Sec-WebSocket-Extensions: permessage-deflate; client_no_context_takeover"


def _compressed(text: bytes) -> bytes:
    """The same message in a compressed frame."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(text)
    message = bytearray(frame(TEXT, (packed + packer.flush(zlib.Z_SYNC_FLUSH))[:-4], key=bytes(4)))
    message[0] |= 0x40
    return bytes(message)


_BOMB: Final = _compressed(_LONG_TEXT)


def inflated_at_once(attacker: Attacker) -> None:
    """The same over many connections at once, each of which waits for its turn."""
    for each in _held_connections(attacker, 25, (_DEFLATE,)):
        each.send_raw(_BOMB)


def _send_at_once(many: Iterable[Attacker], data: bytes) -> None:
    """Send the same over each of many connections at the same time."""
    over = time.monotonic() + 4 * SECONDS
    _together([partial(each.send_raw, data, over) for each in many])


def whole_at_once(attacker: Attacker) -> None:
    """Whole messages of megabytes over many connections at once, of which each waits for its turn."""
    _send_at_once(_held_connections(attacker, 25), frame(TEXT, _LONG_TEXT, key=bytes(4)) * 2)


def _long_list() -> bytes:
    """A whole message that takes long to be read."""
    numbers = b"1," * (LARGEST // 2 - 100)
    return b'{"op":"publish","topic":"/a","type":"std_msgs/Int16MultiArray","msg":{"data":[%s1]}}' % numbers


def lists_at_once(attacker: Attacker) -> None:
    """Whole messages that take long to be read, over as many connections as an address may have."""
    _send_at_once(_held_connections(attacker, 60), frame(TEXT, _long_list(), key=bytes(4)) * 2)


def lists_in_tls(attacker: Attacker) -> None:
    """The same in TLS."""
    many = [Attacker(_PORTS["wss"], reads=False, tls=True) for _ in range(60)]
    _held.extend(many)
    _send_at_once(many, frame(TEXT, _long_list(), key=bytes(4)) * 2)


def lists_over_tcp(attacker: Attacker) -> None:
    """The same over TCP without WebSocket."""
    many = [socket.create_connection(("127.0.0.1", _PORTS["tcp"]), PATIENCE) for _ in range(60)]
    _held.extend(many)
    data, over = _long_list() * 2, time.monotonic() + 4 * SECONDS
    _together([partial(_send_all, each, data, over) for each in many])


def smallest_objects(attacker: Attacker) -> None:
    """Objects without members, and bytes that are none, tens of thousands in a read, over TCP."""
    many = [socket.create_connection(("127.0.0.1", _PORTS["tcp"]), PATIENCE) for _ in range(40)]
    _held.extend(many)
    over, pieces = time.monotonic() + 4 * SECONDS, (b"{}", b"{}\n", b"\n", b" ", b"x\n", b'{"":"",')
    _together(
        [partial(_send_all, each, pieces[number % 6] * 20_000, over) for number, each in enumerate(many)]
    )


def lists_everywhere(attacker: Attacker) -> None:
    """Half messages, and whole ones that take long to be read, over every listener of the server at once."""
    data, over = _long_list(), time.monotonic() + 4 * SECONDS
    framed, acts = frame(TEXT, data, key=bytes(4)), []
    for number in range(20):
        half = number % 3 == 0
        for scheme, sent in (("ws", framed), ("wss", framed), ("tcp", data)):
            port = _PORTS[scheme]
            if scheme == "tcp":
                each = socket.create_connection(("127.0.0.1", port), PATIENCE)
                _held.append(each)
            else:
                client = Attacker(port, reads=False, tls=scheme == "wss")
                _held.append(client)
                each = client._socket
            acts.append(partial(_send_all, each, sent[:-1] if half else sent * 2, over))
    _together(acts)


def handshakes_in_tls(attacker: Attacker) -> None:
    """Handshakes in TLS that are begun, over hundreds of connections, and gone on with by nobody."""
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with suppress(ssl.SSLWantReadError):
        context.wrap_bio(incoming, outgoing).do_handshake()
    hello, over = outgoing.read(), time.monotonic() + 2 * SECONDS
    while time.monotonic() < over:
        each = socket.create_connection(("127.0.0.1", _PORTS["wss"]), PATIENCE)
        _held.append(each)
        with suppress(OSError):
            each.sendall(hello)


def samples_in_tls(attacker: Attacker) -> None:
    """Large samples for many viewers in TLS, half of whom read nothing."""
    topic = {"topic": "/large", "type": "std_msgs/String"}
    for number in range(40):
        each = Attacker(_PORTS["wss"], reads=bool(number % 2), tls=True)
        _held.append(each)
        each.send(iter([{"op": "subscribe", **topic}]))
    attacker.send(_ops("publish", **topic, msg={"data": f"#{_LETTERS * 4}"}), 2 * SECONDS)


def lists_inflated(attacker: Attacker) -> None:
    """Whole messages that take long to be read, in compressed frames of a few kilobytes."""
    _send_at_once(_held_connections(attacker, 60, (_DEFLATE,)), _compressed(_long_list()) * 3)
    time.sleep(4 * SECONDS)  # They have been sent before they are inflated.


def cut_with_a_backlog(attacker: Attacker) -> None:
    """Many connections, of which each has large messages waiting for their turn when it is cut."""
    many = [BlockingClient(attacker.port, _DEFLATE) for _ in range(60)]
    for each in many:
        each.socket.sendall(_BOMB * 3)
    for each in many:
        each.reset()


def half_bodies(attacker: Attacker) -> None:
    """Requests over HTTP whose bodies never end, over many connections."""
    head = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n"
    for _ in range(300):
        half = socket.create_connection(("127.0.0.1", attacker.port), PATIENCE)
        _held.append(half)
        half.settimeout(0.05)
        try:
            half.sendall(head + _LETTERS[:-1].encode())
        except OSError:
            continue


def forms_of_what_is_kept(attacker: Attacker) -> None:
    """Latched messages of which every form is asked for."""
    pose = {"position": dict.fromkeys("xyz", 0.5), "orientation": dict.fromkeys("xyzw", 0.5)}
    poses = ",".join([json.dumps(pose, separators=(",", ":"))] * 10_000)
    header = '{"stamp":{"sec":0,"nanosec":0},"frame_id":""}'
    op = '"op":"publish","type":"geometry_msgs/PoseArray","latch":true'

    def messages() -> Messages:
        for number in range(70):
            topic = f"/latched{number}"
            yield f'{{{op},"topic":"{topic}","msg":{{"header":{header},"poses":[{poses}]}}}}'.encode()
            for compression in ("cbor", "cbor-raw", "png"):
                yield {"op": "subscribe", "topic": topic, "id": compression, "compression": compression}

    attacker.send(messages(), 10 * SECONDS)


def feedback_flood(attacker: Attacker) -> None:
    """Feedback for a client that reads nothing."""
    provider = BlockingClient(attacker.port)
    provider.say("advertise_action", action="/talks", type=_FIBONACCI)
    provider.ask_something()  # It is offered now.
    deaf = Attacker(attacker.port, reads=False)
    _held.append(deaf)
    deaf.send(iter([{"op": "send_action_goal", "action": "/talks", "action_type": _FIBONACCI,
                     "feedback": True, "id": "g", "args": {"order": 3}}]))  # fmt: skip
    goal = provider.hear("send_action_goal")["id"]
    feedback = {"op": "action_feedback", "action": "/talks", "id": goal, "values": {"sequence": [1] * 20_000}}
    text = frame(TEXT, json.dumps(feedback).encode(), key=bytes(4))
    over = time.monotonic() + 5 * SECONDS
    while time.monotonic() < over:
        provider.socket.sendall(text)


def long_lists_of_numbers(attacker: Attacker) -> None:
    """Lists of numbers that are looked at one by one."""
    numbers = b"0," * (LARGEST // 2 - 200) + b"0"
    kind = b'"topic":"/numbers","type":"std_msgs/Float32MultiArray"'
    attacker.send(b'{"op":"publish",' + kind + b',"msg":{"data":[' + numbers + b"]}}" for _ in range(3))


def small_typed_arrays(attacker: Attacker) -> None:
    """The smallest numbers of CBOR, in arrays of millions."""
    data = b"\xd8\x54" + _head(2, LARGEST) + bytes(LARGEST)
    message = b"\xa4\x62op\x67publish\x65topic\x62/f\x64type\x78\x1astd_msgs/Float64MultiArray\x63msg"
    attacker.send(message + b"\xa1\x64data" + data for _ in range(10))


# -- work --------------------------------------------------------------------------------------------------


def spellings(attacker: Attacker) -> None:
    """One topic under many spellings, each of which is encoded for by itself."""

    def messages() -> Messages:
        for number in range(900):
            yield {"op": "subscribe", "topic": "/" * (number + 1) + "spelled", "type": "std_msgs/String"}
        yield from _ops("publish", topic="/spelled", msg={"data": _LETTERS[:10_000]})

    attacker.send(messages())


def rosapi_flood(attacker: Attacker) -> None:
    """The list of nodes, again and again."""
    attacker.send(_ops("call_service", service="/rosapi/nodes", id="#"))


def many_in_a_frame(attacker: Attacker) -> None:
    """A thousand calls in each frame."""
    call = json.dumps({"op": "call_service", "service": "/rosapi/topics", "id": "1"}).encode()
    attacker.send(call * 1_000 for _ in range(1_000_000))


def _many_topics(attacker: Attacker) -> None:
    """Give the robot thousands of topics."""
    for number in range(5):
        names = (f"/many{number}/{each}" for each in range(900))
        Attacker(
            attacker.port, *({"op": "advertise", "topic": name, "type": "std_msgs/String"} for name in names)
        )


def lists_of_many(attacker: Attacker) -> None:
    """Lists of a robot with thousands of names, of which one changes before each question."""
    _many_topics(attacker)

    def messages() -> Messages:
        for number in range(1_000_000):
            topic = {"topic": f"/changing{number % 50}"}
            yield {"op": "advertise", **topic, "type": "std_msgs/String"}
            for service in ("topics", "nodes", "topics_and_raw_types", "action_servers"):
                yield {"op": "call_service", "service": f"/rosapi/{service}", "id": str(number)}
            yield {"op": "unadvertise", **topic}

    attacker.send(messages())


def offers_again(attacker: Attacker) -> None:
    """Hundreds of topics, services and actions, offered and given up again and again."""
    kinds = (
        ("advertise", "unadvertise", "topic", "std_msgs/String"),
        ("advertise_service", "unadvertise_service", "service", "std_srvs/SetBool"),
        ("advertise_action", "unadvertise_action", "action", "control_msgs/FollowJointTrajectory"),
    )

    def messages() -> Messages:
        for _ in range(1_000):
            for offer, withdraw, member, kind in kinds:
                for number in range(300):
                    yield {"op": offer, member: f"/offered{number}", "type": kind}
                for number in range(300):
                    yield {"op": withdraw, member: f"/offered{number}"}

    attacker.send(messages())


def everything_subscribed(attacker: Attacker) -> None:
    """Hundreds of topics, subscribed to in every encoding and given up again and again."""

    def messages() -> Messages:
        for _ in range(1_000):
            for number in range(190):
                for each in ("none", "cbor", "cbor-raw", "png"):
                    kind = {"type": "std_msgs/String", "compression": each, "id": each}
                    yield {"op": "subscribe", "topic": f"/any{number}", **kind}
            for number in range(190):
                yield {"op": "unsubscribe", "topic": f"/any{number}"}

    attacker.send(messages())


def come_and_go(attacker: Attacker) -> None:
    """Clients that subscribe to hundreds of topics, and are cut."""
    over = time.monotonic() + SECONDS
    kind = '"type":"std_msgs/String"'
    each = (b'{"op":"subscribe","topic":"/any%d",%b}' % (number, kind.encode()) for number in range(900))
    ops = b"".join(frame(TEXT, op, key=bytes(4)) for op in each)
    while time.monotonic() < over:
        with BlockingClient(attacker.port) as client:
            client.socket.sendall(ops)
            client.reset()


def pages_again(attacker: Attacker) -> None:
    """The large pages, many asked for before the first answer is read."""
    _many_topics(attacker)
    over = time.monotonic() + SECONDS
    asked = b"".join(
        f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode() for path in ("/index", "/metrics")
    )
    while time.monotonic() < over:
        with socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) as reader:
            reader.sendall(asked * 20)
            reader.settimeout(0.2)
            try:
                while time.monotonic() < over and reader.recv(1 << 20):
                    pass
            except OSError:
                continue


def pictures_of_text(attacker: Attacker) -> None:
    """Large samples that are wanted as PNG, under every spelling that there may be."""
    for spelling in ("/text", "text", "//text", "///text"):
        Attacker(
            attacker.port,
            {"op": "subscribe", "topic": spelling, "type": "std_msgs/String", "compression": "png"},
        )
    attacker.send(_ops("publish", topic="/text", type="std_msgs/String", msg={"data": f"#é{_LETTERS * 2}"}))


def _set_large(attacker: Attacker, value: str) -> str:
    """Set a parameter to JSON; its name."""
    name = "/large" if _NOETIC else "/rosapi:large"
    args = {"name": name, "value": value}
    Attacker(attacker.port, {"op": "call_service", "service": "/rosapi/set_param", "id": "1", "args": args})
    return name


def large_description(attacker: Attacker) -> None:
    """A parameter of a megabyte, asked for again and again."""
    ask = {"name": _set_large(attacker, json.dumps(_LETTERS)), "default_value": ""}
    attacker.send(_ops("call_service", service="/rosapi/get_param", id="#", args=ask))


def _in_text(item: str, count: int) -> str:
    """A list of many items, in JSON."""
    return f"[{','.join([item] * count)}]"


def lists_in_texts(attacker: Attacker) -> None:
    """Millions of lists in a text that is read as JSON: what to answer where a parameter is not set."""
    field = "default" if _NOETIC else "default_value"
    for item, count in (("[]", 3_000_000), ("0", 4_500_000), ('{"a":[]}', 444_444)):
        args = {"name": "/nothing", field: _in_text(item, count)}
        attacker.send(_ops("call_service", service="/rosapi/get_param", id="#", args=args))


def lists_as_parameters(attacker: Attacker) -> None:
    """Parameters with as many values as may be, set and asked for, all of them at once."""
    for number, each in enumerate(_held_connections(attacker, 5)):
        for item, count in (("{}", 30_000), ("0", 30_000), ("[]", 3_000_000), ("0", 4_000_000)):
            name = f"/lists{number}" if _NOETIC else "/rosapi:lists"
            args = {"name": name, "value": _in_text(item, count)}
            each.send(islice(_ops("call_service", service="/rosapi/set_param", args=args), 1), 3 * SECONDS)
    for name in ("/", "/lists0") if _NOETIC else ("/rosapi:lists",):
        attacker.send(_ops("call_service", service="/rosapi/get_param", id="#", args={"name": name}))
    attacker.send(_ops("call_service", service="/rosapi/get_param_names", id="#"))


def tables_as_parameters(attacker: Attacker) -> None:
    """Parameters with as many names as may be, set and asked for, all of them at once."""
    for number, each in enumerate(_held_connections(attacker, 5)):
        table = json.dumps({f"n{count}": "\x01" * 20 for count in range(6_000)})
        args = {"name": f"/tables{number}", "value": table}
        each.send(islice(_ops("call_service", service="/rosapi/set_param", args=args), 1))
    for service, asked in (("get_param", "/"), ("search_param", "nothing"), ("get_param_names", "")):
        args = {"name": asked} if asked else {}
        attacker.send(_ops("call_service", service=f"/rosapi/{service}", id="#", args=args))


def _send_in_drops(attacker: Attacker, head: bytes) -> None:
    """Send the same over many connections, a byte of each at a time."""
    many = [socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) for _ in range(400)]
    _held.extend(many)
    over = time.monotonic() + 3 * SECONDS
    for byte in head:
        for each in many:
            with suppress(OSError):
                each.send(bytes((byte,)))
        if time.monotonic() > over:
            return


def drops_of_handshakes(attacker: Attacker) -> None:
    """Handshakes of which each byte comes by itself, over hundreds of connections."""
    head = b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    _send_in_drops(attacker, head + b"X: " + b"a" * 60)


def drops_of_requests(attacker: Attacker) -> None:
    """Requests over HTTP of which each byte comes by itself, headers without number."""
    _send_in_drops(attacker, b"POST /api/services/rosapi/topics HTTP/1.1\r\nHost: x\r\n" + b"A:\r\n" * 40)


def _post(attacker: Attacker, path: bytes, body: bytes, kind: bytes = b"application/json") -> None:
    """Send a request again and again over a few connections, without a look at what is answered."""
    request = b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: %b\r\nContent-Length: %d\r\n\r\n%b"
    over = time.monotonic() + SECONDS
    while time.monotonic() < over:
        with suppress(OSError), socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) as each:
            each.settimeout(2 * SECONDS)
            each.sendall(request % (path, kind, len(body), body))
            each.recv(4096)


def bodies(attacker: Attacker) -> None:
    """Bodies of a megabyte that unfold to far more, in JSON and CBOR, for services that take none of them."""
    size = 990_000
    for body in (b"[" + b"[]," * (size // 3) + b"0]", b'{"name":"' + b"\\u0001" * (size // 7) + b'"}',
                 b"{" + b",".join(b'"%d":{}' % number for number in range(size // 12)) + b"}"):  # fmt: skip
        for path in (b"/api/services/rosapi/get_param", b"/api/parameters/rosapi:x", b"/api/topics/a"):
            _post(attacker, path, body)
    _post(attacker, b"/api/services/rosapi/get_param", _head(4, size) + b"\xa0" * size, b"application/cbor")


def stalled_events(attacker: Attacker) -> None:
    """Readers of events over HTTP that read nothing of a topic of large samples."""
    publish = {"op": "advertise", "topic": "/events", "type": "std_msgs/String"}
    talker = Attacker(attacker.port, publish)
    for _ in range(60):
        each = socket.create_connection(("127.0.0.1", attacker.port), PATIENCE)
        _held.append(each)
        each.sendall(
            b"GET /api/topics/events HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n"
        )
    talker.send(_ops("publish", topic="/events", msg={"data": f"#{_LETTERS}"}), 2 * SECONDS)


_FOXGLOVE: Final = b"Sec-WebSocket-Protocol: foxglove.sdk.v1"


def foxglove_parameters(attacker: Attacker) -> None:
    """Questions of Foxglove's clients about a thousand parameters each, of which some are large."""
    large = _set_large(attacker, _in_text("0", 30_000))
    viewer = Attacker(attacker.port, headers=(_FOXGLOVE,))
    names = [large.replace(":", ".")] + [f"/rosapi.{'x' * 900}{number}" for number in range(990)]
    viewer.send(_ops("getParameters", parameterNames=names, id="#"))
    viewer.send(_ops("getParameters", parameterNames=[], id="#"))
    viewer.send(_ops("subscribeParameterUpdates", parameterNames=names))


def foxglove_numbers(attacker: Attacker) -> None:
    """Subscriptions, channels and calls of Foxglove's clients with the largest numbers, by the thousand."""
    viewer = Attacker(attacker.port, headers=(_FOXGLOVE,))
    many = [{"id": 2**32 - 1 - number, "channelId": 2**32 - 1 - number} for number in range(5000)]
    viewer.send(_ops("subscribe", subscriptions=many))
    channels = [{"id": each["id"], "topic": f"/f{each['id']}", "encoding": "json",
                 "schemaName": "std_msgs/String"} for each in many]  # fmt: skip
    viewer.send(_ops("advertise", channels=channels))
    viewer.send(repeat(b"\x02" + b"\xff" * 12 + struct.pack("<I", 2**32 - 1)))
    viewer.send(repeat(b"\x01" + b"\xff" * 4 + b"{}"))
    viewer.send(repeat(b"\x03\x00" + struct.pack("<fBQI", math.inf, 1, 2**64 - 1, 2**32 - 1)))
    viewer.send(_ops("fetchAsset", uri=f"package://{'../' * 1000}#", requestId=2**32 - 1))


def many_connections(attacker: Attacker) -> None:
    """Forty connections from one address that is not this machine's, each with as much work as it may."""
    elsewhere = (b"X-Forwarded-For: 192.0.2.1",)
    attackers = [Attacker(attacker.port, headers=elsewhere) for _ in range(40)]
    call = json.dumps({"op": "call_service", "service": "/rosapi/topics", "id": "1"}).encode()
    _together(partial(each.send, repeat(call * 300, 1_000)) for each in attackers)


def smallest_pieces(attacker: Attacker) -> None:
    """Samples that are wanted in pieces of one character."""
    wanted = {"topic": "/cut", "type": "std_msgs/String", "fragment_size": 1}

    def messages() -> Messages:
        yield {"op": "subscribe", **wanted}
        yield from _ops("publish", topic="/cut", msg={"data": f"#{_LETTERS[:20_000]}"})

    attacker.send(messages())


# -- encodings ---------------------------------------------------------------------------------------------


def _bignum(number: int) -> bytes:
    data = number.to_bytes((number.bit_length() + 7) // 8, "big")
    return b"\xc2" + bytes((0x40 + len(data),)) + data


def colliding_keys(attacker: Attacker) -> None:
    """A map whose keys, large integers, all have the same hash."""
    keys = b"".join(_bignum(((1 << 61) - 1) * (number << 8)) + b"\x00" for number in range(1, 30_000))
    attacker.send(_cbor_publish(_head(5, 29_999) + keys) for _ in range(100))


def empty_maps(attacker: Attacker) -> None:
    """Empty maps in CBOR: a byte of each is sixty of memory."""
    attacker.send(_cbor_publish(_head(4, LARGEST) + b"\xa0" * LARGEST) for _ in range(100))


def nested_arrays(attacker: Attacker) -> None:
    """Arrays in arrays in CBOR, just below the limits."""
    count = 250_000
    attacker.send(_cbor_publish(_head(4, count) + b"\x81\x80" * count) for _ in range(100))


def deep_arrays(attacker: Attacker) -> None:
    """Arrays in CBOR within each other, almost as deep as they may be."""
    count = 2_600
    deep = _cbor_publish(_head(4, count) + (b"\x81" * 95 + b"\x80") * count)
    attacker.send(deep for _ in range(100))


def simple_values(attacker: Attacker) -> None:
    """Values of CBOR that no message has, each of which takes its decoder long."""
    count = 120_000
    attacker.send(_cbor_publish(_head(4, count) + b"\xf8\x20" * count) for _ in range(100))


def deep_json(attacker: Attacker) -> None:
    """JSON that is nested almost too deeply, all over, where it is passed over."""
    deep = b",".join([b"[" * 90 + b"]" * 90] * (LARGEST // 181))
    attacker.send(b'{"op":"subscribe","topic":"/a","x":[' + deep + b"]}" for _ in range(100))


def deep_payload(attacker: Attacker) -> None:
    """The same in a payload that is not of its type."""
    deep = b",".join([b"[" * 90 + b"]" * 90] * (LARGEST // 181))
    attacker.send(
        b'{"op":"publish","topic":"/a","type":"std_msgs/String","msg":{"x":[' + deep + b"]}}"
        for _ in range(100)
    )


def many_in_a_member(attacker: Attacker) -> None:
    """Empty arrays where a quality of service is expected."""
    arrays = b"[]," * (LARGEST // 3)
    attacker.send(b'{"op":"subscribe","topic":"/a","qos":[' + arrays + b"0]}" for _ in range(100))


def constants(attacker: Attacker) -> None:
    """Numbers that JSON has not, among texts that hold their names."""
    each = b'NaN,"NaN",'
    attacker.send(
        b'{"op":"publish","topic":"/a","msg":[' + each * (LARGEST // len(each)) + b"0]}" for _ in range(100)
    )


def slow_numbers(attacker: Attacker) -> None:
    """Numbers as 1e308, of which each takes long to be read: in payloads, members and texts, by the message
    and by the frame."""
    kind = b'"topic":"/slow","type":"std_msgs/Float64MultiArray"'
    for count in (600, 8_000, LARGEST // 6 - 100):
        numbers = b"[" + b"1e308," * count + b"1e-308]"
        in_payload = b'{"op":"publish",' + kind + b',"msg":{"data":' + numbers + b"}}"
        in_member = b'{"op":"subscribe","topic":"/slow","qos":{"depth":' + numbers + b"}}"
        in_arguments = b'{"op":"call_service","service":"/rosapi/get_param","args":' + numbers + b"}"
        args = {"name": "/nothing", "default_value": numbers.decode()}
        in_text = json.dumps({"op": "call_service", "service": "/rosapi/get_param", "args": args}).encode()
        for one in (in_payload, in_member, in_arguments, in_text):
            Attacker(attacker.port).send(repeat(one * max(1, 600_000 // len(one)), 3))


def long_numbers(attacker: Attacker) -> None:
    """Numbers of millions of digits."""
    attacker.send(
        b'{"op":"subscribe","topic":"/a","throttle_rate":' + b"1" * LARGEST + b"}" for _ in range(100)
    )


def defaults(attacker: Attacker) -> None:
    """Messages of which each has many members, all left out."""
    empty = b"{}," * 100_000
    kind = b'"topic":"/markers","type":"visualization_msgs/MarkerArray"'
    attacker.send(b'{"op":"publish",' + kind + b',"msg":{"markers":[' + empty + b"{}]}}" for _ in range(100))


def incomplete_poses(attacker: Attacker) -> None:
    """Poses of which each lacks much, some of it in another spelling."""
    pose = b'{"header":{"seq":1},"pose":{"position":{"x":1}}}'
    kind = b'"topic":"/poses","type":"nav_msgs/Path"'
    poses = b",".join([pose] * 20_000)
    attacker.send(b'{"op":"publish",' + kind + b',"msg":{"poses":[' + poses + b"]}}" for _ in range(1000))


def blanks(attacker: Attacker) -> None:
    """A few thousand empty poses among millions of blanks, wherever these may stand."""
    kind = b'{"op":"publish","topic":"/few","type":"geometry_msgs/PoseArray","msg":{"poses":['
    count, size = 3_000, LARGEST - 20_000
    apart, between = b" " * size, b" " * (size // count)
    empty = b"{}," * (count - 1) + b"{}"
    for poses in (
        b",".join([b"{}" + between] * count) + b"]}}",
        b",".join([b"{" + between + b"}"] * count) + b"]}}",
        empty + apart + b"]}}",
        apart + empty + b"]}}",
        b"{}" + apart + b"," + empty + b"]}}",
        empty + b"," + apart + b"{}]}}",
        b"{" + apart + b"}," + empty + b"]}}",
        empty + b"]" + apart + b"}}",
        empty + b"]}" + apart + b"}",
    ):
        Attacker(attacker.port).send(iter([kind + poses]))


def empty_names(attacker: Attacker) -> None:
    """Millions of empty texts in a message that lacks its header."""
    kind = b'"topic":"/joints","type":"sensor_msgs/JointState"'
    names = b'"",' * (LARGEST // 3 - 100)
    attacker.send(b'{"op":"publish",' + kind + b',"msg":{"name":[' + names + b'""]}}' for _ in range(100))


def names_in_cbor(attacker: Attacker) -> None:
    """Millions of names, for somebody who wants them in CBOR."""
    kind = "sensor_msgs/JointState"
    Attacker(attacker.port, {"op": "subscribe", "topic": "/joints", "type": kind, "compression": "cbor"})
    names = b'"",' * (LARGEST // 3 - 100)
    head = b'{"header":{"stamp":{"sec":1,"nanosec":2},"frame_id":""},"name":[' + names
    msg = head + b'""],"position":[],"velocity":[],"effort":[]}'
    op = b'{"op":"publish","topic":"/joints","type":"sensor_msgs/JointState","msg":' + msg + b"}"
    attacker.send(op for _ in range(3))


def header_at_the_end(attacker: Attacker) -> None:
    """Hundreds of thousands of poses in a message whose header stands behind them."""
    kind = {"topic": "/poses", "type": "geometry_msgs/PoseArray"}
    Attacker(attacker.port, {"op": "subscribe", **kind})
    seq = b'"seq":1,' if _NOETIC else b""
    stamp = b'"secs":1,"nsecs":2' if seq else b'"sec":1,"nanosec":2'
    pose = b'{"position":{"x":0,"y":0,"z":0},"orientation":{"x":0,"y":0,"z":0,"w":1}}'
    poses = b",".join([pose] * (LARGEST // (len(pose) + 1) - 10))
    header = b'"header":{' + seq + b'"stamp":{' + stamp + b'},"frame_id":""}'
    names = json.dumps(kind)[1:-1].encode()
    op = b'{"op":"publish",' + names + b',"msg":{"poses":[' + poses + b"]," + header + b"}}"
    attacker.send(op for _ in range(3))


def values_in_cdr(attacker: Attacker) -> None:
    """Hundreds of thousands of pairs within one item of a list, for readers of CBOR and CDR."""
    kind = {"topic": "/diagnostics", "type": "diagnostic_msgs/DiagnosticArray"}
    for compression in ("cbor", "cbor-raw"):
        Attacker(attacker.port, {"op": "subscribe", **kind, "compression": compression})
    pairs = b",".join([b'{"key":"","value":""}'] * (LARGEST // 24))
    status = b'{"level":0,"name":"","message":"","hardware_id":"","values":[' + pairs + b"]}"
    msg = b'{"header":{"stamp":{"sec":1,"nanosec":2},"frame_id":""},"status":[' + status + b"]}"
    names = json.dumps(kind)[1:-1].encode()
    op = b'{"op":"publish",' + names + b',"msg":' + msg + b"}"
    attacker.send(op for _ in range(3))


def numbers_in_an_item(attacker: Attacker) -> None:
    """Millions of numbers in the only item of a list, which lacks its other members, for readers of every
    encoding: as many as are taken, and more."""
    kind = {"topic": "/cloud", "type": "sensor_msgs/PointCloud"}
    for compression in ("none", "cbor", "cbor-raw"):
        Attacker(attacker.port, {"op": "subscribe", **kind, "compression": compression})
    names = json.dumps(kind)[1:-1].encode()
    for number in (b"0.1,", b"0,"):
        numbers = number * (LARGEST // len(number) - 200) + b"0"
        op = b'{"op":"publish",' + names + b',"msg":{"channels":[{"values":[' + numbers + b"]}]}}"
        attacker.send(op for _ in range(3))


def broken_lists(attacker: Attacker) -> None:
    """Millions of values of which only the last shows that they are no message."""
    kind = b'"topic":"/joints","type":"sensor_msgs/JointState"'
    for value, last in ((b'"",', b"1"), (b'"",', b"x"), (b"0,", b"NaN"), (b"{},", b"0"), (b"null,", b'"')):
        values = value * (LARGEST // len(value) - 100)
        for member in (b"name", b"position", b"other"):
            msg = b'{"' + member + b'":[' + values + last + b"]}"
            attacker.send(iter([b'{"op":"publish",' + kind + b',"msg":' + msg + b"}"]))


def large_arguments(attacker: Attacker) -> None:
    """Millions of texts in the arguments of calls, by their names and in order."""
    texts = b"[" + b'"",' * (LARGEST // 3 - 100) + b'""]'
    call = b'{"op":"call_service","service":"/rosapi/set_param","args":'
    for args in (b'{"name":' + texts + b"}", texts, b'{"x":{"y":' + texts + b"}}"):
        attacker.send(iter([call + args + b"}"]))


def everything_kept(attacker: Attacker) -> None:
    """As many subscriptions as there may be, over many connections, all of which stay."""
    kind = '"type":"std_msgs/String"'
    each = (b'{"op":"subscribe","topic":"/any%d",%b}' % (number, kind.encode()) for number in range(900))
    ops = b"".join(frame(TEXT, op, key=bytes(4)) for op in each)
    for _ in range(5):
        one = Attacker(attacker.port)
        _held.append(one)
        one.send_raw(ops, time.monotonic() + 20 * SECONDS)
    for each_held in _held:
        assert isinstance(each_held, Attacker)
        each_held.send(iter([{"op": "call_service", "service": "/rosapi/get_time", "id": "t"}]))


def every_type(attacker: Attacker) -> None:
    """Topics of all types that there are, each of which is compiled."""
    from rwt_interfaces.registry import Registry

    kinds = [name for name in Registry().names("msg") if "/" in name]

    def messages() -> Messages:
        for kind in kinds:
            topic = {"topic": f"/of/{kind}", "type": kind}
            for compression in ("cbor", "cbor-raw"):
                yield {"op": "subscribe", **topic, "compression": compression}
            yield {"op": "publish", **topic, "msg": {}}

    attacker.send(messages(), 4 * SECONDS)


def deflate_bombs(attacker: Attacker) -> None:
    """Messages of megabytes in compressed frames of a few kilobytes."""
    Attacker(attacker.port, headers=(_DEFLATE,)).send_raw(_BOMB * 20)


def picture_bombs(attacker: Attacker) -> None:
    """Messages of megabytes in pictures of a few kilobytes."""
    side = math.isqrt(LARGEST // 3)
    text = b'{"op":"publish","topic":"/a","type":"std_msgs/String","msg":{"data":"'
    rows = text.ljust(side * side * 3 - 3, b"x") + b'"}}'
    lines = b"".join(b"\x00" + rows[start : start + side * 3] for start in range(0, len(rows), side * 3))
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    picture = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )
    attacker.send(_ops("png", data=base64.b64encode(picture).decode()))


# -- the rest ----------------------------------------------------------------------------------------------


def parameters(attacker: Attacker) -> None:
    """Large parameters under new names."""
    args = {"name": "/kept/p#", "value": json.dumps(_LETTERS)}
    attacker.send(_ops("call_service", service="/rosapi/set_param", id="#", args=args))


def refusals(attacker: Attacker) -> None:
    """Thousands of requests that fail, each of which would be a line of the log."""
    attacker.send(_ops("publish", topic="/unknown#", msg={}))


def services_again(attacker: Attacker) -> None:
    """The same service offered again and again."""
    attacker.send(_ops("advertise_service", service="/again", type="std_srvs/SetBool"))


def expensive_videos(attacker: Attacker) -> None:
    """As many different videos as there may be, as large and as slow to make as can be asked for."""
    _watch(attacker, 16, "width=1280&height=720")


def mjpeg_flood(attacker: Attacker) -> None:
    """As many different streams of pictures as there may be, large and of the best quality."""
    _watch(attacker, 60, "width=1920&height=1080", "type=mjpeg&quality=100")


def snapshots_again(attacker: Attacker) -> None:
    """Pictures of ever new sizes, many asked for before the first answer is read."""
    _watch(attacker, 1, "width=64&height=48", "type=mjpeg")
    over, number = time.monotonic() + SECONDS, 0
    while time.monotonic() < over:
        with socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) as reader:
            for _ in range(20):
                number += 1
                query = f"topic=/picture&width={1000 + number % 900}&height=1000&quality=100"
                reader.sendall(f"GET /snapshot?{query} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            reader.settimeout(0.1)
            with suppress(OSError):
                reader.recv(1 << 20)


def small_video(attacker: Attacker) -> None:
    """One small video, with which the server loads its libraries."""
    _watch(attacker, 1, "width=64&height=48")


def _watch(attacker: Attacker, viewers: int, size: str, kind: str = "") -> None:
    picture = {"width": 320, "height": 240, "step": 960, "encoding": "rgb8", "data": "AAAA" * 76_800}
    publish = _ops("publish", topic="/picture", type="sensor_msgs/Image", msg=picture)
    attacker.send(islice(publish, 1))
    for number in range(viewers):
        viewer = socket.create_connection(("127.0.0.1", attacker.port), PATIENCE)
        wanted = kind or ("type=h264&preset=medium" if number % 2 else "type=vp8&quality=good")
        query = f"topic=/picture&gop={number + 1}&{size}&{wanted}"
        viewer.sendall(f"GET /stream?{query} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        _held.append(viewer)
    attacker.send(publish)


_held: Final[list[socket.socket | Attacker]] = []
"""Connections that stay open."""

ATTACKS: Final[dict[str, Callable[[Attacker], None]]] = {
    attack.__name__: attack
    for attack in (
        throttled_queue, endless_depth, latched_topics, lingering_publishers, endless_goals, unanswered_calls,
        long_ids, long_goal_ids, long_names_to_hear, long_names_to_offer, long_names_of_services,
        long_questions, unread_answers, half_messages, pieces_of_a_frame, inflated_at_once,
        whole_at_once, lists_at_once, lists_in_tls, lists_over_tcp, smallest_objects, lists_inflated,
        lists_everywhere, handshakes_in_tls, samples_in_tls, cut_with_a_backlog,
        blanks, header_at_the_end,
        half_bodies, forms_of_what_is_kept, feedback_flood,
        long_lists_of_numbers, small_typed_arrays,
        fragments_left_open, spellings, rosapi_flood, many_in_a_frame, smallest_pieces, colliding_keys,
        empty_maps, nested_arrays, deep_json, deep_payload, many_in_a_member, constants, slow_numbers,
        long_numbers, defaults, incomplete_poses, empty_names, parameters, refusals, services_again,
        small_video, expensive_videos, lists_of_many, offers_again, everything_subscribed, come_and_go,
        pages_again, pictures_of_text, large_description, lists_in_texts, lists_as_parameters,
        tables_as_parameters, drops_of_handshakes, drops_of_requests, bodies, stalled_events,
        foxglove_parameters, foxglove_numbers, many_connections, names_in_cbor, values_in_cdr,
        numbers_in_an_item, broken_lists, large_arguments, everything_kept, deep_arrays, simple_values,
        every_type,
        deflate_bombs, picture_bombs, mjpeg_flood, snapshots_again,
    )
} | by_http.ATTACKS | refused.ATTACKS  # fmt: skip
"""Each attack by its name."""


def main() -> None:
    """Attack by what is read; with the input's end the attacker is gone."""
    _PORTS.update(zip(SCHEMES, map(int, sys.argv[2:]), strict=True))
    attacking: list[int] = []
    for line in sys.stdin:
        for name in line.split():
            attacking.append(os.fork())
            if not attacking[-1]:
                _attack(name)
        if not line.strip():
            for process in attacking:
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)
            attacking.clear()
            _say("gone")


def _say(word: str) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


def _attack(name: str) -> NoReturn:
    """Attack, say so, and wait for the end."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: gone with the process that waits for it
    try:
        ATTACKS[name](Attacker(_PORTS["ws"]))
        _say("done")
    except Refused as error:
        _say("refused" if "limits.connections" in str(error) else f"{name}: {str(error)[-200:]!r}")
    except Exception as error:
        traceback.print_exc()
        _say(f"{name}: {error!r}")
    while True:
        signal.pause()


if __name__ == "__main__":
    main()
