from __future__ import annotations

import json
import os
import socket
import subprocess
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import anyio
import pytest
from websockets.sync.client import connect

from tests.processes import running
from tests.waiting import until

if TYPE_CHECKING:
    from tests.statements import Program

pytestmark = pytest.mark.anyio

#: Counts of this server's endpoints, as the program sees them.
_ENDPOINTS = """
result = [[len(node.get_publishers_info_by_topic(topic)), len(node.get_subscriptions_info_by_topic(topic))]
          for topic in ('/image', '/ours')]
"""
_IMAGES = """
from sensor_msgs.msg import Image
publisher = node.create_publisher(Image, '/image', qos.qos_profile_sensor_data)
image = Image(height=500, width=2000, step=2000, encoding='mono8', data=bytes(1_000_000))
timer = node.create_timer(0.03, lambda: publisher.publish(image))
"""
_SUBSCRIBE = json.dumps({"op": "subscribe", "topic": "/image", "type": "sensor_msgs/Image"})


def serving(
    *command: str,
) -> AbstractContextManager[tuple[subprocess.Popen[str], str]]:
    """A server of this process's ROS domain, and its address."""
    arguments = command or ("serve", "--graph", "ros2", "ws://127.0.0.1:0")
    environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}
    return running(*arguments, environment=environment, real=True, stderr=None)


def memory_of(process: subprocess.Popen[str]) -> int:
    """Resident bytes of a process."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * 4096


def descriptors_of(process: subprocess.Popen[str]) -> int:
    """Open descriptors of a process."""
    return len(os.listdir(f"/proc/{process.pid}/fd"))


def arenas_of(process: subprocess.Popen[str]) -> list[int]:
    """Addresses of the arenas of glibc's allocator but the main one; they begin at multiples of 64 MiB."""
    maps = Path(f"/proc/{process.pid}/maps").read_text().splitlines()
    private = [line.split() for line in maps if " rw-p 00000000 00:00 0 " in f"{line} "]
    addresses = [int(fields[0].partition("-")[0], 16) for fields in private]
    return [each for each in addresses if each % 2**26 == 0]


async def test_sigterm_ends_the_server_and_its_endpoints(program: Program) -> None:
    program.run(_IMAGES)
    with serving() as (process, url), connect(url, max_size=None) as client:
        client.send(_SUBSCRIBE)
        client.send(json.dumps({"op": "advertise", "topic": "/ours", "type": "std_msgs/String"}))
        client.recv(10)
        await until(lambda: program.run(_ENDPOINTS) == [[1, 1], [1, 0]])
        began = time.monotonic()
        process.terminate()
        assert process.wait(10) == 0
        assert time.monotonic() - began < 2
    await until(lambda: program.run(_ENDPOINTS) == [[1, 0], [0, 0]])
    nodes = "result = [name for name in node.get_node_names() if name not in ('program',)]"
    await until(lambda: not program.run(nodes))


@pytest.mark.extended
async def test_a_thousand_clients_leave_nothing_behind(program: Program) -> None:
    program.run(_IMAGES)
    advertise = json.dumps({"op": "advertise", "topic": "/ours", "type": "std_msgs/String"})
    figures = []
    with serving() as (process, url):
        for number in range(1000):
            with connect(url, max_size=None) as client:
                client.send(_SUBSCRIBE)
                client.send(advertise)
                if number % 10 == 0:
                    client.recv(10)
            if number in (299, 999):
                await until(lambda: program.run(_ENDPOINTS) == [[1, 0], [0, 0]])
                figures.append((memory_of(process), descriptors_of(process)))
    (memory, descriptors), (memory_later, descriptors_later) = figures
    assert descriptors_later == descriptors
    assert memory_later - memory < 8 * 2**20


async def test_threads_of_the_middleware_share_memory(program: Program) -> None:
    program.run(_IMAGES)
    with serving() as (process, url), connect(url, max_size=None) as client:
        client.send(_SUBSCRIBE)
        for _ in range(20):
            client.recv(10)
        assert len(arenas_of(process)) <= 2


async def test_a_stalled_client_of_large_images(program: Program) -> None:
    program.run(_IMAGES)
    with serving() as (process, url):
        host, port = url.removeprefix("ws://").rstrip("/").split(":")
        with socket.create_connection((host, int(port))) as stalled:
            key = "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            key += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
            stalled.sendall(key.encode())
            assert b"101" in stalled.recv(1000)
            request = _SUBSCRIBE.encode()
            stalled.sendall(bytes([0x81, 0x80 | len(request)]) + bytes(4) + request)
            await until(lambda: program.run("result = publisher.get_subscription_count()") == 1)
            await anyio.sleep(2)
            before = memory_of(process)
            slowest = 0.0
            for _ in range(20):
                began = time.monotonic()
                with connect(url, max_size=None) as client:
                    client.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time", "id": "x"}))
                    client.recv(10)
                slowest = max(slowest, time.monotonic() - began)
                await anyio.sleep(0.2)
            assert slowest < 1
            assert memory_of(process) - before < 16 * 2**20


async def test_the_server_starts_with_parameters_of_rosbridge_suite(program: Program) -> None:
    parameters = ("port:=0", "address:=127.0.0.1", "topics_glob:=['/allowed']", "delay_between_messages:=0.1")
    arguments = [option for each in parameters for option in ("-p", each)]
    with serving("ros2", "serve", "--ros-args", *arguments) as (_, url), connect(url) as client:
        for topic in ("/denied", "/allowed"):
            client.send(json.dumps({"op": "advertise", "topic": topic, "type": "std_msgs/String"}))
        await until(lambda: program.run("result = node.count_publishers('/allowed')") == 1)
        assert program.run("result = node.count_publishers('/denied')") == 0
