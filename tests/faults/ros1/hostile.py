"""ROS 1 program that breaks the rules: `python -m tests.faults.ros1.hostile ATTACK MASTER_PORT`.

It waits for a line of its input, attacks, prints `done`, and is an honest publisher of `/still` then. Attacks
of a master are one until then: they listen on the port. It imports nothing of this project.
"""

from __future__ import annotations

import http.client
import itertools
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

SECONDS: Final = 4.0
"""Duration of attacks that have no end of their own."""

MIB: Final = 1 << 20
STRING: Final = {
    "topic": "/still",
    "type": "std_msgs/String",
    "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
    "message_definition": "string data\n",
    "callerid": "/hostile",
}
EMPTY: Final = {
    "type": "std_msgs/Empty",
    "md5sum": "d41d8cd98f00b204e9800998ecf8427e",
    "message_definition": "",
}

Methods = dict[str, Callable[..., Any]]
Serve = Callable[[socket.socket], None]
Attack = Callable[[str], None]

ATTACKS: dict[str, Attack] = {}


def attack(call: Attack) -> Attack:
    """Register an attack by a node: called with the master's URI."""
    ATTACKS[call.__name__] = call
    return call


def encode(value: Any) -> bytes:
    """Return a response of XML-RPC."""
    return xmlrpc.client.dumps((value,), methodresponse=True, allow_none=True).encode()


def frame(body: bytes) -> bytes:
    """Return bytes with their length before them."""
    return struct.pack("<I", len(body)) + body


def header(fields: dict[str, str]) -> bytes:
    """Return a connection header."""
    return frame(b"".join(frame(f"{name}={value}".encode()) for name, value in fields.items()))


def soon(call: Callable[..., object], *arguments: object) -> None:
    """Call a function in a thread that ends with the program."""
    threading.Thread(target=call, args=arguments, daemon=True).start()


def until_over() -> Iterator[int]:
    """Count until the time of an attack is over."""
    end = time.monotonic() + SECONDS
    return itertools.takewhile(lambda _: time.monotonic() < end, itertools.count())


def _zero(*_: object) -> int:
    return 0


class Rpc:
    """Server of XML-RPC, whose methods return values, or bytes: the body or, with `raw`, all that is sent."""

    def __init__(self, methods: Methods, port: int = 0) -> None:
        self.methods = methods
        self.raw = False
        rpc = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                params, method = xmlrpc.client.loads(body)
                answer = rpc.methods.get(str(method), _zero)(*params)
                with suppress(OSError):
                    if rpc.raw and isinstance(answer, Iterator):
                        for part in answer:
                            self.wfile.write(part)
                        self.close_connection = True
                        return
                    sent = answer if isinstance(answer, bytes) else encode([1, "", answer])
                    self.send_response(200)
                    self.send_header("Content-Length", str(len(sent)))
                    self.end_headers()
                    self.wfile.write(sent)

            def log_message(self, *_: object) -> None:
                pass

        class Server(ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = 100

            def handle_error(self, *_: object) -> None:
                pass

        self.server = Server(("127.0.0.1", port), Handler)
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}/"
        soon(self.server.serve_forever)


class Node:
    """Node whose subscribers are served by a function, after their header."""

    def __init__(self, serve: Serve) -> None:
        self._serve = serve
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=1000)
        port = self._listener.getsockname()[1]
        self.uri = Rpc({"requestTopic": lambda *_: ["TCPROS", "127.0.0.1", port]}).uri
        soon(self._accept)

    def _accept(self) -> None:
        while True:
            soon(self._connection, self._listener.accept()[0])

    def _connection(self, connection: socket.socket) -> None:
        with connection, suppress(OSError):
            received(connection)
            self._serve(connection)
            while connection.recv(MIB):
                pass


def received(connection: socket.socket) -> bytes:
    """Return the next frame."""
    (length,) = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))
    return connection.recv(length, socket.MSG_WAITALL)


def call(uri: str, method: str, *params: object) -> Any:
    """Call a method, and return what the status comes with."""
    with xmlrpc.client.ServerProxy(uri) as proxy:
        answer: Any = getattr(proxy, method)(*params)
        return answer[2]


def publish(
    master: str, topic: str, serve: Serve, type: str = "std_msgs/String", name: str = "/hostile"
) -> None:
    """Offer a topic."""
    call(master, "registerPublisher", name, topic, type, Node(serve).uri)


