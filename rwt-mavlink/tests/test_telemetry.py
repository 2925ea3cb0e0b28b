"""Topics of a vehicle: names, types and axes of mavros; link loss and the failsafe in words."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rwt_mavlink.simulation.vehicle import GUIDED, HOME, SimulatedVehicle

pytestmark = pytest.mark.anyio


async def test_state_and_position(flight: Any) -> None:
    states, fixes = flight.hear("/mavros/state"), flight.hear("/mavros/global_position/global")
    poses, batteries = flight.hear("/mavros/local_position/pose"), flight.hear("/mavros/battery")
    flight.vehicle.position = (3.0, 1.0, -10.0)
    flight.vehicle.mode, flight.vehicle.is_armed = GUIDED, True
    flight.vehicle.target = (3.0, 1.0, -10.0)
    await flight.air.run(3.0)
    assert (states[-1].connected, states[-1].armed, states[-1].mode) == (True, True, "GUIDED")
    assert fixes[-1].latitude == pytest.approx(HOME[0] + 3 / 111_319.5, abs=2e-7)
    assert fixes[-1].altitude == pytest.approx(HOME[2] + 10, abs=0.01)
    position, turned = poses[-1].pose.position, poses[-1].pose.orientation
    assert (position.x, position.y, position.z) == pytest.approx((1.0, 3.0, 10.0))
    # The vehicle points north, which is a quarter turn from east.
    assert (turned.w, turned.z) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert poses[-1].header.frame_id == "map" and poses[-1].header.stamp.sec > 1_767_225_600
    assert batteries[-1].voltage == pytest.approx(12.4) and batteries[-1].percentage == pytest.approx(0.87)


async def test_px4_modes(world: Any) -> None:
    vehicle = SimulatedVehicle(px4=True)
    async with world(vehicle) as opened:
        states = opened.hear("/mavros/state")
        vehicle.mode = GUIDED
        await opened.air.run(2.0)
        assert states[-1].mode == "OFFBOARD"


async def test_link_loss_states_the_failsafe(flight: Any) -> None:
    states, reports = flight.hear("/mavros/state"), flight.hear("/diagnostics")
    lines = flight.hear("/rosout")
    await flight.air.run(3.0)
    failsafe = "after 5 s without its ground station the autopilot returns to launch (FS_GCS_ENABLE = 1"
    assert failsafe in " ".join(each.message for report in reports for each in report.status)
    flight.air.antennas[0].is_cut = True
    await flight.air.run(8.0)
    assert not states[-1].connected
    last = {each.name: each for report in reports for each in report.status}
    assert last["mavros: link"].level == b"\x02" or last["mavros: link"].level == 2
    assert "nothing was heard for" in last["mavros: link"].message
    assert any("link to the vehicle is lost" in each.msg and failsafe in each.msg for each in lines)
    flight.air.antennas[0].is_cut = False
    await flight.air.run(3.0)
    assert states[-1].connected


async def test_several_vehicles_have_namespaces(world: Any) -> None:
    vehicles = SimulatedVehicle(1), SimulatedVehicle(7), SimulatedVehicle(9)
    async with world(*vehicles, settings=[{"systems": (1, 7)}]) as opened:
        vehicles[1].position = (0.0, 0.0, -7.0)
        heights = (
            opened.hear("/uav1/mavros/local_position/pose"),
            opened.hear("/uav7/mavros/local_position/pose"),
        )
        await opened.air.run(1.0)
        assert [each[-1].pose.position.z for each in heights] == [0.0, 7.0]
        names = {each.name for each in await opened.user.topics()}
        assert not any("uav9" in name for name in names)
