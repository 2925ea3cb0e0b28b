"""Driving over data channels whose link is lost and restored, at random."""

from __future__ import annotations

import asyncio
import json
import random
import time
from contextlib import AsyncExitStack
from typing import Any

import httpx
import pytest
from aiortc import RTCDataChannel

from rwt import Server
from rwt.settings.models import Settings
from rwt_webrtc.settings import WebRtcSettings
from tests.waiting import until
from tests.webrtc.peers import OtherSide, other_side

pytestmark = [pytest.mark.anyio, pytest.mark.extended]

LEASE = 0.5
PERIOD = 0.05
DRIVERS = 12
STALLS = 3
TWIST = "geometry_msgs/TwistStamped"


class Driver:
    """Client that sends a command every 50 ms over a link that may be lost.

    Attributes:
        speed: speed that the client's control asks for.
        heard: commands that reached the robot, with their times.
        is_lost: True while no datagram passes.
    """

    def __init__(self, number: int, channel: RTCDataChannel) -> None:
        self.topic = f"/drive{number}"
        self.speed = 0.0
        self.heard: list[tuple[float, float]] = []
        self.is_lost = False
        self._channel = channel

    def hear(self, twist: Any) -> None:
        self.heard.append((time.monotonic(), twist.twist.linear.x))

    def moved_since(self, moment: float) -> list[float]:
        """Return the speeds other than zero that reached the robot after a time."""
        return [speed for at, speed in self.heard if at >= moment and speed]

    def cut(self, other: OtherSide) -> None:
        """Let the link of a peer pass datagrams only while it is not lost."""
        assert other.connection.sctp is not None
        agent: Any = other.connection.sctp.transport.transport.iceGatherer._connection
        for protocol in agent._protocols:
            socket, receive = protocol.transport, protocol.datagram_received
            send = socket.sendto
            socket.sendto = lambda *datagram, send=send: self.is_lost or send(*datagram)
            protocol.datagram_received = lambda *datagram, receive=receive: self.is_lost or receive(*datagram)

    async def send(self) -> None:
        """Send commands with their times until cancelled, as the dashboard does."""
        while True:
            now = time.time_ns()
            header = {"stamp": {"sec": now // 10**9, "nanosec": now % 10**9}}
            twist = {"header": header, "twist": {"linear": {"x": self.speed}}}
            message = {"op": "publish", "topic": self.topic, "type": TWIST, "msg": twist}
            self._channel.send(json.dumps(message))
            await asyncio.sleep(PERIOD)

    async def grip(self) -> None:
        """Let the control go, and take it, until the robot moves: a channel may take seconds to recover."""
        began = time.monotonic()
        while not self.moved_since(began):
            assert began > time.monotonic() - 60, self.topic
            self.speed = 0.0
            await asyncio.sleep(0.5)
            self.speed = 0.3
            await asyncio.sleep(0.5)

    async def drive(self, random_: random.Random) -> None:
        """Drive, and lose the link now and then: no command of before drives the robot afterwards."""
        for _ in range(STALLS):
            await self.grip()
            await asyncio.sleep(random_.uniform(0.1, 1))
            self.is_lost, lost = True, time.monotonic()
            await asyncio.sleep(random_.uniform(LEASE + 0.3, 1.2))
            if random_.random() < 0.5:
                # Released, and taken again while nothing arrives.
                self.speed = 0.0
                await asyncio.sleep(0.2)
                self.speed = 0.4
                await asyncio.sleep(LEASE + 0.2)
            self.is_lost = False
            await asyncio.sleep(random_.uniform(1, 3))
            assert not self.moved_since(lost + LEASE), self.topic


async def test_commands_of_before_a_lost_link_do_not_drive_the_robot() -> None:
    rules = {
        f"drive{number}": {"topics": [f"/drive{number}"], "lease": {"seconds": LEASE}, "stop": {}}
        for number in range(DRIVERS)
    }
    webrtc = WebRtcSettings(enabled=True, peers=2 * DRIVERS, handshakes=2 * DRIVERS)
    settings = Settings.model_validate({"listen": ("ws://127.0.0.1:0",), "gate": {"rules": rules}})
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(Server(settings=settings, webrtc=webrtc))
        client = await stack.enter_async_context(httpx.AsyncClient(timeout=60))
        url, headers = (
            f"{server.urls[0].replace('ws', 'http', 1)}/webrtc",
            {"Content-Type": "application/sdp"},
        )
        wheels = server.node("wheels")
        drivers: list[Driver] = []
        for number in range(DRIVERS):
            other = await stack.enter_async_context(other_side())
            channel = (
                other.connection.createDataChannel("ordered")
                if number % 2
                else other.connection.createDataChannel("lossy", ordered=False, maxRetransmits=0)
            )
            driver = Driver(number, channel)
            wheels.subscribe(driver.topic, driver.hear, TWIST)
            answer = await client.post(url, content=await other.offer(), headers=headers)
            assert answer.status_code == 201, answer.text
            await other.take_answer(answer.text)
            await until(lambda: channel.readyState == "open")  # noqa: B023 - in this round
            driver.cut(other)
            drivers.append(driver)
        sending = [asyncio.create_task(driver.send()) for driver in drivers]
        try:
            await asyncio.gather(*(each.drive(random.Random(seed)) for seed, each in enumerate(drivers)))
        finally:
            for task in sending:
                task.cancel()