def sends(*parts: bytes) -> Serve:
    """Return a publisher that sends these bytes."""

    def serve(connection: socket.socket) -> None:
        for part in parts:
            connection.sendall(part)

    return serve


def lookup(master: str, topic: str) -> tuple[str, str, int]:
    """Return the URI of the publisher of a topic, and the address for its subscribers."""
    publishers: dict[str, list[str]] = {}
    while topic not in publishers:
        publishers = dict(call(master, "getSystemState", "/hostile")[0])
    uri = call(master, "lookupNode", "/hostile", publishers[topic][0])
    _, host, port = call(uri, "requestTopic", "/hostile", topic, [["TCPROS"]])
    return uri, host, port


# Publishers


@attack
def four_gigabytes(master: str) -> None:
    """Each frame claims 4 GB, in the header and behind it."""
    publish(master, "/one", sends(b"\xff\xff\xff\xff"))
    publish(master, "/two", sends(header({**STRING, "topic": "/two"}), b"\xff\xff\xff\xff"), name="/second")
    time.sleep(SECONDS)


@attack
def unfinished_frames(master: str) -> None:
    """Forty publishers each begin a message of 120 MB, and send 100 MB of it."""

    def serve(connection: socket.socket) -> None:
        connection.sendall(header({**STRING, "topic": "/one"}) + struct.pack("<I", 120_000_000))
        for _ in range(100):
            connection.sendall(bytes(MIB))

    for number in range(40):
        publish(master, "/one", serve, name=f"/hostile_{number}")
    time.sleep(2 * SECONDS)


@attack
def another_type(master: str) -> None:
    """Headers with another type, with another MD5 sum, and one without fields."""
    other = {**STRING, "type": "std_msgs/Int8", "md5sum": "27ffa0c9c4b8fb8492252bcad9e5c57b"}
    for number, fields in enumerate((other, {**STRING, "md5sum": "0" * 32}, {})):
        publish(
            master, "/one", sends(header({**fields, "message_definition": "int8 data"})), name=f"/h_{number}"
        )
    time.sleep(SECONDS)


@attack
def drips(master: str) -> None:
    """A byte of the header, or of a message, now and then."""

    def serve(connection: socket.socket) -> None:
        for byte in header({**STRING, "topic": "/one"}) * 10:
            connection.sendall(bytes([byte]))
            time.sleep(0.01)

    for number in range(100):
        publish(master, "/one", serve, name=f"/hostile_{number}")
    time.sleep(SECONDS)


@attack
def small_frames(master: str) -> None:
    """Empty messages as fast as possible, on ten topics."""

    def serve(topic: str, connection: socket.socket) -> None:
        connection.sendall(header({**EMPTY, "topic": topic, "callerid": "/hostile"}))
        for _ in until_over():
            connection.sendall(bytes(4 * 50_000))

    for number in range(10):
        topic = f"/empty_{number}"
        publish(master, topic, lambda c, topic=topic: serve(topic, c), "std_msgs/Empty")  # type: ignore[misc]
    time.sleep(SECONDS)


def _definition(lines: int) -> str:
    return "".join(f"uint8[] field_{number}\n" for number in range(lines))


@attack
def definitions(master: str) -> None:
    """Definitions: long, nested a hundred times, of itself, with fixed arrays of fixed arrays; each anew."""
    line = "=" * 80
    nested = f"\n{line}\n".join(
        f"{'' if n == 0 else f'MSG: h/N{n}' + chr(10)}N{n + 1}[1000] a\nN{n + 1} b" for n in range(99)
    )
    texts = (
        _definition(2900),
        nested + f"\n{line}\nMSG: h/N99\nint8 a",
        "N0 a\n",
        "int8[2000000000] a\n",
        f"N1[65536] a\n{line}\nMSG: h/N1\nN2[65536] a\n{line}\nMSG: h/N2\nint8[65536] a\n",
        "string A=" + "x" * 200_000,
        "\n".join(f"int8 A{number}={number}" for number in range(2900)),
    )

    def serve(topic: str, text: str, connection: socket.socket) -> None:
        fields = {**STRING, "topic": topic, "type": "h/N0", "message_definition": text}
        connection.sendall(header({**fields, "md5sum": "0" * 32}))

    for number, text in enumerate(texts * 4):
        topic = f"/defined_{number}"
        publish(master, topic, lambda c, topic=topic, text=text: serve(topic, text, c), "h/N0")  # type: ignore[misc]
    time.sleep(2 * SECONDS)


