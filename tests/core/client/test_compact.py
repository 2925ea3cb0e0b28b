"""Compact clouds: what a subscriber requests, encoded once, and whole messages for all others."""

from __future__ import annotations

import json
from contextlib import AsyncExitStack
from typing import Any

import anyio
import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket

from rwt import Server
from rwt_client import connect
from rwt_interfaces.point_clouds import compressed
from rwt_interfaces.point_clouds.wish import COMPRESSED
from tests.waiting import until

pytestmark = pytest.mark.anyio

CLOUD = "sensor_msgs/PointCloud2"


def places(count: int = 500) -> np.ndarray[Any, Any]:
    turn = np.linspace(0, 6, count)
    return np.stack([9 * np.cos(turn), 9 * np.sin(turn), turn], axis=1).astype("<f4")


def cloud(count: int = 500) -> dict[str, Any]:
    fields = [{"name": name, "offset": 4 * at, "datatype": 7, "count": 1} for at, name in enumerate("xyz")]
    return {
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "laser"},
        "height": 1,
        "width": count,
        "fields": fields,
        "point_step": 12,
        "row_step": 12 * count,
        "data": places(count).tobytes(),
    }


def points(message: Any) -> np.ndarray[Any, Any]:
    return np.frombuffer(bytes(message.data), "<f4").reshape(message.width, -1)


@pytest.mark.parametrize("compression", ["none", "png", "cbor"])
@pytest.mark.parametrize("latch", [False, True])
async def test_a_client_gets_the_points_that_it_requests(compression: str, latch: bool) -> None:
    async with Server("ws://127.0.0.1:0", nodes=("rosapi",)) as server:
        clouds = server.node("lidar").advertise("/points", CLOUD, latch=latch)
        if latch:
            clouds.publish(cloud())
        async with connect(server.urls[0]) as robot:
            wish = {"precision": 0.01, "stride": 2, "crop": [0, -9, 0, 9, 9, 9], "fields": ["x", "z"]}
            async with robot.topic("/points", CLOUD, compression=compression, compact=wish) as messages:
                await until(lambda: clouds.subscriber_count == 1)
                if not latch:
                    clouds.publish(cloud())
                found = await anext(aiter(messages))
    every = places()[::2]
    expected = every[(every[:, 0] >= 0) & (every[:, 0] <= 9)][:, [0, 2]]
    assert found.header.frame_id == "laser" and [field.name for field in found.fields] == ["x", "z"]
    assert np.abs(points(found) - expected).max() <= 0.01


@pytest.mark.parametrize("compression", ["none", "png", "cbor"])
@pytest.mark.parametrize("order", ["keep", "any"])
async def test_a_client_gets_clouds_by_draco(compression: str, order: str) -> None:
    pytest.importorskip("DracoPy")
    async with Server("ws://127.0.0.1:0", nodes=("rosapi",)) as server:
        clouds = server.node("lidar").advertise("/points", CLOUD)
        async with connect(server.urls[0]) as robot, open_socket(server.urls[0]) as socket:
            wish = {"format": "draco", "order": order}
            await subscribed(socket, compact=wish)
            async with robot.topic("/points", CLOUD, compression=compression, compact=wish) as messages:
                await until(lambda: clouds.subscriber_count == 1)
                clouds.publish(cloud())
                found = await anext(aiter(messages))
            sent = json.loads(await heard(socket))["msg"]
    assert sent["format"] == "draco" and [field["name"] for field in sent["fields"]] == ["x", "y", "z"]
    got, expected = (np.sort(each, axis=0) for each in (points(found), places()))
    assert np.abs(got.astype(float) - expected).max() <= 0.001


@pytest.mark.parametrize("form", ["draco", "zstd"])
@pytest.mark.parametrize("compact", [None, {}, {"format": "draco"}])
async def test_compressed_topics_of_a_robot_are_passed_on(form: str, compact: Any) -> None:
    """Their data need not even be what the format says: it is not decoded."""
    message = cloud() | {"compressed_data": b"\0\xff not decoded", "format": form}
    del message["data"]
    topic = f"/points/{form}"
    async with Server("ws://127.0.0.1:0", nodes=("rosapi",)) as server:
        clouds = server.node("lidar").advertise(topic, COMPRESSED)
        async with (
            connect(server.urls[0]) as robot,
            robot.topic(topic, COMPRESSED, compact=compact) as messages,
        ):
            await until(lambda: clouds.subscriber_count == 1)
            clouds.publish(message)
            found = await anext(aiter(messages))
    assert bytes(found.compressed_data) == message["compressed_data"] and found.format == form


async def heard(socket: ClientConnection) -> Any:
    """Return the next message of a topic, as it is on the wire."""
    with anyio.fail_after(20):
        while True:
            frame = await socket.recv()
            if isinstance(frame, bytes) or json.loads(frame)["op"] in ("publish", "png"):
                return frame


async def subscribed(socket: ClientConnection, **options: Any) -> None:
    """Subscribe, and return once the server has done it."""
    await socket.send(json.dumps({"op": "set_level", "level": "info"}))
    await socket.send(json.dumps({"op": "subscribe", "topic": "/points", "type": CLOUD, **options}))
    with anyio.fail_after(20):
        while "subscribe: done" not in await socket.recv(decode=True):
            pass


