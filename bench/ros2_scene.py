"""A robot like a TurtleBot with everything that may be connected to it, for an hour: `make ros2-scene`.

Every sensor is a ROS 2 program of its own: odometry at 50 Hz, a laser scanner at 10 Hz, a camera at 30 Hz,
transforms at 50 Hz if `tf2_msgs` is installed, and a base that reads `/cmd_vel`. One server joins them, with
a gate. A browser shows the dashboard with the camera by WebRTC, a Foxglove client reads all sensors and
reconnects again and again, an agent looks and drives over MCP, and an operator drives too fast. The program
of a sensor or of the base is restarted at an interval, in turn with a farewell and by SIGKILL.

Memory, descriptors and threads of the server and its endpoints are noted. Exits with 1 if they have grown, if
a client has received too little, if a topic does not come back to its clients after a restart, or if the base
was ever faster than the gate permits. Memory is judged from ten minutes on; a shorter run shows only
that the scene works.
"""

from __future__ import annotations

import argparse
import itertools
import json
import logging
import os
import re
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import anyio
import anyio.to_thread
import websockets
from websockets.typing import Subprotocol

from rwt_client import connect
from tests.browser.driver import Page, find_browser, opened_browser
from tests.core.access.driver import mcp_session
from tests.extensions.ros2.live.domains import free_domain
from tests.processes import running
from tests.statements import Program
from tests.waiting import until


class Sensor(NamedTuple):
    """Topic of one program.

    Attributes:
        fill: statements that set the values of `message`.
        qos: profile, or depth of a reliable one.
    """

    hertz: int
    type: str
    fill: str
    qos: str


SENSORS: Final = {
    "/odom": Sensor(50, "nav_msgs/msg/Odometry", "message.twist.twist.linear.x = 0.1", "10"),
    "/scan": Sensor(
        10,
        "sensor_msgs/msg/LaserScan",
        "message.ranges = [1.25 + i / 100 for i in range(360)]; message.angle_increment = 0.0174",
        "qos.qos_profile_sensor_data",
    ),
    "/camera": Sensor(
        30,
        "sensor_msgs/msg/Image",
        "message.data = bytes(range(256)) * 900; message.height, message.width, message.step = 240, 320, 960;"
        " message.encoding = 'rgb8'",
        "qos.qos_profile_sensor_data",
    ),
    "/tf": Sensor(
        50,
        "tf2_msgs/msg/TFMessage",
        "from geometry_msgs.msg import TransformStamped\n"
        "message.transforms = [TransformStamped(child_frame_id='base_link')]\n"
        "message.transforms[0].header.frame_id = 'odom'",
        "100",
    ),
}

_PUBLISH: Final = """
from {package}.msg import {name}
message = {name}()
{fill}
publisher = node.create_publisher({name}, '{topic}', {qos})
timer = node.create_timer(1 / {hertz}, lambda: publisher.publish(message))
"""
_BASE: Final = """
from geometry_msgs.msg import Twist
speeds = []
subscription = node.create_subscription(Twist, '/cmd_vel', lambda m: speeds.append(m.linear.x), 10)
"""
COMMANDS: Final = "/cmd_vel"
_SPEEDS: Final = "result = [len(speeds), max(map(abs, speeds), default=0.0)]"
_ENDPOINTS: Final = """
result = sum(node.count_publishers(name) + node.count_subscribers(name)
             for name, _ in node.get_topic_names_and_types())
"""

FASTEST: Final = 0.3
"""Speed that the gate permits, in m/s."""

SETTINGS: Final = f"""
gateways = ["foxglove", "http", "mcp"]
mcp = {{ default_role = "admin" }}
webrtc = {{ enabled = true }}

[gate.rules.drive]
topics = ["/cmd_vel"]
emergency = true
lease = {{ seconds = 0.5 }}
stop = {{ repeat_seconds = 1 }}

[gate.rules.drive.fields]
"linear.x" = {{ min = -{FASTEST}, max = {FASTEST}, beyond = "clamp" }}
"""

SETTLED_FROM_SECONDS: Final = 600.0
"""Length of the runs whose memory and threads are judged: until then caches and pools fill."""
_ERROR: Final = re.compile(r" (ERROR|CRITICAL) |^Traceback")

_SETTLE_SECONDS: Final = 240.0
"""Timeout of the first message of each client: a busy machine starts programs slowly."""