@attack
def many_values(master: str) -> None:
    """Messages of 20 MB with millions of empty texts, or of objects."""
    names = bytes(16) + struct.pack("<I", 5_000_000) + bytes(20_000_000) + bytes(12)
    joints = {
        "topic": "/joints",
        "callerid": "/hostile",
        "type": "sensor_msgs/JointState",
        "md5sum": "3066dcd76a6cfaef579bd0f34173e9fd",
        "message_definition": "-",
    }
    publish(master, "/joints", sends(header(joints), *[frame(names)] * 5), "sensor_msgs/JointState")
    status = bytes(16) + struct.pack("<I", 1) + bytes(13) + struct.pack("<I", 2_500_000) + bytes(20_000_000)
    array = {**joints, "topic": "/values", "type": "diagnostic_msgs/DiagnosticArray"}
    array["md5sum"] = "60810da900de1dd6ddd437c3503511da"
    publish(master, "/values", sends(header(array), *[frame(status)] * 5), "diagnostic_msgs/DiagnosticArray")
    time.sleep(2 * SECONDS)


# Subscribers, and clients of services


@attack
def stalled_subscribers(master: str) -> None:
    """Three hundred subscribers of large messages that do not read."""
    _, host, port = lookup(master, "/large")
    opened = []
    for number in range(300):
        connection = socket.create_connection((host, port))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.sendall(header({**STRING, "topic": "/large", "callerid": f"/stalled_{number}"}))
        opened.append(connection)
    time.sleep(2 * SECONDS)


@attack
def ever_new_subscribers(master: str) -> None:
    """Subscribers of ever new names, each 3 kB, of which a part has another MD5 sum."""
    _, host, port = lookup(master, "/large")
    for number in until_over():
        with socket.create_connection((host, port)) as connection, suppress(OSError):
            sums = "0" * 32 if number % 2 else "*"
            connection.sendall(
                header({**STRING, "topic": "/large", "md5sum": sums, "callerid": f"/{number}" * 500})
            )
            connection.recv(1)


@attack
def broken_headers(master: str) -> None:
    """Headers of a thousand connections: of 500 kB, of 10,000 fields, of no fields, and never finished."""
    _, host, port = lookup(master, "/large")
    bodies = (
        header({f"a{n}": "b" for n in range(10_000)}),
        header({"topic": "x" * 500_000, "md5sum": "*"}),
        header({}),
        header(STRING)[:50],
        frame(b"x" * 500_000),
        bytes(100_000),
    )
    opened = []
    for number in range(1500):
        with suppress(OSError):
            opened.append(socket.create_connection((host, port)))
            opened[-1].sendall(bodies[number % len(bodies)])
    time.sleep(SECONDS)


@attack
def service_requests(master: str) -> None:
    """Requests of 100 MB, of the wrong form, many in a row, and half of one."""
    uri = ""
    while not uri:
        uri = call(master, "lookupService", "/hostile", "/rosapi/get_param")
    host, port = uri.removeprefix("rosrpc://").split(":")
    fields = {"callerid": "/hostile", "service": "/rosapi/get_param", "md5sum": "*", "persistent": "1"}
    for number in until_over():
        with socket.create_connection((host, int(port))) as connection, suppress(OSError):
            connection.sendall(header(fields))
            received(connection)
            if number % 20 == 0:
                connection.sendall(frame(bytes(50_000_000)))
            connection.sendall(frame(b"xx") * 1000)
            connection.sendall(frame(frame(b"/a") + frame(b"1")) * 1000)
            connection.sendall(b"\xff\xff\xff\xff")
            connection.recv(1)


# Callers of the slave API, and of the master's


def _post(uri: str, head: bytes, *parts: bytes) -> None:
    host, port = uri.removeprefix("http://").rstrip("/").split(":")
    with socket.create_connection((host, int(port)), 5) as connection, suppress(OSError):
        connection.sendall(b"POST /RPC2 HTTP/1.1\r\nHost: a\r\n" + head + b"\r\n")
        for part in parts:
            connection.sendall(part)
        connection.recv(1000)


