"""Faults of the link: loss, gaps, duplicates, delays, restarts, two stations, ids that clash.

`MAVLINK_SECONDS=3600 pytest -s rwt-mavlink/tests/test_faults.py -k random` draws scenarios for an hour, and
prints their seeds; `MAVLINK_SEED=7` repeats one.
"""

from __future__ import annotations

import os
import random
import time
from collections import Counter
from typing import Any, Final

import anyio
import pytest
from pymavlink.generator.mavcrc import x25crc

from rwt_mavlink.link.frames import FrameWriter, dialect
from rwt_mavlink.protocol.missions import Plan
from rwt_mavlink.simulation.air import Weather
from rwt_mavlink.simulation.vehicle import GUIDED, RTL, SimulatedVehicle
from rwt_participant.errors import CallFailed

pytestmark = pytest.mark.anyio

BAD: Final = Weather(loss=0.3, duplicates=0.1, delay=0.3, gap_every=15.0, gap_seconds=2.0)
TWO: Final = [{"component": 191}, {"component": 190}]

#: A repeated command, and one that is sent once.
INTERVAL: Final = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
SERVO: Final = dialect.MAV_CMD_DO_SET_SERVO


class Scenario:
    """Random work of two stations at one vehicle over a bad link; all numbers are unique."""

    def __init__(self, world: Any, seed: int) -> None:
        self.world = world
        self.dice = random.Random(seed)
        self.number = 0
        self.accepted: list[tuple[int, int]] = []
        self.plans: list[list[Any]] = []
        self.failures: Counter[str] = Counter()

    async def work(self, station: int, rounds: int) -> None:
        works = [self.command, self.command, self.set_parameter, self.push, self.pull]
        for _ in range(rounds):
            try:
                await self.dice.choice(works)(station)
            except CallFailed as error:
                self.failures[type(error).__name__ + str(error)[:40]] += 1

    async def command(self, station: int) -> None:
        self.number += 1
        number, command = self.number, self.dice.choice((INTERVAL, SERVO))
        request = {"command": command, "param1": 9.0, "param2": float(number)}
        answer = await self.world.ask("/mavros/cmd/command", request, station)
        assert answer.success
        self.accepted.append((command, number))

    async def set_parameter(self, station: int) -> None:
        # Each station has parameters of its own: with common ones, each would undo what the other confirmed.
        self.number += 1
        name, number = f"S{station}_{self.dice.randrange(5)}", self.number
        value = {"type": 2, "integer_value": number}
        answer = await self.world.ask("/mavros/param/set", {"param_id": name, "value": value}, station)
        assert answer.value.integer_value == number
        assert self.world.vehicle.parameters.values[name] == number

    async def push(self, station: int) -> None:
        count = self.dice.randrange(1, 12)
        self.number += 1
        waypoints = [
            {"frame": 3, "command": 16, "param1": float(self.number), "x_lat": 0.001 * n, "z_alt": float(n)}
            for n in range(count)
        ]
        answer = await self.world.ask("/mavros/mission/push", {"waypoints": waypoints}, station)
        assert answer.wp_transfered == count
        self.plans.append([(float(self.number), n) for n in range(count)])

    async def pull(self, station: int) -> None:
        uploads = self.world.vehicle.plans.uploads
        answer = await self.world.ask("/mavros/mission/pull", {}, station)
        if self.world.vehicle.plans.uploads == uploads:
            assert answer.wp_received == len(self.world.vehicle.plans.plans[Plan.MISSION])

    async def restart(self, seconds: float) -> None:
        await self.world.user.clock.sleep(seconds)
        self.world.vehicle.restart()

    def check(self) -> None:
        """No command was executed twice; what was confirmed was executed, exactly."""
        executed = Counter((each.command, int(each.parameters[1])) for each in self.world.vehicle.executed)
        assert max(executed.values(), default=0) <= 1, "a repetition was executed as a new command"
        missing = [each for each in self.accepted if each not in executed]
        assert not missing, "confirmed, and not executed"
        plan = [(item.param1, round(item.z)) for item in self.world.vehicle.plans.plans[Plan.MISSION]]
        assert not plan or [each[1] for each in plan] == list(range(len(plan)))
        assert len({each[0] for each in plan}) <= 1, "items of two plans are mixed"


