"""A client that attacks, in a process of its own: `python -m tests.faults.attacks.attacker PORT NAME`.

It does for a second what the attack of that name does, prints a line, and stays connected until its input
ends.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Final

from tests.faults.blocking_client import BlockingClient
from tests.transports.rfc6455.frames import BINARY, TEXT, frame

SECONDS: Final = 1.0
LARGEST: Final = 9_900_000
"""Bytes of a message that the server takes by default."""

_MB: Final = 1_000_000
_LETTERS: Final = "x" * _MB

Messages = Iterator[bytes | dict[str, object]]
"""What is sent one after the other, for as long as the time lasts: CBOR, or the members of an op."""


class Attacker:
    """A connection that sends as fast as the server takes it, and reads and forgets what comes."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._client = BlockingClient(port)
        self._socket = self._client.socket
        threading.Thread(target=self._drain, daemon=True).start()

    def _drain(self) -> None:
        try:
            while self._socket.recv(1 << 20):
                pass
        except OSError:
            return

    def send(self, messages: Messages) -> None:
        """Send until there is nothing more, the time is over, or the server has closed."""
        over = time.monotonic() + SECONDS
        for message in messages:
            data = json.dumps(message).encode() if isinstance(message, dict) else message
            opcode = TEXT if data[:1] == b"{" else BINARY
            view = memoryview(frame(opcode, data, key=bytes(4)))
            while view:
                self._socket.settimeout(max(0.01, over - time.monotonic()))
                try:
                    view = view[self._socket.send(view) :]
                except OSError:
                    return
            if time.monotonic() > over:
                return


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
    Attacker(attacker.port).send(
        iter([{"op": "subscribe", "topic": "/camera", "type": "std_msgs/String", "queue_length": 10**9,
               "throttle_rate": 10**9}])
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
    Attacker(attacker.port).send(iter([{"op": "advertise_action", "action": "/never", "type": kind}]))
    args = {"trajectory": {"joint_names": [f"#{_LETTERS}"]}}
    attacker.send(_ops("send_action_goal", action="/never", action_type=kind, id="#", args=args))


def unanswered_calls(attacker: Attacker) -> None:
    """Large calls of a service that never answers."""
    provider = Attacker(attacker.port)
    provider.send(
        iter([{"op": "advertise_service", "service": "/deaf", "type": "rcl_interfaces/SetParameters"}])
    )
    args = {"parameters": [{"name": f"#{_LETTERS}"}]}
    attacker.send(_ops("call_service", service="/deaf", id="#", args=args, timeout=1000))


def fragments_left_open(attacker: Attacker) -> None:
    """Pieces of messages that never get their last."""
    attacker.send(_ops("fragment", id="#", num=0, total=2, data=_LETTERS))


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


# -- the rest ----------------------------------------------------------------------------------------------


def parameters(attacker: Attacker) -> None:
    """Large parameters under new names."""
    args = {"name": "/kept/p#", "value": json.dumps(_LETTERS)}
    attacker.send(_ops("call_service", service="/rosapi/set_param", id="#", args=args))


def refusals(attacker: Attacker) -> None:
    """Nothing that can be done, thousands of times: each would be a line of the log."""
    attacker.send(_ops("publish", topic="/unknown#", msg={}))


def services_again(attacker: Attacker) -> None:
    """The same service offered again and again."""
    attacker.send(_ops("advertise_service", service="/again", type="std_srvs/SetBool"))


def expensive_videos(attacker: Attacker) -> None:
    """As many different videos as there may be, as large and as slow to make as can be asked for."""
    _watch(attacker, 16, "width=1280&height=720")


def small_video(attacker: Attacker) -> None:
    """One small video, with which the server loads its libraries."""
    _watch(attacker, 1, "width=64&height=48")


def _watch(attacker: Attacker, viewers: int, size: str) -> None:
    picture = {"width": 320, "height": 240, "step": 960, "encoding": "rgb8", "data": "AAAA" * 76_800}
    publish = _ops("publish", topic="/picture", type="sensor_msgs/Image", msg=picture)
    attacker.send(islice(publish, 1))
    for number in range(viewers):
        viewer = socket.create_connection(("127.0.0.1", attacker.port), 5)
        kind = "type=h264&preset=medium" if number % 2 else "type=vp8&quality=good"
        query = f"topic=/picture&gop={number + 1}&{size}&{kind}"
        viewer.sendall(f"GET /stream?{query} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        _held.append(viewer)
    attacker.send(publish)


_held: Final[list[socket.socket]] = []
"""Connections that stay open."""

ATTACKS: Final[Mapping[str, Callable[[Attacker], None]]] = {
    attack.__name__: attack
    for attack in (
        throttled_queue, endless_depth, latched_topics, lingering_publishers, endless_goals, unanswered_calls,
        fragments_left_open, spellings, rosapi_flood, many_in_a_frame, smallest_pieces, colliding_keys,
        empty_maps, nested_arrays, deep_json, deep_payload, many_in_a_member, constants, long_numbers,
        defaults, parameters, refusals, services_again, small_video, expensive_videos,
    )
}  # fmt: skip
"""Each attack by its name."""


def main() -> None:
    """Attack, say so, and wait."""
    port, name = int(sys.argv[1]), sys.argv[2]
    ATTACKS[name](Attacker(port))
    sys.stdout.write("done\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    main()