def _bodies() -> list[bytes]:
    elements = b"<value><int>1</int></value>"
    start = b"<?xml version='1.0'?><methodCall><methodName>getPid</methodName><params><param><value>"
    end = b"</value></param></params></methodCall>"
    bomb = (
        b'<!DOCTYPE a [<!ENTITY a "' + b"x" * 10_000 + b'"><!ENTITY b "' + b"&a;" * 10_000 + b'">]><a>&b;</a>'
    )
    return [
        start + b"<array><data>" + elements * 330_000 + b"</data></array>" + end,
        start + b"<array><data>" * 500_000 + end,
        start + b"<string>" + b"x" * 15_000_000 + b"</string>" + end,
        start + b"<int>" + b"9" * 15_000_000 + b"</int>" + end,
        start + b"<base64>" + b"A" * 15_000_000 + b"</base64>" + end,
        start
        + b"<struct>"
        + b"<member><name>a</name><value>b</value></member>" * 200_000
        + b"</struct>"
        + end,
        b"<a " + b" ".join(b"a%d='1'" % number for number in range(500_000)) + b"/>",
        b"<" + b"a" * 15_000_000,
        b"&amp;" * 3_000_000,
        b"<!--" + b"- " * 7_500_000,
        bomb,
        start.replace(b"getPid", b"publisherUpdate")
        + b"</value></param><param><value>/one</value></param><param><value>"
        b"<array><data>"
        + b"".join(b"<value>http://127.0.0.1:9/%d</value>" % n for n in range(100_000))
        + b"</data></array>"
        + end,
    ]


@attack
def large_calls(master: str) -> None:
    """Calls of up to 15 MB to a node and to the master, eight at once."""
    node = lookup(master, "/large")[0]
    threads = [
        threading.Thread(target=_post, args=(uri, b"Content-Length: %d\r\n" % len(body), body))
        for uri in (node, master)
        for body in _bodies()
    ]
    for number in range(0, len(threads), 8):
        for thread in threads[number : number + 8]:
            thread.start()
        for thread in threads[number : number + 8]:
            thread.join()


@attack
def endless_heads(master: str) -> None:
    """Heads of requests without an end, and bodies in ever new chunks."""
    node = lookup(master, "/large")[0]
    _post(node, b"".join(b"X%d: y\r\n" % number for number in range(500_000)))
    _post(node, b"Transfer-Encoding: chunked\r\n", *[b"1\r\nx\r\n" * 10_000] * 100)
    _post(node, b"Content-Length: 99999999999\r\n", *[bytes(MIB)] * 20)


@attack
def idle_callers(master: str) -> None:
    """Five hundred connections to a node's slave API, with a byte now and then; others must be answered."""
    node = lookup(master, "/large")[0]
    host, port = node.removeprefix("http://").rstrip("/").split(":")
    opened = [socket.create_connection((host, int(port))) for _ in range(500)]
    for number in until_over():
        if number % 50 == 0:
            assert call(node, "getPid", "/hostile") > 0
        with suppress(OSError):
            opened[number % 500].sendall(b"P")
        time.sleep(0.002)


@attack
def many_registrations(master: str) -> None:
    """Registrations of ever new topics, subscribers of one topic, and watched parameters, until refused."""
    with xmlrpc.client.ServerProxy(master) as proxy:
        for kind in ("topics", "subscribers", "parameters"):
            with suppress(xmlrpc.client.Error):
                for first in range(0, 30_000, 500):
                    calls = xmlrpc.client.MultiCall(proxy)
                    for number in range(first, first + 500):
                        name, uri = f"/node_{number}", f"http://127.0.0.1:9/{number}"
                        if kind == "topics":
                            calls.registerPublisher(name, f"/topic_{number}", "std_msgs/String", uri)
                        elif kind == "subscribers":
                            calls.registerSubscriber(name, "/crowd", "std_msgs/String", uri)
                        else:
                            calls.subscribeParam(name, uri, "/watched")
                    assert calls() is not None
        for number in range(10):
            with suppress(xmlrpc.client.Error):
                proxy.registerPublisher(
                    "/speaker", "/crowd", "std_msgs/String", f"http://127.0.0.1:9/s{number}"
                )
                proxy.setParam("/speaker", "/watched", number)
                proxy.getSystemState("/speaker")
        for number in range(10):
            proxy.unregisterPublisher(f"/node_{number}", f"/topic_{number}", f"http://127.0.0.1:9/{number}")