async def scenario(world: Any, seed: int, rounds: int = 12) -> Scenario:
    dice = random.Random(seed)
    vehicle = SimulatedVehicle(px4=dice.random() < 0.3)
    vehicle.parameters.values |= {f"S{station}_{n}": 0 for station in (0, 1) for n in range(5)}
    async with world(vehicle, seed=seed, settings=TWO) as opened:
        opened.air.weather = Weather(
            loss=dice.uniform(0, 0.3), duplicates=0.1, delay=dice.uniform(0, 0.3), gap_every=15.0
        )
        found = Scenario(opened, seed)

        async def work() -> None:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(found.work, 0, rounds)
                tasks.start_soon(found.work, 1, rounds)
                for _ in range(dice.randrange(3)):
                    tasks.start_soon(found.restart, dice.uniform(0, 60))

        await opened.air.during(work, 7200.0)
        opened.air.weather = Weather()
        await opened.air.run(15.0)
        found.check()
    return found


@pytest.mark.parametrize("seed", range(6))
async def test_random_work_of_two_stations(world: Any, seed: int) -> None:
    found = await scenario(world, seed)
    assert found.accepted


@pytest.mark.skipif("MAVLINK_SECONDS" not in os.environ, reason="runs as long as MAVLINK_SECONDS says")
@pytest.mark.timeout(0)
async def test_random_scenarios_for_a_while(world: Any) -> None:
    until = time.monotonic() + float(os.environ["MAVLINK_SECONDS"])
    seed = int(os.environ.get("MAVLINK_SEED", random.SystemRandom().randrange(2**32)))
    total: Counter[str] = Counter()
    while True:
        print(f"seed {seed}", flush=True)  # noqa: T201 - it repeats a scenario that failed
        found = await scenario(world, seed)
        total["scenarios"] += 1
        total["accepted"] += len(found.accepted)
        total["plans"] += len(found.plans)
        total["failed calls"] += sum(found.failures.values())
        if "MAVLINK_SEED" in os.environ or time.monotonic() > until:
            break
        seed = (seed + 1) % 2**32
    print(dict(total))  # noqa: T201


async def test_a_repetition_counts_up(flight: Any) -> None:
    """The acknowledgement is lost: the vehicle executes the command once, and confirms its repetition."""
    flight.air.weather = Weather(loss=0.4)
    for number in range(10):
        request = {"command": INTERVAL, "param2": float(number + 1)}
        try:
            await flight.call("/mavros/cmd/command", request)
        except CallFailed as error:
            assert "whether it executed the command is not known" in str(error)
    counted = Counter(int(each.parameters[1]) for each in flight.vehicle.executed)
    assert set(counted.values()) == {1}
    assert any(each.confirmation > 0 for each in flight.vehicle.executed)


async def test_a_late_acknowledgement_does_not_answer_the_next_command(flight: Any) -> None:
    """Arming is confirmed late and twice; a disarming that the vehicle rejects must not seem accepted."""
    flight.vehicle.mode, flight.vehicle.position = GUIDED, (0.0, 0.0, -10.0)
    flight.air.weather = Weather(delay=0.0)
    received, flight.vehicle.receive = flight.vehicle.receive, lambda data: None
    held: list[bytes] = []
    flight.vehicle.receive = held.append
    outcome: list[Any] = []

    async def arm_and_disarm() -> None:
        outcome.append(await flight.ask("/mavros/cmd/arming", {"value": True}))
        outcome.append(await flight.ask("/mavros/cmd/arming", {"value": False}))

    async def late() -> None:
        await flight.user.clock.sleep(2.5)
        for data in held:
            received(data)
        flight.vehicle.receive = received

    async def both() -> None:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(arm_and_disarm)
            tasks.start_soon(late)

    await flight.air.during(both)
    assert [each.result for each in outcome] == [0, dialect.MAV_RESULT_DENIED]
    assert flight.vehicle.is_armed


async def test_a_restart_ends_what_waits_and_repeats_nothing(flight: Any) -> None:
    received = flight.vehicle.receive

    def restart(data: bytes) -> None:
        received(data)
        if flight.vehicle.executed and not flight.vehicle.restarts:
            flight.vehicle.outbox.clear()  # The acknowledgement is lost.
            flight.vehicle.restart()

    flight.vehicle.receive = restart
    with pytest.raises(CallFailed, match="restarted before it answered"):
        await flight.call("/mavros/cmd/command", {"command": INTERVAL, "param2": 5.0})
    await flight.air.run(5.0)
    assert len(flight.vehicle.executed) == 1
    assert (await flight.call("/mavros/cmd/arming", {"value": True})).success


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("end", ["client", "link", "station"])
async def test_no_motion_after_the_operator_is_lost(world: Any, seed: int, end: str) -> None:
    vehicle = SimulatedVehicle()
    vehicle.parameters.values["FS_GCS_ENABLE"] = 0
    async with world(vehicle, seed=seed) as opened:
        vehicle.mode, vehicle.is_armed, vehicle.position = GUIDED, True, (0.0, 0.0, -10.0)
        opened.air.weather = BAD
        velocity = {"linear": {"x": 1.0}}
        for _ in range(60):
            opened.user.publish(
                "/mavros/setpoint_velocity/cmd_vel_unstamped", velocity, "geometry_msgs/Twist"
            )
            await opened.air.run(0.1)
        assert vehicle.position[1] > 1.0
        if end == "link":
            opened.air.antennas[0].is_cut = True
        elif end == "station":
            await opened.stack.aclose()
        await opened.air.run(4.0)
        place = vehicle.position
        await opened.air.run(20.0)
        assert vehicle.position == place and vehicle.velocity == (0.0, 0.0, 0.0)


