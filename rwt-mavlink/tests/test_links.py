"""Links of the operating system: UDP beside pymavlink and MAVProxy, TCP, a serial port, a real autopilot."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from subprocess import STDOUT
from typing import Any, Final

import anyio
import anyio.to_thread
import pytest
from pymavlink import mavutil

from rwt import Server
from rwt_graph import MemoryGraph, Node
from rwt_mavlink import MavlinkSettings, Station
from rwt_mavlink.link.addresses import LinkAddress, parse_link
from rwt_mavlink.link.frames import dialect
from rwt_mavlink.simulation.vehicle import GUIDED, SimulatedVehicle
from rwt_participant.errors import CallFailed
from tests.waiting import until, until_answered

pytestmark = pytest.mark.anyio

PATIENCE: Final = 60.0


@contextmanager
def flying(vehicle: SimulatedVehicle, exchange: Callable[[bytes], bytes]) -> Iterator[SimulatedVehicle]:
    """Run a vehicle in a thread; `exchange` sends its frames and returns what arrived."""
    ended, started = threading.Event(), time.monotonic()

    def run() -> None:
        while not ended.is_set():
            vehicle.step(time.monotonic() - started)
            frames, vehicle.outbox = b"".join(vehicle.outbox), []
            if data := exchange(frames):
                vehicle.receive(data)

    thread = threading.Thread(target=run, name="vehicle")
    thread.start()
    try:
        yield vehicle
    finally:
        ended.set()
        thread.join()


@contextmanager
def udp_vehicle(*stations: int, px4: bool = False) -> Iterator[SimulatedVehicle]:
    """A vehicle that sends to ports of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.settimeout(0.01)

        def exchange(frames: bytes) -> bytes:
            for port in stations:
                if frames:
                    udp.sendto(frames, ("127.0.0.1", port))
            with suppress(TimeoutError, ConnectionRefusedError):
                return udp.recv(65536)
            return b""

        with flying(SimulatedVehicle(px4=px4), exchange) as vehicle:
            vehicle.parameters.values |= {f"P{number:03}": number for number in range(100)}
            yield vehicle


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture
async def user() -> AsyncIterator[Node]:
    async with MemoryGraph() as graph:
        yield Node(graph, "user")


async def connected(user: Node) -> None:
    heard: list[Any] = []
    user.subscribe("/mavros/state", heard.append, "mavros_msgs/State")
    await until(lambda: heard and heard[-1].connected)


async def test_udp_beside_the_station_of_pymavlink(user: Node) -> None:
    """Both upload and read the same plans and parameters; neither sees the other's answers as its own."""
    ours, theirs = free_port(), free_port()
    peer = mavutil.mavlink_connection(f"udpin:127.0.0.1:{theirs}", source_system=254, source_component=190)
    try:
        with udp_vehicle(ours, theirs) as vehicle:
            async with Station(user.graph, MavlinkSettings(link=f"udp://127.0.0.1:{ours}")):
                await connected(user)
                beat = await anyio.to_thread.run_sync(lambda: peer.wait_heartbeat(timeout=PATIENCE))
                assert beat is not None and beat.autopilot == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
                waypoints = [
                    {"frame": 3, "command": 16, "x_lat": 47.0 + number * 1e-5, "z_alt": 5.0}
                    for number in range(9)
                ]
                pushed = await user.call("/mavros/mission/push", {"waypoints": waypoints}, timeout=PATIENCE)
                assert pushed.wp_transfered == 9
                items = await anyio.to_thread.run_sync(downloaded, peer)
                assert [each.x for each in items] == [round(each["x_lat"] * 1e7) for each in waypoints]
                peer.mav.param_set_send(1, 1, b"P042", 4242.0, dialect.MAV_PARAM_TYPE_INT32)
                await until(lambda: vehicle.parameters.values["P042"] == 4242)
                pulled = await user.call("/mavros/param/pull", {"force_pull": True}, timeout=PATIENCE)
                assert pulled.param_received == len(vehicle.parameters.values)
                assert await user.params.get("/mavros/param:P042") == 4242
                peer.mav.command_long_send(1, 1, dialect.MAV_CMD_DO_SET_SERVO, 0, 1, 1100, 0, 0, 0, 0, 0)
                assert (await user.call("/mavros/cmd/arming", {"value": True}, timeout=PATIENCE)).success
                assert vehicle.is_armed
    finally:
        peer.close()


def downloaded(peer: Any) -> list[Any]:
    """Download a mission by pymavlink."""
    deadline = time.monotonic() + PATIENCE
    peer.mav.mission_request_list_send(1, 1)
    count = peer.recv_match(type="MISSION_COUNT", blocking=True, timeout=PATIENCE).count
    items: list[Any] = []
    while len(items) < count:
        assert time.monotonic() < deadline
        peer.mav.mission_request_int_send(1, 1, len(items))
        item = peer.recv_match(type="MISSION_ITEM_INT", blocking=True, timeout=1)
        if item is not None and item.seq == len(items):
            items.append(item)
    return items