@attack
def many_calls_in_one(master: str) -> None:
    """Calls of thousands of calls, each of which takes the master some time or has a long response."""
    with xmlrpc.client.ServerProxy(master) as proxy:

        def all_of(count: int, method: str, *params: Any) -> None:
            calls = [{"methodName": method, "params": [str(each).format(n) for each in params]}
                     for n in range(count)]  # fmt: skip
            with suppress(OSError, http.client.HTTPException, xmlrpc.client.Error):
                proxy.system.multicall(calls)

        proxy.setParam("/node", "/large", ["x" * 1000] * 5000)
        uri = "http://127.0.0.1:9/{0}"
        for first in range(0, 4500, 1500):
            all_of(1500, "registerSubscriber", f"/node_{first}_{{0}}", "/crowd", "std_msgs/String", uri)
        all_of(1500, "unregisterPublisher", "/node_{0}", "/topic_{0}", uri)
        all_of(1500, "unregisterSubscriber", "/node_0_{0}", "/crowd", uri)
        all_of(60, "registerPublisher", "/speaker", "/crowd", "std_msgs/String", uri)
        all_of(60, "getSystemState", "/node")
        all_of(20, "getParam", "/node", "/")
        all_of(500, "system.multicall", "/node")
        all_of(3000, "subscribeParam", "/node_{0}", uri, "/watched")
        all_of(60, "setParam", "/speaker", "/watched/{0}", "{0}")


@attack
def large_parameters(master: str) -> None:
    """Parameters of up to 10 MB: many values, deep ones, long ones; each read again and again."""
    deep: Any = 1
    for _ in range(40):
        deep = {"a": deep}
    values: tuple[Any, ...] = (
        [0] * 100_000,
        {f"k{n}": n for n in range(30_000)},
        deep,
        "x" * 10_000_000,
        [[[]]] * 50_000,
    )
    with xmlrpc.client.ServerProxy(master) as proxy:
        for number, value in enumerate(values):
            with suppress(xmlrpc.client.Error):
                proxy.setParam("/hostile", f"/large/{number}", value)
                proxy.getParam("/hostile", "/")
                proxy.getParam("/hostile", "/large")
        proxy.deleteParam("/hostile", "/large")


# Masters


class Master:
    """Master that answers as it should until an attack replaces methods."""

    def __init__(self, port: int) -> None:
        self.calls: dict[str, int] = {}
        self.rpc = Rpc({}, port)
        self.honest: Methods = {
            "getSystemState": lambda *_: [[], [], []],
            "getTopicTypes": lambda *_: [],
            "subscribeParam": lambda *_: {},
            "registerSubscriber": lambda *_: [],
            "registerPublisher": lambda *_: [],
            "lookupNode": lambda *_: "http://127.0.0.1:9/",
            "getPid": lambda *_: 1,
        }
        self.rpc.methods = dict(self.honest)

    def for_a_while(self, methods: Methods, seconds: float = 2 * SECONDS, *, raw: bool = False) -> None:
        """Answer otherwise."""
        self.rpc.raw = raw
        self.rpc.methods = {**self.honest, **methods}
        time.sleep(seconds)
        self.rpc.raw = False
        self.rpc.methods = dict(self.honest)


MASTERS: dict[str, Callable[[Master], None]] = {}


def of_master(call: Callable[[Master], None]) -> Callable[[Master], None]:
    """Register an attack by a master."""
    MASTERS[call.__name__] = call
    return call


@of_master
def ten_thousand_topics(master: Master) -> None:
    """Ten thousand topics and services, each time others, whose publishers do not answer."""
    numbers = itertools.count()

    def state(*_: object) -> Any:
        turn = next(numbers)
        names = [f"/t{turn % 3}_{number}" for number in range(10_000)]
        return [[[name, ["/many"]] for name in names], [[name, [f"/n{i}"]] for i, name in enumerate(names)],
                [[f"{name}/s", ["/many"]] for name in names[:2000]]]  # fmt: skip

    def types(*_: object) -> Any:
        kinds = ("std_msgs/String", "unknown_msgs/Thing")
        return [[f"/t{turn}_{number}", kinds[number % 2]] for turn in range(3) for number in range(10_000)]

    master.for_a_while({"getSystemState": state, "getTopicTypes": types}, 3 * SECONDS)