async def test_the_failsafe_acts_when_the_station_is_lost(flight: Any) -> None:
    flight.vehicle.mode, flight.vehicle.is_armed, flight.vehicle.position = GUIDED, True, (30.0, 0.0, -10.0)
    await flight.air.run(3.0)
    assert flight.vehicle.mode == GUIDED
    flight.air.antennas[0].is_cut = True
    await flight.air.run(8.0)
    assert flight.vehicle.mode == RTL


async def test_two_vehicles_with_one_id_are_not_commanded(world: Any) -> None:
    vehicles = SimulatedVehicle(1), SimulatedVehicle(1)
    async with world(*vehicles) as opened:
        await opened.air.run(4.0)
        reports = opened.hear("/diagnostics")
        with pytest.raises(CallFailed, match="two vehicles use the system id 1"):
            await opened.call("/mavros/cmd/arming", {"value": True})
        opened.user.publish(
            "/mavros/setpoint_velocity/cmd_vel_unstamped", {"linear": {"x": 1.0}}, "geometry_msgs/Twist"
        )
        await opened.air.run(3.0)
        assert not any(each.executed or each.setpoints for each in vehicles)
        assert "two vehicles" in " ".join(each.message for report in reports for each in report.status)
        opened.air.vehicles.pop()
        await opened.air.run(15.0)
        assert (await opened.call("/mavros/cmd/arming", {"value": True})).success


async def test_a_station_with_the_same_ids_is_noticed(flight: Any) -> None:
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    flight.air.antennas[0].arrive(FrameWriter(255, 191).encode(beat), "elsewhere")
    await flight.air.run(0.2)
    with pytest.raises(CallFailed, match="another ground station has the system id 255"):
        await flight.call("/mavros/cmd/arming", {"value": True})
    await flight.air.run(11.0)
    assert (await flight.call("/mavros/cmd/arming", {"value": True})).success


async def test_garbage_does_not_end_the_link(flight: Any) -> None:
    dice = random.Random(5)
    for _ in range(300):
        flight.air.antennas[0].arrive(dice.randbytes(dice.randrange(1, 300)), "elsewhere")
    frame = FrameWriter(1, 1).encode(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
    for length in range(1, len(frame)):
        flight.air.antennas[0].arrive(frame[:length], "elsewhere")
    await flight.air.run(1.0)
    assert (await flight.call("/mavros/cmd/arming", {"value": True})).success


async def test_every_message_with_extreme_fields(flight: Any, caplog: pytest.LogCaptureFixture) -> None:
    """A message of the network, with whatever values, neither ends the link nor raises."""
    dice = random.Random(3)
    for number, kind in dialect.mavlink_map.items():
        if kind.msgname == "HEARTBEAT":
            continue
        for _ in range(3):
            size = kind.unpacker.size
            extreme = dice.choice((b"\xff", b"\0", b"\x7f\x80", b"\x80\x7f", b"AB")) * size
            payload = dice.choice((dice.randbytes(size), extreme[:size]))
            flight.air.antennas[0].arrive(_frame(number, kind.crc_extra, payload), 0)
        await flight.air.run(0.05)
    assert not [each for each in caplog.records if each.levelname == "ERROR"]
    await flight.air.run(15.0)
    assert (await flight.call("/mavros/cmd/arming", {"value": True})).success


def _frame(number: int, extra: int, payload: bytes) -> bytes:
    """A frame of MAVLink 2 of system 1, component 1."""
    body = bytes([len(payload), 0, 0, 0, 1, 1]) + number.to_bytes(3, "little") + payload
    crc: int = x25crc(body + bytes([extra])).crc
    return b"\xfd" + body + crc.to_bytes(2, "little")
