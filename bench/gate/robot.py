"""Server with a gate, whose robot publishes when it heard which speed, and the longest turn before.

`python -m bench.gate.robot FOLDER [HUB]` writes the URLs of its listeners to `urls.json` in the folder, and
dials the hub.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

import uvicorn

from bench.message.holds import TimedSelector
from rwt import Server, Settings
from rwt.cli.commands.serve import BoundedGarbageCollection
from rwt.rosbridge import Bridge
from rwt_transports.listener import listen

TOKEN: Final = "operator-of-the-benchmark"
ASKER_TOKEN: Final = "asker-of-the-benchmark"
ATTACKER_TOKEN: Final = "attacker-of-the-benchmark"
PRESSER_TOKEN: Final = "presser-of-the-benchmark"
URLS: Final = "urls.json"
LEASE_SECONDS: Final = 0.2
TWIST: Final = "geometry_msgs/Twist"
LIST: Final = "std_msgs/Float64MultiArray"


def _driven(seconds: float, *topics: str) -> dict[str, object]:
    lease = {"seconds": seconds, "precedence": ["operator"]}
    return {"topics": topics, "type": TWIST, "emergency": True, "lease": lease, "stop": {"repeat_seconds": 0}}


def _gate(folder: Path) -> dict[str, object]:
    rules = {
        # The lease must not end while the emergency stop is measured.
        "stopped": _driven(60.0, "/stopped"),
        "leased": _driven(LEASE_SECONDS, "/leased"),
        "globs": _driven(60.0, "/x/*"),
        "range": {"topics": ["/range"], "type": LIST, "fields": {"data[]": {"min": -1, "max": 1}}},
        "clamp": {
            "topics": ["/clamp"],
            "type": LIST,
            "fields": {"data[]": {"min": -1, "max": 1, "beyond": "clamp"}},
        },
        "asked": {
            "topics": ["/asked"],
            "type": "std_msgs/String",
            "services": ["/reset", "/confirm"],
            "approval": {"roles": ["operator"]},
        },
    }
    emergency = {"stop_roles": ["operator", "presser"], "release_roles": ["operator"]}
    return {"rules": rules, "emergency": emergency, "audit": {"file": str(folder / "audit.jsonl")}}


class _Base:
    """Robot on one topic; it publishes speed, time, and the longest turn since its last message."""

    def __init__(self, heard: Any, turns: TimedSelector) -> None:
        self._heard = heard
        self._turns = turns
        self._speed = 0.0

    def on_command(self, command: Any) -> None:
        """Note a velocity that differs from the last one."""
        now = time.monotonic()
        if command.linear.x != self._speed:
            self._speed = command.linear.x
            self._heard.publish({"data": [self._speed, now, self._turns.longest]})
            self._turns.longest = 0.0


async def main(folder: Path, turns: TimedSelector, hubs: Sequence[str]) -> None:
    """Serve until a signal."""
    rights = {act: ["*"] for act in ("publish", "subscribe", "call", "goals", "provide", "set_param")}
    tokens = {"operator": TOKEN, "asker": ASKER_TOKEN, "agent": ATTACKER_TOKEN, "presser": PRESSER_TOKEN}
    server = Server(
        "ws://127.0.0.1:0",
        "tcp://127.0.0.1:0",
        f"unix://{folder}/socket",
        "udp://127.0.0.1:0",
        nodes=("rosapi",),
        gateways=("foxglove", "http", "mcp"),
        gate=_gate(folder),
        roles=dict.fromkeys(tokens, rights) | {"presser": {"read_only": True}},
        # Operators over TCP, Unix sockets and UDP have no token.
        auth={
            "default_role": "operator",
            "tokens": {role: {"token": token, "role": role} for role, token in tokens.items()},
        },
        webrtc={"enabled": True},
        dial={"urls": tuple(f"{hub}/robots/robot" for hub in hubs)},
    )
    asgi = uvicorn.Server(uvicorn.Config(server.asgi(), log_level="critical", lifespan="off"))
    ended = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(server)
        bson = Bridge(server.graph, Settings(bson_only_mode=True), server.bridge.access)
        bson_listener = await stack.enter_async_context(listen("ws://127.0.0.1:0", bson.accept, bson=True))
        tasks = await stack.enter_async_context(asyncio.TaskGroup())
        asgi_socket = socket.create_server(("127.0.0.1", 0))
        tasks.create_task(asgi.serve([asgi_socket]))
        urls = {"bson": bson_listener.url, "asgi": f"ws://127.0.0.1:{asgi_socket.getsockname()[1]}"}
        urls |= {url.partition(":")[0]: url for url in server.urls}
        (folder / URLS).write_text(json.dumps(urls), encoding="utf-8")
        robot = server.node("base")
        robot.advertise_service("/reset", "std_srvs/Trigger", lambda request: {"success": True})
        confirmed = robot.advertise("/heard/confirm", LIST)

        def confirm(request: object) -> dict[str, object]:
            confirmed.publish({"data": [time.monotonic()]})
            return {"success": True}

        robot.advertise_service("/confirm", "std_srvs/Trigger", confirm)
        for topic in ("/stopped", "/leased"):
            base = _Base(robot.advertise(f"/heard{topic}", LIST), turns)
            robot.subscribe(topic, base.on_command, TWIST)
        print("listening on", *server.urls, flush=True)
        BoundedGarbageCollection(asyncio.get_running_loop().call_soon).begin()
        await ended.wait()
        asgi.should_exit = True


if __name__ == "__main__":
    selector = TimedSelector()
    with asyncio.Runner(loop_factory=partial(asyncio.SelectorEventLoop, selector)) as runner:
        runner.run(main(Path(sys.argv[1]), selector, sys.argv[2:]))