@asynccontextmanager
async def mavproxy(port: int, folder: Path) -> AsyncIterator[tuple[Callable[[str], Any], bytearray]]:
    """Run MAVProxy; yields a function that types a line into its console, and its output."""
    modules = "cmdlong,param,ftp,wp,mode,arm,misc"
    command = [os.environ["MAVLINK_MAVPROXY"], f"--master=udpin:127.0.0.1:{port}", "--source-system=254"]
    options = ["--source-component=191", f"--default-modules={modules}", f"--state-basedir={folder}"]
    environment = {**os.environ, "HOME": str(folder)}
    output = bytearray()
    async with await anyio.open_process(
        [*command, *options], stderr=STDOUT, env=environment, cwd=folder
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        console, lines = process.stdin, process.stdout

        async def read() -> None:
            async for piece in lines:
                output.extend(piece)

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(read)
            yield lambda line: console.send(f"{line}\n".encode()), output
            process.kill()


@pytest.mark.skipif("MAVLINK_MAVPROXY" not in os.environ, reason="needs MAVProxy at MAVLINK_MAVPROXY")
async def test_udp_beside_mavproxy(user: Node, tmp_path: Path) -> None:
    """A ground station by others uses the same vehicle: plans, parameters, modes and commands are exact."""
    ours, theirs = free_port(), free_port()
    waypoints = [{"frame": 3, "command": 16, "x_lat": 47.0 + n * 1e-5, "z_alt": 5.0} for n in range(9)]
    plan = [f"{n}\t0\t3\t16\t0\t0\t0\t0\t47.3977{n}\t8.5455\t{10 + n}\t1" for n in range(4)]
    (tmp_path / "plan.txt").write_text("\n".join(["QGC WPL 110", *plan, ""]))
    with udp_vehicle(ours, theirs) as vehicle:
        async with (
            Station(user.graph, MavlinkSettings(link=f"udp://127.0.0.1:{ours}")),
            mavproxy(theirs, tmp_path) as (enter, output),
        ):
            await connected(user)
            await user.call("/mavros/mission/push", {"waypoints": waypoints}, timeout=PATIENCE)
            count = f"Received {len(vehicle.parameters.values)} parameters".encode()
            await until(lambda: count in output, seconds=PATIENCE)

            await enter("wp list")
            await until(lambda: b"Saved 9 waypoints to " in output, seconds=PATIENCE)
            saved = [line.split("\t")[8] for line in (tmp_path / "way.txt").read_text().splitlines()[1:]]
            assert [float(each) for each in saved] == [round(each["x_lat"], 7) for each in waypoints]

            await enter("param set P042 4242")
            await until(lambda: vehicle.parameters.values["P042"] == 4242, seconds=PATIENCE)
            await enter(f"wp load {tmp_path / 'plan.txt'}")
            await until(lambda: vehicle.plans.uploads == 2, seconds=PATIENCE)
            heard: list[Any] = []
            user.subscribe("/mavros/mission/waypoints", heard.append)
            assert (await user.call("/mavros/mission/pull", timeout=PATIENCE)).wp_received == 4
            await until(lambda: heard and len(heard[-1].waypoints) == 4)
            assert [round(each.x_lat, 5) for each in heard[-1].waypoints[1:]] == [
                47.39771,
                47.39772,
                47.39773,
            ]
            await user.call("/mavros/param/pull", {"force_pull": True}, timeout=PATIENCE)
            assert await user.params.get("/mavros/param:P042") == 4242

            await enter("mode GUIDED")
            await until(lambda: vehicle.mode == GUIDED, seconds=PATIENCE)
            assert (await user.call("/mavros/cmd/arming", {"value": True}, timeout=PATIENCE)).success
            await until(lambda: b"ARMED" in output, seconds=PATIENCE)
            await enter("takeoff 8")
            await until(lambda: vehicle.position[2] < -7.5, seconds=PATIENCE)
    flown = Counter((each.station.system, each.command) for each in vehicle.executed)
    assert flown[255, dialect.MAV_CMD_COMPONENT_ARM_DISARM] == flown[254, dialect.MAV_CMD_NAV_TAKEOFF] == 1


async def test_a_server_with_the_setting(user: Node) -> None:
    port = free_port()
    table = {"link": f"udp://127.0.0.1:{port}", "namespace": "/drone"}
    with udp_vehicle(port, px4=True):
        async with Server("ws://127.0.0.1:0", mavlink=table) as server:
            robot = server.node("user")
            heard: list[Any] = []
            robot.subscribe("/drone/state", heard.append, "mavros_msgs/State")
            await until(lambda: heard and heard[-1].connected)
            assert heard[-1].mode == "STABILIZED"


async def test_tcp_is_opened_again(user: Node) -> None:

    async def arms() -> bool:
        with suppress(CallFailed):  # Not connected, or another vehicle than before.
            return bool((await user.call("/mavros/cmd/arming", {"value": True}, timeout=PATIENCE)).success)
        return False

    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        async with Station(user.graph, MavlinkSettings(link=f"tcp://127.0.0.1:{port}")):
            for _ in range(2):
                accepted, _ = await anyio.to_thread.run_sync(listener.accept)
                with accepted:
                    accepted.settimeout(0.01)

                    def exchange(frames: bytes, tcp: socket.socket = accepted) -> bytes:
                        tcp.sendall(frames)
                        with suppress(TimeoutError):
                            return tcp.recv(65536)
                        return b""

                    with flying(SimulatedVehicle(), exchange) as vehicle:
                        await until_answered(arms)
                        assert vehicle.is_armed


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
async def test_a_serial_port(user: Node) -> None:
    vehicle_end, port = os.openpty()
    os.set_blocking(vehicle_end, False)

    def exchange(frames: bytes) -> bytes:
        with suppress(BlockingIOError):
            os.write(vehicle_end, frames)
        with suppress(BlockingIOError):
            return os.read(vehicle_end, 65536)
        time.sleep(0.01)
        return b""

    try:
        with flying(SimulatedVehicle(), exchange) as vehicle:
            async with Station(user.graph, MavlinkSettings(link=f"serial://{os.ttyname(port)}:57600")):
                await connected(user)
                arming = await user.call("/mavros/cmd/arming", {"value": True}, timeout=PATIENCE)
                assert arming.success and vehicle.is_armed
    finally:
        os.close(vehicle_end)
        os.close(port)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udp://0.0.0.0:14550", LinkAddress("listen", "0.0.0.0", 14550)),
        ("udp://:14540", LinkAddress("listen", "127.0.0.1", 14540)),
        ("udp://@10.0.0.2:14555", LinkAddress("udp", "10.0.0.2", 14555)),
        ("udp://@[fe80::1]:1", LinkAddress("udp", "fe80::1", 1)),
        ("tcp://sitl", LinkAddress("tcp", "sitl", 5760)),
        ("serial:///dev/ttyACM0:115200", LinkAddress("serial", "/dev/ttyACM0", 115200)),
        ("serial://COM3", LinkAddress("serial", "COM3", 57600)),
    ],
)
def test_addresses(text: str, address: LinkAddress) -> None:
    assert parse_link(text) == address


