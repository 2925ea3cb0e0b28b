"""Messages in CBOR: when they are asked for, what is done when they are refused, and how they are read."""

from __future__ import annotations

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_client.connection import ConnectKeywords
from rwt_client.wire.cbor import TypedArray, Unreadable, read_cbor
from rwt_client.wire.decoding import MessageReader
from rwt_interfaces import JAZZY, NOETIC, Payload, Registry
from tests.core.client.worlds import scripted, world

REGISTRY = Registry(JAZZY)


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("type_name", "of_ros_2", "of_ros_1"),
    [
        ("sensor_msgs/Image", "cbor", "cbor"),
        ("sensor_msgs/CompressedImage", "cbor", "cbor"),
        ("sensor_msgs/LaserScan", "cbor", "cbor"),
        ("sensor_msgs/PointCloud2", "cbor", "cbor"),
        ("nav_msgs/OccupancyGrid", "cbor", "cbor"),
        # Servers of ROS 1 cannot encode all of these.
        ("sensor_msgs/JointState", "cbor", "none"),
        ("sensor_msgs/CameraInfo", "cbor", "none"),
        # These have no big arrays.
        ("std_msgs/String", "none", "none"),
        ("nav_msgs/Odometry", "none", "none"),
        ("nav_msgs/Path", "none", "none"),
        ("tf2_msgs/TFMessage", "none", "none"),
    ],
)
async def test_it_is_asked_for_where_a_message_has_big_arrays(
    type_name: str, of_ros_2: str, of_ros_1: str
) -> None:
    asked = []
    for options in (ConnectKeywords(ros_version=2), ConnectKeywords(ros_version=1)):
        async with scripted(**options) as (server, robot):
            await robot.topic("/data", type_name)
            asked.append((await server.hears("subscribe")).get("compression", "none"))
    assert asked == [of_ros_2, of_ros_1]


@pytest.mark.anyio
async def test_an_image_in_cbor_becomes_a_numpy_array() -> None:
    pixels = np.arange(4 * 3 * 3, dtype=np.uint8)
    picture = {"height": 4, "width": 3, "step": 9, "encoding": "rgb8", "data": pixels}
    async with (
        scripted(arrays="numpy") as (server, robot),
        robot.topic("/camera", "sensor_msgs/Image") as images,
    ):
        await server.hears("subscribe")
        server.publish_cbor("/camera", Payload.from_value(REGISTRY.message("sensor_msgs/Image"), picture))
        image = await images.get(timeout=5)
    np.testing.assert_array_equal(image.data, pixels)
    assert (image.width, image.encoding, type(image)) == (3, "rgb8", robot.types["sensor_msgs/Image"])


@pytest.mark.anyio
async def test_refused_it_falls_back_to_json_and_is_not_asked_for_again() -> None:
    async with scripted() as (server, robot):
        async with robot.topic("/map", "nav_msgs/OccupancyGrid") as maps:
            first = await server.hears("subscribe")
            server.say({"op": "status", "level": "error", "msg": "no cbor here", "id": first["id"]})
            second = await server.hears("subscribe", 2)
            assert (first["compression"], second.get("compression", "none")) == ("cbor", "none")
            server.publish("/map", {"data": [0, 100, -1]})
            assert (await maps.get(timeout=5)).data == [0, 100, -1]
        await robot.topic("/map_2", "nav_msgs/OccupancyGrid")
        assert "compression" not in await server.hears("subscribe", 3)


@pytest.mark.anyio
async def test_a_server_that_answers_in_json_all_the_same_is_understood() -> None:
    async with scripted() as (server, robot), robot.topic("/camera", "sensor_msgs/Image") as images:
        await server.hears("subscribe")
        server.publish("/camera", {"data": "AAEC"})
        assert (await images.get(timeout=5)).data == b"\x00\x01\x02"