@of_master
def one_crowded_topic(master: Master) -> None:
    """A hundred thousand publishers of the topics of this process, all silent."""
    nodes = [f"/node_{number}" for number in range(100_000)]
    uris = [f"http://127.0.0.1:9/{number}" for number in range(100_000)]
    state = [[["/one", nodes]], [["/large", nodes]], []]
    master.for_a_while({"getSystemState": lambda *_: state, "registerSubscriber": lambda *_: uris})


@of_master
def large_answers(master: Master) -> None:
    """Answers of 15 MB: many elements, deep ones, entities, one long text."""
    bodies = [body.replace(b"methodCall", b"methodResponse").replace(b"<methodName>getPid</methodName>", b"")
              for body in _bodies()]  # fmt: skip
    counts = itertools.count()
    rotate = lambda *_: bodies[next(counts) % len(bodies)]  # noqa: E731
    master.for_a_while(dict.fromkeys(master.honest, rotate), 6 * SECONDS)


@of_master
def endless_answers(master: Master) -> None:
    """Heads and bodies without an end, fast and slow, and garbage."""
    counts = itertools.count()

    def answer(*_: object) -> Iterator[bytes]:
        kind = next(counts) % 5
        start = b"HTTP/1.1 200 OK\r\n"
        if kind == 0:
            return itertools.chain([start], (b"X-%d: y\r\n" % number for number in itertools.count()))
        if kind == 1:
            return itertools.chain(
                [start + b"Transfer-Encoding: chunked\r\n\r\n"],
                itertools.repeat(b"10000\r\n" + b"x" * 65536 + b"\r\n"),
            )
        if kind == 2:
            return itertools.chain([start + b"\r\n"], itertools.repeat(b"<a>" * 20_000))
        if kind == 3:
            return slowly(start + b"Content-Length: 1000000\r\n\r\n" + b"<a>" * 1000)
        return iter([bytes(100_000)])

    def slowly(data: bytes) -> Iterator[bytes]:
        for byte in data:
            time.sleep(0.02)
            yield bytes([byte])

    master.for_a_while(dict.fromkeys(master.honest, answer), 5 * SECONDS, raw=True)


@of_master
def many_parameters(master: Master) -> None:
    """Fifty thousand parameters, again and again since the registrations are lost, and updates of many."""
    wide = {f"p{number}": {f"q{inner}": inner for inner in range(100)} for number in range(500)}
    uris: list[str] = []

    def subscribe(_caller: str, uri: str, _key: str) -> Any:
        uris.append(uri)
        return wide

    lost = itertools.count()
    # A master that forgets the registrations is asked for everything again.
    state = lambda *_: [[[f"/lost_{next(lost)}", ["/x"]]], [], []]  # noqa: E731
    soon(master.for_a_while, {"subscribeParam": subscribe, "getSystemState": state}, 3 * SECONDS)
    for number in itertools.chain(until_over(), until_over()):
        for uri in uris[-1:]:
            with suppress(OSError, xmlrpc.client.Error):
                call(uri, "paramUpdate", "/master", f"/p{number % 400}/", {f"q{n}": n for n in range(1000)})
        time.sleep(0.01)
    time.sleep(2 * SECONDS)


def still(connection: socket.socket) -> None:
    """Serve a subscriber as a publisher does."""
    connection.sendall(header(STRING))
    while True:
        connection.sendall(frame(frame(b"still here")))
        time.sleep(0.05)


def main() -> None:
    """Attack on request."""
    name, port = sys.argv[1], int(sys.argv[2])
    uri = f"http://127.0.0.1:{port}/"
    master = Master(port) if name in MASTERS else None
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.readline()
    if master is None:
        honest = Node(still)
        call(uri, "registerPublisher", "/honest", "/before", "std_msgs/String", honest.uri)
        ATTACKS[name](uri)
        with suppress(xmlrpc.client.Fault):  # Its tables may be full.
            call(uri, "registerPublisher", "/honest", "/still", "std_msgs/String", honest.uri)
    else:
        MASTERS[name](master)
        node = Node(still)
        master.honest |= {
            "getSystemState": lambda *_: [[["/still", ["/honest"]]], [], []],
            "getTopicTypes": lambda *_: [["/still", "std_msgs/String"]],
            "lookupNode": lambda *_: node.uri,
            "registerSubscriber": lambda _, topic, *__: [node.uri] if topic == "/still" else [],
        }
        master.rpc.methods = dict(master.honest)
    sys.stdout.write("done\n")
    sys.stdout.flush()
    sys.stdin.readline()


if __name__ == "__main__":
    main()