WARM_UP: Final = 0.25
"""Share of the time after which figures count."""
ROOM_BYTES: Final = 8 * 2**20
"""Growth of memory that counts as flat: what an allocator may keep."""
LEAST: Final = 0.2
"""Share of the messages that a client must receive: a busy machine drops some."""
BACK_SECONDS: Final = 30.0
"""Time in which a topic comes back after a restart: the lease of a killed program, and a reconnection."""


@dataclass(frozen=True, slots=True)
class Sample:
    """The server at one time; `memory` is in bytes."""

    after: float
    memory: int
    files: int
    threads: int
    endpoints: int


@dataclass
class Scene:
    """What has happened so far.

    Attributes:
        received: messages by client and topic, and answers of the robot to the agent.
        speeds: number of commands that the base has received, and the fastest.
        errors: lines of the server's log that report errors.
        restarts: seconds that each topic took to come back after a restart of its program.
        lost: topics that have not come back.
    """

    samples: list[Sample] = field(default_factory=list)
    received: Counter[str] = field(default_factory=Counter)
    speeds: tuple[int, float] = (0, 0.0)
    errors: list[str] = field(default_factory=list)
    restarts: list[float] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    def verdict(self, seconds: float, topics: list[str], *, has_browser: bool) -> list[str]:
        """Return what is wrong, in words."""
        wrong = [*self.errors, *(f"{each} has not come back after a restart" for each in self.lost)]
        for topic in topics:
            least = SENSORS[topic].hertz * seconds * LEAST
            if self.received[f"Foxglove {topic}"] < least:
                wrong.append(f"Foxglove has received fewer than {least:.0f} messages of {topic}")
        wanted = ["agent", "operator", *(["dashboard", "camera by WebRTC"] if has_browser else [])]
        wrong += [f"{each} has received nothing" for each in wanted if not self.received[each]]
        count, fastest = self.speeds
        if not count or fastest > FASTEST:
            wrong.append(f"the base has received {count} commands, up to {fastest} m/s")
        settled = [each for each in self.samples if each.after >= seconds * WARM_UP]
        third = max(1, len(settled) // 3)
        early, late = settled[:third], settled[-third:]
        # Clients come and go: what has grown is never as little as before.
        is_long = seconds >= SETTLED_FROM_SECONDS
        for name in ("files", "endpoints", *(["threads"] if is_long else [])):
            before = max(getattr(each, name) for each in early)
            after = min(getattr(each, name) for each in late)
            if after > before:
                wrong.append(f"{name} have grown from {before} to {after}")
        before, after = (max(each.memory for each in part) for part in (early, late))
        if is_long and after - before > ROOM_BYTES:
            wrong.append(f"memory has grown from {before:,} to {after:,} bytes")
        return wrong


@contextmanager
def _program(statements: str) -> Iterator[Program]:
    with closing(
        Program(sys.executable, "tests.extensions.ros2.live.program", environment=dict(os.environ))
    ) as program:
        program.run(statements)
        yield program


class Robot:
    """Programs of the robot, which can be restarted.

    Attributes:
        sensors: running programs by topic.
        base: program that reads `/cmd_vel`.
    """

    def __init__(self, stack: ExitStack) -> None:
        self._stacks: dict[str, ExitStack] = {}
        self._speeds: list[tuple[int, float]] = []
        stack.callback(self._stop)
        self.sensors: dict[str, Program] = {}
        self.base = self._start(COMMANDS, _BASE)
        for topic, sensor in SENSORS.items():
            try:
                self.sensors[topic] = self._start(topic, _publishing(topic))
            except RuntimeError as error:
                if "ModuleNotFoundError" not in str(error):
                    raise
                print(f"{topic} is left out: {sensor.type.partition('/')[0]} is not installed")

    def _stop(self) -> None:
        for each in self._stacks.values():
            each.close()

    def _start(self, topic: str, statements: str) -> Program:
        self._stacks[topic] = ExitStack()
        return self._stacks[topic].enter_context(_program(statements))

    def restart(self, topic: str, *, kill: bool) -> None:
        """Restart the program of a topic, after a farewell or by SIGKILL."""
        program = self.base if topic == COMMANDS else self.sensors[topic]
        if topic == COMMANDS:
            self._speeds.append(tuple(program.run(_SPEEDS)))
        if kill:
            program.kill()
        self._stacks[topic].close()
        if topic == COMMANDS:
            self.base = self._start(topic, _BASE)
        else:
            self.sensors[topic] = self._start(topic, _publishing(topic))

    def speeds(self) -> tuple[int, float]:
        """Return the number of commands that the base has received, and the fastest."""
        found = [*self._speeds, tuple(self.base.run(_SPEEDS))]
        return sum(count for count, _ in found), max(fastest for _, fastest in found)


def _publishing(topic: str) -> str:
    hertz, type, fill, qos = SENSORS[topic]
    package, _, name = type.split("/")
    return _PUBLISH.format(package=package, name=name, fill=fill, topic=topic, hertz=hertz, qos=qos)


def _received(robot: Robot, scene: Scene, topic: str) -> int:
    """Return how many messages of a topic have arrived: at Foxglove, or commands at the base."""
    return int(robot.base.run(_SPEEDS)[0]) if topic == COMMANDS else scene.received[f"Foxglove {topic}"]


def _has_more(robot: Robot, scene: Scene, topic: str, before: int) -> bool:
    return _received(robot, scene, topic) > before


async def _restarts(robot: Robot, scene: Scene, interval: float) -> None:
    """Restart one program after the other, and note how long its topic takes to come back."""
    for number in itertools.count():
        await anyio.sleep(interval)
        topics = [*robot.sensors, COMMANDS]
        topic = topics[number % len(topics)]
        await anyio.to_thread.run_sync(partial(robot.restart, topic, kill=number % 2 == 1))
        before, began = _received(robot, scene, topic), time.monotonic()
        is_back = partial(_has_more, robot, scene, topic, before)
        try:
            await until(is_back, seconds=BACK_SECONDS)
        except TimeoutError:
            scene.lost.append(topic)
        else:
            scene.restarts.append(round(time.monotonic() - began, 1))


async def _foxglove(url: str, scene: Scene, topics: list[str]) -> None:
    """Read all sensors, with a new connection every twenty seconds."""
    protocol = Subprotocol("foxglove.sdk.v1")
    while True:
        names: dict[int, str] = {}
        async with websockets.connect(url, subprotocols=[protocol], max_size=None) as socket:
            with anyio.move_on_after(20):
                async for data in socket:
                    if isinstance(data, bytes):
                        if data[0] == 1:
                            scene.received[f"Foxglove {names[struct.unpack_from('<I', data, 1)[0]]}"] += 1
                        continue
                    message = json.loads(data)
                    if message["op"] != "advertise":
                        continue
                    new = [each for each in message["channels"] if each["topic"] in topics]
                    names |= {each["id"]: each["topic"] for each in new}
                    wanted = [{"id": each["id"], "channelId": each["id"]} for each in new]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


async def _agent(url: str, scene: Scene) -> None:
    """Look at the robot and drive it for a moment, every few seconds."""
    tools: list[tuple[str, dict[str, Any]]] = [
        ("read_topic", {"topic": "/odom"}),
        ("get_image", {"topic": "/camera"}),
        ("publish", {"topic": "/cmd_vel", "message": {"linear": {"x": 0.2}}, "seconds": 0.3}),
    ]
    rpc = await anyio.to_thread.run_sync(mcp_session, url)
    while True:
        for name, arguments in tools:
            call = {"name": name, "arguments": arguments}
            await anyio.to_thread.run_sync(rpc, "tools/call", call, abandon_on_cancel=True)
            scene.received["agent"] += 1
        await anyio.sleep(3)


async def _operator(url: str, scene: Scene) -> None:
    """Drive too fast for a second, every five, on a connection that is new each time."""
    while True:
        async with connect(url) as robot:
            topic = robot.advertise("/cmd_vel", "geometry_msgs/Twist")
            robot.subscribe("/odom", lambda _: scene.received.update(["operator"]), "nav_msgs/Odometry")
            await topic
            for _ in range(20):
                topic.publish({"linear": {"x": 5.0}})
                await anyio.sleep(0.05)
        await anyio.sleep(4)


async def _dashboard(page: Page, url: str, scene: Scene) -> None:
    """Show the dashboard; the camera is shown by WebRTC."""
    camera = r"/WebRTC · [1-9][0-9.]* Hz/.test(document.body.innerText)"
    kinds: dict[str, dict[str, object]] = {
        "camera": {"topic": "/camera"},
        "topics": {"topic": "/odom"},
        "plot": {"lines": [{"topic": "/odom", "path": "twist.twist.linear.x"}]},
    }
    panels = [{"id": kind, "kind": kind, "config": config} for kind, config in kinds.items()]
    layout = json.dumps({"version": 1, "panels": panels, "dock": None})
    key = f"rwt-last-layout{url.replace('http', 'ws', 1)}"
    page.forgive("")  # What the page says is not measured here.
    await page.evaluate(f"localStorage.setItem({json.dumps(key)}, {json.dumps(layout)})")
    await page.goto(url)
    while True:
        if await page.evaluate("!!document.querySelector('.state-open')"):
            scene.received["dashboard"] += 1
        if await page.evaluate(camera):
            scene.received["camera by WebRTC"] += 1
        await anyio.sleep(0.5)


@asynccontextmanager
async def _browser_page(url: str) -> AsyncIterator[Page | None]:
    """A page of Chromium, or None without Chromium."""
    kind = find_browser()
    if kind is None:
        print("the dashboard is left out: Chromium is not installed")
        yield None
        return
    with tempfile.TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as browser:
        async with browser.page(f"{url}healthz", width=900, height=700) as page:
            yield page


async def run(seconds: float, interval: float, restart: float) -> tuple[Scene, list[str]]:
    """Run the scene; return what has happened, and what is wrong with it."""
    scene = Scene()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "robot.toml").write_text(SETTINGS, encoding="utf-8")
        watcher = stack.enter_context(_program(""))
        robot = Robot(stack)
        topics = [*robot.sensors]
        arguments = ("serve", "--graph", "ros2", "ws://127.0.0.1:0", "--config", f"{folder}/robot.toml")
        environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}
        log = stack.enter_context((folder / "log").open("w+", encoding="utf-8"))
        try:
            server, url = stack.enter_context(
                running(*arguments, environment=environment, real=True, stderr=log.fileno())
            )
        except AssertionError:
            log.seek(0)
            print(log.read())
            raise
        http = url.replace("ws", "http", 1).rstrip("/") + "/"
        async with _browser_page(http) as page, anyio.create_task_group() as tasks:
            tasks.start_soon(_foxglove, url, scene, topics)
            tasks.start_soon(_agent, url, scene)
            tasks.start_soon(_operator, url, scene)
            if page is not None:
                tasks.start_soon(_dashboard, page, http, scene)
            wanted = [f"Foxglove {topic}" for topic in topics]
            wanted += ["agent", "operator", *(["camera by WebRTC"] if page is not None else [])]

            def missing() -> list[str]:
                return [each for each in wanted if not scene.received[each]]

            try:
                await until(lambda: not missing(), seconds=_SETTLE_SECONDS)
            except TimeoutError:
                raise TimeoutError(f"these have received nothing: {', '.join(missing())}") from None
            scene.received.clear()
            if restart:
                tasks.start_soon(_restarts, robot, scene, restart)
            began = time.monotonic()
            while (after := time.monotonic() - began) < seconds:
                scene.samples.append(_sample(after, server.pid, watcher))
                print(json.dumps(_figures(scene)), flush=True)
                await anyio.sleep(interval)
            scene.speeds = robot.speeds()
            log.seek(0)
            scene.errors = [line.strip() for line in log if _ERROR.search(line)]
            tasks.cancel_scope.cancel()
    return scene, scene.verdict(seconds, topics, has_browser=page is not None)