@pytest.mark.anyio
async def test_the_projects_own_server_sends_it(transport: str) -> None:
    async with world(transport, arrays="numpy") as it:
        camera = it.node.advertise("/camera", "sensor_msgs/Image", latch=True)
        camera.publish({"width": 2, "data": bytes(range(200)) * 10})
        image = await it.robot.once("/camera", timeout=60)
        np.testing.assert_array_equal(image.data, np.tile(np.arange(200, dtype=np.uint8), 10))
        assert image.width == 2


@pytest.mark.anyio
async def test_it_is_not_asked_for_where_only_text_can_be_sent() -> None:
    async with world("tcp") as it:
        it.node.advertise("/camera", "sensor_msgs/Image", latch=True).publish({"data": b"abc"})
        assert (await it.robot.once("/camera", timeout=60)).data == b"abc"


FULL: dict[str, dict[str, object]] = {
    "sensor_msgs/LaserScan": {"ranges": [1.5, float("inf")], "header": {"frame_id": "laser"}},
    "nav_msgs/OccupancyGrid": {"data": [-1, 0, 100], "info": {"width": 3, "height": 1}},
    "sensor_msgs/PointCloud2": {"data": b"\x00\x01", "fields": [{"name": "x", "datatype": 7, "count": 1}]},
    "sensor_msgs/JointState": {"name": ["a", "b"], "position": [1.0, -2.0]},
    "nav_msgs/Odometry": {"child_frame_id": "é"},
    "std_msgs/UInt64MultiArray": {"data": [2**64 - 1]},
}


@pytest.mark.parametrize("name", FULL)
@pytest.mark.parametrize("registry", [REGISTRY, Registry(NOETIC)], ids=["jazzy", "noetic"])
def test_a_message_reads_the_same_in_cbor_and_in_json(name: str, registry: Registry) -> None:
    if name not in registry.names("msg"):
        pytest.skip("not a type of this distribution")
    payload = Payload.from_value(
        registry.message(name),
        {"header": {"stamp": {}}} | FULL[name] if "header" in FULL[name] else FULL[name],
    )
    reader = MessageReader(payload.type)
    plain = read_cbor(payload.cbor())
    assert isinstance(plain, dict)
    assert reader.read(plain) == payload.value()


@pytest.mark.parametrize(
    ("tag", "dtype"),
    [
        (64, "u1"),
        (65, ">u2"),
        (66, ">u4"),
        (67, ">u8"),
        (68, "u1"),
        (69, "<u2"),
        (70, "<u4"),
        (71, "<u8"),
        (72, "i1"),
        (73, ">i2"),
        (74, ">i4"),
        (75, ">i8"),
        (77, "<i2"),
        (78, "<i4"),
        (79, "<i8"),
        (80, ">f2"),
        (81, ">f4"),
        (82, ">f8"),
        (84, "<f2"),
        (85, "<f4"),
        (86, "<f8"),
    ],
)
def test_every_kind_of_typed_array(tag: int, dtype: str) -> None:
    values = np.array([1, 2, 3], dtype)
    found = read_cbor(cbor2.dumps(cbor2.CBORTag(tag, values.tobytes())))
    assert isinstance(found, TypedArray)
    np.testing.assert_array_equal(found.numpy(), values)
    plain = found.plain()
    assert isinstance(plain, bytes | list)
    assert list(plain) == [1, 2, 3]


JSON_LIKE = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**64), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=20,
)


@given(JSON_LIKE)
def test_what_another_library_writes_is_read(value: object) -> None:
    assert read_cbor(cbor2.dumps(value)) == value


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_unreadable(data: bytes) -> None:
    try:
        read_cbor(data)
    except Unreadable:
        return


@given(JSON_LIKE, st.integers(min_value=1))
def test_cut_short_or_with_more_behind_it_is_unreadable(value: object, cut: int) -> None:
    data = cbor2.dumps(value)
    for wrong in (data[: -(cut % len(data)) or -1] if len(data) > 1 else b"", data + b"\x00"):
        with pytest.raises(Unreadable):
            read_cbor(wrong)


def test_deep_nesting_is_unreadable() -> None:
    with pytest.raises(Unreadable):
        read_cbor(b"\x81" * 100 + b"\x00")
