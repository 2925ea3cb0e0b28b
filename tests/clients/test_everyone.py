"""Everybody at once: one process, one port, one gate and one audit for roslib, Foxglove's client, an agent,
curl and a FastAPI app, each under its own role."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import anyio
import httpx
import pytest
from fastapi import FastAPI
from prometheus_client.parser import text_string_to_metric_families

from rwt import Server, connect
from rwt.access.gate.audit.file import read_audit
from tests.extensions.mcp.agents import agent_at
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.clients, pytest.mark.timeout(180)]

NODE = Path(__file__).parent / "node"
WORDS, DRIVE, WORD, TWIST = "/words", "/cmd_vel", "std_msgs/String", "geometry_msgs/Twist"
#: Who is there, with the gateway that each comes through.
EVERYBODY = {"page": "rosbridge", "viewer": "foxglove", "agent": "mcp", "script": "http", "shop": "rosbridge"}


def token_of(role: str) -> str:
    return f"the-secret-token-of-{role}"


def settings(audit: Path) -> dict[str, Any]:
    """Each may hear and say words, and drive; and publish on what is its own."""
    common = [WORDS, DRIVE]
    return {
        "gateways": ["foxglove", "http", "mcp"],
        "auth": {
            "default_role": "nobody",
            "tokens": {role: {"token": token_of(role), "role": role} for role in EVERYBODY},
        },
        "roles": {
            "nobody": {},
            **{role: {"subscribe": common, "publish": [*common, f"/of/{role}"]} for role in EVERYBODY},
        },
        "gate": {
            "rules": {"drive": {"topics": [DRIVE], "lease": {"seconds": 60}, "stop": {}, "emergency": True}},
            "audit": {"file": str(audit)},
        },
    }


def message_of(topic: str, word: str) -> dict[str, object]:
    return {"data": word} if topic == WORDS else {"linear": {"x": float(word)}}


def type_of(topic: str) -> str:
    return WORD if topic == WORDS else TWIST


class Client:
    """Somebody who hears words, says some, and is refused some things.

    Attributes:
        heard: words.
        refused: what it was told when it was refused something.
    """

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.refused: list[str] = []

    async def say(self, topic: str, word: str) -> None:
        """Publish a word, or a speed."""
        raise NotImplementedError


class Program(Client):
    """A program in Node; see `everyone.mjs`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        super().__init__()
        self._process = process

    async def say(self, topic: str, word: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{topic} {word}\n".encode())
        await self._process.stdin.drain()

    async def read(self, ready: anyio.Event) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            event = json.loads(line)
            self.heard += [event[name] for name in ("heard",) if name in event]
            self.refused += [event[name] for name in ("refused",) if name in event]
            if "ready" in event:
                ready.set()


class Agent(Client):
    """An agent; it hears a word for as long as it waits for one."""

    def __init__(self, mcp: Any) -> None:
        super().__init__()
        self._mcp = mcp

    async def say(self, topic: str, word: str) -> None:
        arguments = {"topic": topic, "message": message_of(topic, word), "type": type_of(topic)}
        result = await self._mcp.call_tool("publish", arguments)
        if result.is_error:
            self.refused.append(result.content[0].text)

    async def wait_for(self, word: str) -> None:
        """Hear a word."""
        arguments = {"topic": WORDS, "field": "data", "comparison": "==", "value": word, "timeout": 25}
        result = await self._mcp.call_tool("wait_for", arguments)
        assert not result.is_error, result.content[0].text
        self.heard.append(word)


class Script(Client):
    """curl: one that streams, and one for each word."""

    def __init__(self, url: str) -> None:
        super().__init__()
        self._url = url
        self._head = ("--silent", "--no-buffer", "--header", f"Authorization: Bearer {token_of('script')}")

    async def say(self, topic: str, word: str) -> None:
        body = json.dumps(message_of(topic, word))
        url = f"{self._url}/api/topics{topic}?type={type_of(topic)}"
        process = await asyncio.create_subprocess_exec(
            "curl", *self._head, "--data", body, url, stdout=asyncio.subprocess.PIPE
        )
        answer, _ = await process.communicate()
        if answer:
            self.refused.append(json.loads(answer)["detail"])

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[None]:
        """Hear words within the block."""
        url = f"{self._url}/api/topics{WORDS}"
        events = ("--header", "Accept: text/event-stream")
        process = await asyncio.create_subprocess_exec(
            "curl", *self._head, *events, url, stdout=asyncio.subprocess.PIPE
        )
        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(self._read, process)
                yield
                process.terminate()
        finally:
            if process.returncode is None:
                process.kill()
            await process.wait()

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            if line.startswith(b"data: "):
                self.heard.append(json.loads(line.removeprefix(b"data: "))["data"])


class Shop(Client):
    """A web shop of FastAPI at `/shop` of the robot's own port, which is a client of the robot as anybody."""

    def __init__(self) -> None:
        super().__init__()
        self.app = FastAPI()
        self.app.post("/say")(self._publish)
        self.app.get("/heard")(lambda: self.heard)
        self.url = ""
        self._robot: Any = None

    @asynccontextmanager
    async def open(self, url: str) -> AsyncIterator[None]:
        """Use the robot within the block, as the app's lifespan would."""
        self.url = url.replace("ws:", "http:")
        async with connect(url, headers={"Authorization": f"Bearer {token_of('shop')}"}) as self._robot:
            self._robot.on_event(self._note)
            self._robot.subscribe(WORDS, lambda message: self.heard.append(message.data), WORD)
            yield

    def _note(self, event: Any) -> None:
        if event.kind == "status":
            self.refused.append(event.text)

    def _publish(self, topic: str, word: str) -> None:
        self._robot.publish(topic, message_of(topic, word), type_of(topic))

    async def say(self, topic: str, word: str) -> None:
        async with httpx.AsyncClient() as browser:
            asked = {"topic": topic, "word": word}
            answer = await browser.post(f"{self.url}/shop/say", params=asked, timeout=20)
            assert answer.status_code == 200, answer.text


@asynccontextmanager
async def program(kind: str, role: str, url: str) -> AsyncIterator[Program]:
    process = await asyncio.create_subprocess_exec(
        "node",
        str(NODE / "everyone.mjs"),
        kind,
        f"{url}/?token={token_of(role)}",
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    client, ready = Program(process), anyio.Event()
    try:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(client.read, ready)
            with anyio.fail_after(90):
                await ready.wait()
            yield client
            assert process.stdin is not None
            process.stdin.close()
        assert await process.wait() == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


@asynccontextmanager
async def everybody(server: Server, shop: Shop) -> AsyncIterator[dict[str, Client]]:
    """Each of them, listening, by role; but for the agent, which listens when it is asked to."""
    url = server.urls[0]
    http = url.replace("ws:", "http:")
    script = Script(http)
    async with (
        program("roslib", "page", url) as page,
        program("foxglove", "viewer", url) as viewer,
        agent_at(f"{http}/mcp", token=token_of("agent")) as mcp,
        shop.open(url),
        script.listening(),
    ):
        yield {"page": page, "viewer": viewer, "agent": Agent(mcp), "script": script, "shop": shop}


async def test_everybody_at_once(tmp_path: Path) -> None:
    audit, shop = tmp_path / "audit.jsonl", Shop()
    async with Server("ws://127.0.0.1:0", demo=True, mounts={"/shop": shop.app}, **settings(audit)) as server:
        node = server.node("poet")
        words = node.advertise(WORDS, WORD)
        async with everybody(server, shop) as clients:
            await until(
                lambda: _listeners(server) >= {"/rosbridge_websocket", "/foxglove_bridge", "/http_bridge"}
            )
            await _hears_everybody(server, clients, words.publish)
            driven: list[object] = []
            node.subscribe(DRIVE, driven.append, TWIST)
            await _is_refused(clients, driven)
            _is_counted(server.metrics.text().decode())
            async with httpx.AsyncClient() as browser:
                assert (await browser.get(f"{shop.url}/shop/heard")).json() == shop.heard
    _is_in_the_audit(audit)


def _listeners(server: Server) -> set[str]:
    topic = server.graph.topic(WORDS)
    return set() if topic is None else {each.node for each in topic.subscribers}


async def _hears_everybody(
    server: Server, clients: dict[str, Client], robot: Callable[[dict[str, str]], object]
) -> None:
    """Every client receives the messages of the robot and of each other client."""
    agent = clients["agent"]
    assert isinstance(agent, Agent)
    for speaker in ("robot", *clients):
        word = f"said-by-{speaker}"
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(agent.wait_for, word)
            await until(lambda: "/mcp" in _listeners(server))
            if speaker == "robot":
                robot({"data": word})
            else:
                await clients[speaker].say(WORDS, word)
        await until(partial(_have_heard, clients.values(), word))
    said = [f"said-by-{speaker}" for speaker in ("robot", *clients)]
    assert all(client.heard == said for client in clients.values())
    assert not any(client.refused for client in clients.values())


async def _is_refused(clients: dict[str, Client], driven: list[object]) -> None:
    """Each may publish on what is its own and on nothing of the others; one drives, and the others do not."""
    roles = list(clients)
    for role, client in clients.items():
        await client.say(f"/of/{role}", "1")
        other = roles[roles.index(role) - 1]
        await client.say(f"/of/{other}", "1")
        await until(partial(_names, client.refused, ""))
        # Those who advertise are refused that first, and then what they publish.
        reason = client.refused[0]
        assert f"roles.{role}.publish" in reason and f"/of/{other}" in reason, reason
    for role, client in clients.items():
        if role != "page":
            await clients["page"].say(DRIVE, "0.125")
            await until(lambda: bool(driven))  # It holds the lease, from then on for a minute.
            driven.clear()
            await client.say(DRIVE, "0.5")
            await until(partial(_names, client.refused, "/cmd_vel is held by rosbridge:1 (role page)"))


def _names(reasons: list[str], reason: str) -> bool:
    return any(reason in each for each in reasons)


def _have_heard(clients: Iterable[Client], word: str) -> bool:
    return all(word in client.heard for client in clients)


def _is_counted(text: str) -> None:
    """The metrics tell the gateways apart."""
    counted = {
        (sample.name, sample.labels["gateway"]): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if set(sample.labels) == {"gateway"}
    }
    for gateway, clients in (("rosbridge", 2), ("foxglove", 1), ("http", 1), ("mcp", 1)):
        assert counted["rwt_connections_total", gateway] == clients, gateway
        assert counted["rwt_clients", gateway] == clients, gateway
        for name in ("received_messages", "received_bytes", "sent_messages", "sent_bytes"):
            assert counted[f"rwt_{name}_total", gateway] > 3, (name, gateway)
    topics = {
        (sample.labels["gateway"], sample.labels["topic"]): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == "rwt_topic_received_messages_total"
    }
    spoken = {gateway: topics[gateway, WORDS] for gateway in set(EVERYBODY.values())}
    assert spoken == {"rosbridge": 2, "foxglove": 1, "http": 1, "mcp": 1}


def _is_in_the_audit(file: Path) -> None:
    """One audit says of each what it did and what it was refused."""
    lines = list(read_audit(file))
    roles = list(EVERYBODY)
    for role, gateway in EVERYBODY.items():
        own = [line for line in lines if line.get("role") == role]
        assert {str(line["client"]).partition(":")[0] for line in own} == {gateway}
        done = {(line["decision"], line["name"]) for line in own if line["act"] == "publish"}
        assert ("allowed", WORDS) in done and ("allowed", f"/of/{role}") in done
        assert ("refused", f"/of/{roles[roles.index(role) - 1]}") in done
        drives = {decision for decision, name in done if name == DRIVE}
        assert ("refused" in drives) == (role != "page"), (role, drives)
