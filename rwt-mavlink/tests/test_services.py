"""Services of a vehicle: commands, plans and parameters over a good link, and their refusals."""

from __future__ import annotations

from typing import Any

import pytest

from rwt_graph import Node
from rwt_mavlink.link.frames import dialect
from rwt_mavlink.protocol.missions import Plan
from rwt_mavlink.simulation.vehicle import AUTO, GUIDED, HOME, SimulatedVehicle
from rwt_participant.errors import CallFailed, ParameterRejected

pytestmark = pytest.mark.anyio


def waypoint(number: int, **fields: Any) -> dict[str, Any]:
    return {
        "frame": 3,
        "command": dialect.MAV_CMD_NAV_WAYPOINT,
        "autocontinue": True,
        "param2": 0.1 * number,
        "x_lat": HOME[0] + number * 1e-5,
        "y_long": HOME[1] - number * 1e-5,
        "z_alt": 10.0 + number,
        **fields,
    }


async def test_arm_take_off_and_land(flight: Any) -> None:
    assert (await flight.call("/mavros/set_mode", {"custom_mode": "GUIDED"})).mode_sent
    assert (await flight.call("/mavros/cmd/arming", {"value": True})).success
    assert (await flight.call("/mavros/cmd/takeoff", {"altitude": 8.0})).success
    await flight.air.until(lambda: flight.vehicle.position[2] < -7.9)
    landing = await flight.call("/mavros/cmd/arming", {"value": False})
    assert (landing.success, landing.result) == (False, dialect.MAV_RESULT_DENIED)
    assert (await flight.call("/mavros/cmd/land")).success
    await flight.air.until(lambda: not flight.vehicle.is_armed)
    commands = [each.command for each in flight.vehicle.executed]
    assert commands == [
        dialect.MAV_CMD_DO_SET_MODE,
        400,
        dialect.MAV_CMD_NAV_TAKEOFF,
        400,
        dialect.MAV_CMD_NAV_LAND,
    ]


async def test_px4_modes_are_set_by_name(world: Any) -> None:
    async with world(SimulatedVehicle(px4=True)) as opened:
        assert (await opened.call("/mavros/set_mode", {"custom_mode": "AUTO.MISSION"})).mode_sent
        assert opened.vehicle.mode == AUTO
        with pytest.raises(CallFailed, match="no mode 'GUIDED'"):
            await opened.call("/mavros/set_mode", {"custom_mode": "GUIDED"})


async def test_any_command_by_its_number(flight: Any) -> None:
    request = {"command": dialect.MAV_CMD_DO_SET_SERVO, "param1": 9.0, "param2": 1500.0}
    assert (await flight.call("/mavros/cmd/command", request)).success
    assert (await flight.call("/mavros/cmd/command", {"command": 31_000})).result == 3
    with pytest.raises(CallFailed, match="no vehicle confirms"):
        await flight.call("/mavros/cmd/command", {**request, "broadcast": True})
    request = {"frame": 0, "command": dialect.MAV_CMD_DO_SET_HOME, "x": 473_977_420, "y": 85_455_940}
    assert (await flight.call("/mavros/cmd/command_int", request)).success
    assert flight.vehicle.executed[-1].parameters[4] == pytest.approx(47.397742)


async def test_a_vehicle_that_was_never_heard_and_one_that_is_lost(flight: Any, world: Any) -> None:
    async with world(SimulatedVehicle(9)) as opened:
        with pytest.raises(CallFailed, match="no vehicle with the system id 1 has been heard"):
            await opened.call("/mavros/cmd/arming", {"value": True})
        assert opened.vehicle.executed == []
    flight.air.antennas[0].is_cut = True
    await flight.air.run(7.0)
    with pytest.raises(CallFailed, match="link to the vehicle is lost"):
        await flight.call("/mavros/cmd/arming", {"value": True})


