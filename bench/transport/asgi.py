"""CPU time of a delivery and a request through ASGI servers, compared with the own driver.

``python -m bench.transport.asgi`` prints a table. Each server runs in a process of its own; a robot in it
publishes small messages to a number of clients, and answers requests for one value.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager
from http.client import HTTPConnection
from typing import Any, Final

from websockets.asyncio.client import ClientConnection, connect

from rwt import LATCHED, Message, Server

SERVERS: Final = ("own driver", "uvicorn", "hypercorn")
CLIENTS: Final = 20
MESSAGES: Final = 2000
REQUESTS: Final = 1000

_robot = Server(web={"enabled": False})
_node = _robot.node("robot")
_node.advertise("/label", "std_msgs/String", qos=LATCHED).publish({"data": "it is here"})
_talker = _node.advertise("/count", "std_msgs/Int32")


async def _count(request: Message) -> dict[str, object]:
    """Publish messages, one in each turn of the event loop and 1 ms."""
    for number in range(MESSAGES):
        _talker.publish({"data": number})
        await asyncio.sleep(0.001)
    return {"success": True}


_node.advertise_service("/start", "std_srvs/Trigger", _count)


def serve(kind: str, port: int) -> None:
    """Serve the robot until the process is ended."""
    if kind == "own driver":
        server = Server(f"ws://127.0.0.1:{port}", graph=_robot.graph, web={"enabled": False})
        server.run()
    elif kind == "uvicorn":
        import uvicorn

        uvicorn.run(app, host="127.0.0.1", port=port, log_level="warning", access_log=False)
    else:
        from hypercorn.asyncio import serve as run
        from hypercorn.config import Config

        config = Config()
        config.bind = [f"127.0.0.1:{port}"]
        asyncio.run(run(app, config))


#: Any, since each server has types of its own for ASGI.
app: Any = _robot.asgi() if sys.argv[1:2] != ["own driver"] else None


@contextmanager
def running(kind: str) -> Iterator[int]:
    """A server in a process of its own; its port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    command = [sys.executable, "-m", "bench.transport.asgi", kind, str(port)]
    with subprocess.Popen(command, env=os.environ, stdout=subprocess.DEVNULL) as process:
        try:
            while not _listens(port):
                if process.poll() is not None:
                    raise RuntimeError(f"{kind} ended with {process.returncode}")
            yield port
        finally:
            process.terminate()


def _listens(port: int) -> bool:
    try:
        urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=1).close()
    except (OSError, urllib.error.URLError):
        return False
    return True


def cpu_seconds(port: int) -> float:
    """CPU time that the server has used."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
        found = re.search(rb"^process_cpu_seconds_total (\S+)$", answer.read(), re.MULTILINE)
    assert found is not None
    return float(found[1])


async def deliveries(port: int) -> float:
    """Microseconds of CPU for one message to one client."""
    async with AsyncExitStack() as stack:
        url = f"ws://127.0.0.1:{port}/"
        clients = [await stack.enter_async_context(connect(url, compression=None)) for _ in range(CLIENTS)]
        for client in clients:
            await client.send('{"op": "subscribe", "topic": "/count"}')
            await client.send('{"op": "call_service", "service": "/rosapi/get_time", "id": "ready"}')
            await client.recv()
        before = cpu_seconds(port)
        starter = await stack.enter_async_context(connect(url))
        await starter.send('{"op": "call_service", "service": "/start", "timeout": 0}')
        await asyncio.gather(*(_all_of(client) for client in clients))
        return (cpu_seconds(port) - before) / (CLIENTS * MESSAGES) * 1e6


async def _all_of(client: ClientConnection) -> None:
    while json.loads(await client.recv())["msg"]["data"] < MESSAGES - 1:
        pass


def requests(port: int) -> float:
    """Microseconds of CPU for one request of one value."""
    before = cpu_seconds(port)
    connection = HTTPConnection("127.0.0.1", port)
    for _ in range(REQUESTS):
        connection.request("GET", "/api/topics/label")
        connection.getresponse().read()
    connection.close()
    return (cpu_seconds(port) - before) / REQUESTS * 1e6


def main() -> None:
    """Measure each, or be one of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("server", nargs="?", choices=SERVERS, help="serve this one instead, on PORT")
    parser.add_argument("port", nargs="?", type=int)
    options = parser.parse_args()
    if options.server is not None:
        serve(options.server, options.port)
        return
    print(f"{'':12} {'µs each delivery':>18} {'µs each request':>18}")
    for kind in SERVERS:
        with running(kind) as port:
            print(f"{kind:12} {asyncio.run(deliveries(port)):18.1f} {requests(port):18.0f}")


if __name__ == "__main__":
    main()