def _sample(after: float, pid: int, watcher: Program) -> Sample:
    process = Path(f"/proc/{pid}")
    memory = int((process / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    files, threads = (sum(1 for _ in (process / each).iterdir()) for each in ("fd", "task"))
    return Sample(after, memory, files, threads, watcher.run(_ENDPOINTS))


def _figures(scene: Scene) -> dict[str, Any]:
    last = scene.samples[-1]
    return {
        "seconds": round(last.after),
        "MB": round(last.memory / 1e6, 1),
        "files": last.files,
        "threads": last.threads,
        "endpoints": last.endpoints,
        **scene.received,
    }


def main() -> int:
    """Run the scene, print figures, and say what is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=3600.0, help="length of the run")
    parser.add_argument("--interval", type=float, default=20.0, help="seconds between two samples")
    parser.add_argument(
        "--restart", type=float, default=60.0, help="seconds between two restarts; 0 for none"
    )
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(free_domain()))
    logging.basicConfig(level=logging.ERROR)  # The gate's warnings for the operator are expected.
    scene, wrong = anyio.run(run, arguments.seconds, arguments.interval, arguments.restart)
    print(f"the base: {scene.speeds[0]:,} commands, up to {scene.speeds[1]} m/s")
    print(f"{len(scene.restarts)} restarts; seconds until a topic came back: {sorted(scene.restarts)}")
    print("\n".join(wrong) or "nothing has grown, and every client was served")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