@pytest.mark.parametrize(
    ("plan", "services", "topic"),
    [
        (Plan.MISSION, "mission", "mission/waypoints"),
        (Plan.FENCE, "geofence", "geofence/fences"),
        (Plan.RALLY, "rallypoint", "rallypoint/rallypoints"),
    ],
)
async def test_plans_are_uploaded_and_downloaded(flight: Any, plan: Plan, services: str, topic: str) -> None:
    lists = flight.hear(f"/mavros/{topic}")
    waypoints = [waypoint(number) for number in range(5)]
    pushed = await flight.call(f"/mavros/{services}/push", {"waypoints": waypoints})
    assert (pushed.success, pushed.wp_transfered) == (True, 5)
    assert [item.x for item in flight.vehicle.plans.plans[plan]] == [
        round(each["x_lat"] * 1e7) for each in waypoints
    ]
    assert (await flight.call(f"/mavros/{services}/pull")).wp_received == 5
    await flight.air.run(0.5)
    assert lists[-1].waypoints[4].y_long == pytest.approx(waypoints[4]["y_long"], abs=1e-7)
    assert (await flight.call(f"/mavros/{services}/clear")).success
    assert flight.vehicle.plans.plans[plan] == []


async def test_a_mission_is_flown(flight: Any) -> None:
    reached = flight.hear("/mavros/mission/reached")
    home = {"command": dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, "frame": 3, "autocontinue": True}
    await flight.call("/mavros/mission/push", {"waypoints": [waypoint(1), waypoint(2), home]})
    await flight.call("/mavros/cmd/arming", {"value": True})
    await flight.call("/mavros/set_mode", {"custom_mode": "AUTO"})
    await flight.air.until(lambda: not flight.vehicle.is_armed)
    assert [each.wp_seq for each in reached] == [0, 1]
    assert flight.vehicle.position == pytest.approx((0.0, 0.0, 0.0), abs=0.5)


async def test_positions_that_no_plan_can_have_are_rejected(flight: Any) -> None:
    with pytest.raises(CallFailed, match=r"waypoints\[0\]: the position is not finite"):
        await flight.call("/mavros/mission/push", {"waypoints": [waypoint(0, x_lat=1e12)]})
    with pytest.raises(CallFailed, match="start_index is 0"):
        await flight.call("/mavros/mission/push", {"start_index": 2, "waypoints": [waypoint(0)]})
    assert flight.vehicle.plans.uploads == 0


@pytest.mark.parametrize("px4", [False, True])
async def test_parameters(world: Any, px4: bool) -> None:
    vehicle = SimulatedVehicle(px4=px4)
    vehicle.parameters.values |= {f"P{number:03}": number * 3 for number in range(60)}
    vehicle.parameters.values["GAIN"] = 0.1
    async with world(vehicle) as opened:
        pulled = await opened.call("/mavros/param/pull", {"force_pull": True})
        assert (pulled.success, pulled.param_received) == (True, len(vehicle.parameters.values))
        get = opened.user.params.get
        assert await opened.air.during(lambda: get("/mavros/param:P059")) == 177
        assert await opened.air.during(lambda: get("/mavros/param:GAIN")) == pytest.approx(0.1)
        value = {"type": 2, "integer_value": 1234}
        answer = await opened.call("/mavros/param/set", {"param_id": "P001", "value": value})
        assert (answer.success, answer.value.integer_value) == (True, 1234)
        assert vehicle.parameters.values["P001"] == 1234
        await opened.air.during(lambda: opened.user.params.set("/mavros/param:GAIN", 0.25))
        assert vehicle.parameters.values["GAIN"] == 0.25
        assert await opened.air.during(lambda: get("/mavros/param:GAIN")) == 0.25
        with pytest.raises(ParameterRejected, match="integer from -2147483648 to 2147483647"):
            await opened.air.during(lambda: opened.user.params.set("/mavros/param:P001", 2**40))
        assert vehicle.parameters.writes == [("P001", 1234), ("GAIN", 0.25)]


async def test_large_integers_are_exact_or_rejected(world: Any) -> None:
    for px4 in (False, True):
        vehicle = SimulatedVehicle(px4=px4)
        vehicle.parameters.values["MASK"] = 5
        async with world(vehicle) as opened:
            value = {"type": 2, "integer_value": 2**24 + 1}
            request = {"param_id": "MASK", "value": value}
            if px4:
                await opened.call("/mavros/param/set", request)
                assert vehicle.parameters.values["MASK"] == 2**24 + 1
            else:
                with pytest.raises(CallFailed, match="cannot be transferred exactly"):
                    await opened.call("/mavros/param/set", request)
                assert vehicle.parameters.values["MASK"] == 5