@pytest.mark.parametrize(
    "text", ["udp", "http://x", "udp://@", "tcp://", "udp://a:99999", "serial://", "udp://a b"]
)
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ValueError, match="is no link: expected"):
        parse_link(text)


@pytest.mark.skipif(
    "MAVLINK_LINK" not in os.environ, reason="needs an autopilot, such as a SITL, at MAVLINK_LINK"
)
@pytest.mark.timeout(600)
async def test_a_real_autopilot(user: Node) -> None:
    """A plan and parameters arrive exactly; the vehicle arms, takes off and lands. Only for a simulation."""
    async with Station(user.graph, MavlinkSettings(link=os.environ["MAVLINK_LINK"])):
        await connected(user)
        states: list[Any] = []
        heights: list[float] = []
        user.subscribe("/mavros/state", states.append)
        user.subscribe("/mavros/global_position/rel_alt", lambda message: heights.append(message.data))
        pulled = await user.call("/mavros/param/pull", {"force_pull": True}, timeout=300)
        assert pulled.success and pulled.param_received > 100
        fix = await user.once("/mavros/global_position/global", timeout=300)
        waypoints = [
            {"frame": 3, "command": 16, "autocontinue": True, "x_lat": fix.latitude, "y_long": fix.longitude,
             "z_alt": 10.0 + number} for number in range(5)
        ]  # fmt: skip
        assert (await user.call("/mavros/mission/push", {"waypoints": waypoints}, timeout=300)).success
        assert (await user.call("/mavros/mission/pull", timeout=300)).wp_received == 5
        is_px4 = states[-1].mode in ("MANUAL", "ALTCTL", "POSCTL") or states[-1].mode.startswith("AUTO.")
        mode = {"custom_mode": "AUTO.TAKEOFF" if is_px4 else "GUIDED"}

        async def accepted(service: str, request: dict[str, Any]) -> bool:
            answer = await user.call(service, request, timeout=60)
            return bool(getattr(answer, "success", getattr(answer, "mode_sent", False)))

        await until_answered(lambda: accepted("/mavros/set_mode", mode), seconds=300)
        await until_answered(lambda: accepted("/mavros/cmd/arming", {"value": True}), seconds=300)
        if not is_px4:
            assert await accepted("/mavros/cmd/takeoff", {"altitude": 5.0})
        await until(lambda: heights and heights[-1] > 2.0, seconds=120)
        await user.call("/mavros/cmd/land", timeout=60)
        await until(lambda: not states[-1].armed, seconds=180)