@pytest.mark.parametrize("compression", ["none", "png", "cbor", "cbor-raw"])
async def test_who_does_not_ask_gets_the_same_bytes_beside_one_who_does(compression: str) -> None:
    frames = []
    for is_beside in (False, True):
        async with Server("ws://127.0.0.1:0", nodes=()) as server:
            clouds = server.node("lidar").advertise("/points", CLOUD)
            async with open_socket(server.urls[0]) as plain, open_socket(server.urls[0]) as other:
                if is_beside:
                    await subscribed(other, compression=compression, compact={})
                await subscribed(plain, compression=compression)
                clouds.publish(cloud())
                frames.append(await heard(plain))
                if is_beside:
                    assert len(await heard(other)) < len(frames[0])
    if compression == "cbor-raw":  # Before it is the time of publishing.
        frames = [frame[frame.index(b"laser") :] for frame in frames]
    assert frames[0] == frames[1]


async def test_equal_wishes_are_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    wishes: list[Any] = []
    compress = compressed.compress

    def counted(cloud: Any, wish: Any) -> dict[str, Any]:
        wishes.append(wish)
        return compress(cloud, wish)

    monkeypatch.setattr(compressed, "compress", counted)
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(Server("ws://127.0.0.1:0", nodes=()))
        clouds = server.node("lidar").advertise("/points", CLOUD)
        viewers = [await stack.enter_async_context(open_socket(server.urls[0])) for _ in range(5)]
        for viewer in viewers:
            await subscribed(viewer, compression="cbor", compact={"precision": 0.01, "voxel": 0})
        coarse = await stack.enter_async_context(open_socket(server.urls[0]))
        await subscribed(coarse, compression="cbor", compact={"precision": 0.1})
        clouds.publish(cloud())
        assert len({await heard(viewer) for viewer in viewers}) == 1
        assert len(await heard(coarse)) < len(await _next(viewers[0], clouds))
    assert sorted(wish.precision for wish in wishes[:2]) == [0.01, 0.1]


async def _next(viewer: ClientConnection, clouds: Any) -> Any:
    clouds.publish(cloud())
    return await heard(viewer)


async def test_several_subscriptions_of_a_client_agree_or_get_whole_clouds() -> None:
    async with Server("ws://127.0.0.1:0", nodes=()) as server:
        clouds = server.node("lidar").advertise("/points", CLOUD)
        async with open_socket(server.urls[0]) as socket:
            for id in "abc":
                await subscribed(socket, id=id, compact=None if id == "c" else {})
                clouds.publish(cloud())
                assert ("compressed_data" in await heard(socket)) is (id != "c")
            await socket.send(json.dumps({"op": "unsubscribe", "topic": "/points", "id": "c"}))
            await subscribed(socket, id="a", compact={})
            clouds.publish(cloud())
            assert "compressed_data" in await heard(socket)
            await socket.send(json.dumps({"op": "unsubscribe", "topic": "/points"}))
            await until(lambda: clouds.subscriber_count == 0)


async def test_a_cloud_that_cannot_be_compressed_is_not_sent_and_later_ones_are(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with Server("ws://127.0.0.1:0", nodes=()) as server:
        clouds = server.node("lidar").advertise("/points", CLOUD)
        async with open_socket(server.urls[0]) as socket:
            await subscribed(socket, compact={})
            clouds.publish(cloud() | {"point_step": 4})
            await until(lambda: "/points without a compact form are not sent: field y ends" in caplog.text)
            clouds.publish(cloud())
            assert "compressed_data" in await heard(socket)


@pytest.mark.parametrize(
    ("compact", "reason"),
    [
        ([], "compact: expected an object"),
        ({"precision": -1}, "precision: expected metres, 0 to 1000"),
        ({"fields": "x"}, "fields: expected at most 256 names"),
        ({"fields": ["x"] * 257}, "fields: expected at most 256 names"),
        ({"crop": [0, 0, 0, 1, 1]}, "crop.5: expected a number of at least -1000000000.0"),
        ({"crop": 5}, "crop: expected six numbers"),
        ({"voxel": 1e9}, "voxel: expected metres, 0 to 1000"),
        ({"stride": 0}, "stride: expected a whole number, 1 to 10000"),
        ({"format": "zlib"}, 'format: expected "rwt_planes" or "draco"'),
        ({"order": "random"}, 'order: expected "keep" or "any"'),
    ],
)
async def test_requests_out_of_range_are_refused(compact: object, reason: str) -> None:
    request = {"op": "subscribe", "topic": "/points", "type": CLOUD, "compact": compact}
    async with Server("ws://127.0.0.1:0", nodes=()) as server, open_socket(server.urls[0]) as socket:
        await socket.send(json.dumps({"op": "set_level", "level": "error"}))
        await socket.send(json.dumps(request))
        with anyio.fail_after(20):
            answer = json.loads(await socket.recv())
    assert answer["level"] == "error" and reason in answer["msg"]


async def test_the_client_rejects_unknown_members() -> None:
    async with Server("ws://127.0.0.1:0", nodes=()) as server, connect(server.urls[0]) as robot:
        with pytest.raises(ValueError, match="got 'precison'"):
            robot.topic("/points", CLOUD, compact={"precison": 0.1})
