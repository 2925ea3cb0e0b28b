"""A bare loop between ROS 2 and sockets: `python -m bench.peers.ros2_floor TOPIC TYPE`.

It waits as this project's graph does, takes each sample as bytes and sends one prepared frame to every
client. No message is converted, and nothing else is done: a server in Python on the same middleware and
kernel takes longer. It shakes hands as WebSocket does, and ignores what clients send.
"""

from __future__ import annotations

import os
import re
import select
import signal
import socket
import sys
from base64 import b64encode
from hashlib import sha1

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from bench.peers.bare_loop import ACCEPTED
from rwt.extensions.ros2 import add_installed
from rwt.extensions.ros2.qos import to_ros
from rwt.extensions.ros2.rcl import raw_take
from rwt.extensions.ros2.type_supports.selection import type_supports
from rwt.extensions.ros2.wakeups import Wakeup, load_rcl
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.qos import QoS


def _accept(listener: socket.socket) -> socket.socket:
    client, _ = listener.accept()
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    request = b""
    while b"\r\n\r\n" not in request:
        request += client.recv(4096)
    found = re.search(rb"Sec-WebSocket-Key: (\S+)", request, re.I)
    assert found is not None
    key = b64encode(sha1(found[1] + ACCEPTED).digest())
    client.sendall(
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + key + b"\r\n\r\n"
    )
    return client


def serve(topic: str, type_name: str) -> None:
    """Forward a topic until SIGTERM."""
    registry = Registry()
    add_installed(registry)
    type = registry.message(type_name)
    rclpy.init()
    node = rclpy.create_node("floor", start_parameter_services=False)
    made = type_supports().message(type)
    subscription = _rclpy.Subscription(node.handle, made, topic, to_ros(QoS(depth=10)))
    waiting = select.epoll()
    descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
    wakeup = Wakeup("subscription", subscription, lambda _: False, descriptor)
    waiting.register(descriptor, select.EPOLLIN | select.EPOLLET)
    assert wakeup.set_callback(load_rcl())
    with socket.create_server(("127.0.0.1", 0), backlog=100) as listener:
        waiting.register(listener.fileno(), select.EPOLLIN)
        print(f"listening on ws://127.0.0.1:{listener.getsockname()[1]}", flush=True)
        clients: dict[int, socket.socket] = {}
        take, frame = raw_take(), b""
        while True:
            for descriptor, _ in waiting.poll():
                if descriptor == listener.fileno():
                    client = _accept(listener)
                    clients[client.fileno()] = client
                    continue
                while (sample := take(subscription)) is not None:
                    frame = frame or _frame(topic, Payload.relayed_cdr(type, sample.data))
                    for number, client in list(clients.items()):
                        try:
                            client.sendall(frame)
                        except ConnectionError:
                            clients.pop(number).close()


def _frame(topic: str, payload: Payload) -> bytes:
    text = b'{"op":"publish","topic":"%s","msg":%s}' % (topic.encode(), bytes(payload.json()))
    size = len(text)
    if size < 126:
        return b"\x81" + bytes([size]) + text
    return b"\x81" + (b"\x7e" + size.to_bytes(2) if size < 2**16 else b"\x7f" + size.to_bytes(8)) + text


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    serve(*sys.argv[1:])