async def test_a_name_that_the_vehicle_does_not_have(flight: Any) -> None:
    request = {"param_id": "NO_SUCH", "value": {"type": 3, "double_value": 1.0}}
    with pytest.raises(CallFailed, match="about the parameter NO_SUCH, which it may not have"):
        await flight.call("/mavros/param/set", request)


async def test_setpoints(flight: Any) -> None:
    vehicle, user = flight.vehicle, flight.user
    vehicle.mode, vehicle.is_armed = GUIDED, True
    user.publish("/mavros/setpoint_position/local", _pose(2.0, 5.0, 3.0), "geometry_msgs/PoseStamped")
    await flight.air.until(lambda: vehicle.position == pytest.approx((5.0, 2.0, -3.0), abs=0.1))
    place = {"latitude": HOME[0], "longitude": HOME[1], "altitude": 4.0}
    pose = {"pose": {"position": place}}
    user.publish("/mavros/setpoint_position/global", pose, "geographic_msgs/GeoPoseStamped")
    await flight.air.until(lambda: vehicle.position == pytest.approx((0.0, 0.0, -4.0), abs=0.1))
    nothing = {"coordinate_frame": 1, "type_mask": 0b111_111_000_111, "velocity": {"x": float("inf")}}
    lines = flight.hear("/rosout")
    user.publish("/mavros/setpoint_raw/local", nothing, "mavros_msgs/PositionTarget")
    await flight.air.run(0.5)
    assert "not finite" in lines[-1].msg


def _pose(x: float, y: float, z: float) -> dict[str, Any]:
    return {"pose": {"position": {"x": x, "y": y, "z": z}, "orientation": {"w": 1.0}}}


async def _stream(flight: Any, user: Node, seconds: float) -> None:
    for _ in range(round(seconds / 0.1)):
        message = {"twist": {"linear": {"x": 1.0, "y": 2.0, "z": 0.5}, "angular": {"z": 0.2}}}
        user.publish("/mavros/setpoint_velocity/cmd_vel", message, "geometry_msgs/TwistStamped")
        await flight.air.run(0.1)


async def test_a_velocity_ends_when_its_stream_ends(flight: Any) -> None:
    vehicle = flight.vehicle
    vehicle.mode, vehicle.is_armed, vehicle.position = GUIDED, True, (0.0, 0.0, -10.0)
    await _stream(flight, flight.user, 1.0)
    assert vehicle.velocity == pytest.approx((2.0, 1.0, -0.5))
    lines = flight.hear("/rosout")
    await flight.air.run(0.8)
    assert vehicle.velocity == (0.0, 0.0, 0.0)
    assert "no velocities for 0.5 s: stopping the vehicle" in lines[-1].msg
    stops = len(vehicle.setpoints)
    await flight.air.run(8.0)
    assert len(vehicle.setpoints) > stops + 30
    ended = len(vehicle.setpoints)
    await flight.air.run(2.0)
    assert len(vehicle.setpoints) == ended, "the stop is not repeated for ever"


async def test_overrides_are_released_when_their_stream_ends(flight: Any) -> None:
    channels = [1500, 1600, 1000, 1500] + [65535] * 14
    flight.user.publish("/mavros/rc/override", {"channels": channels}, "mavros_msgs/OverrideRCIn")
    await flight.air.run(0.3)
    assert flight.vehicle.setpoints[-1][2][:4] == (1500.0, 1600.0, 1000.0, 1500.0)
    await flight.air.run(1.0)
    assert flight.vehicle.setpoints[-1][2] == (0.0,) * 8
    await flight.air.run(6.0)
    flight.user.publish("/mavros/rc/override", {"channels": [0] * 18}, "mavros_msgs/OverrideRCIn")
    count = len(flight.vehicle.setpoints)
    await flight.air.run(3.0)
    assert len(flight.vehicle.setpoints) == count + 1, "a release needs no stop"
