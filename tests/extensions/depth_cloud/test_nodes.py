"""The nodes: they work only while heard, on the newest, in a thread, and say what they cannot read."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from rwt.extensions.depth_cloud import CloudDecimator, DepthCloudEncoder
from rwt.extensions.depth_cloud.depth_image import decode_image
from rwt.extensions.depth_cloud.encoder import CROP_SIZE
from rwt.extensions.depth_cloud.latest_only import LatestOnly
from rwt_participant.errors import ParameterRejected
from tests.extensions.video.conftest import image

pytestmark = pytest.mark.anyio

DEPTH, COLOUR, RESULT = "/camera/depth/image_raw", "/camera/image_raw", "/depthcloud_encoded"


class Camera:
    """Publishes what a test tells it to."""

    def __init__(self, studio: Any) -> None:
        self._topics = {
            topic: studio.camera.advertise(topic, "sensor_msgs/Image") for topic in (DEPTH, COLOUR)
        }

    def shoot(self, topic: str, pixels: Any, encoding: str, milliseconds: int = 0) -> None:
        message = image(pixels, encoding)
        stamp = {"sec": 12, "nanosec": milliseconds * 1_000_000}
        self._topics[topic].publish({**message, "header": {"stamp": stamp, "frame_id": "optical"}})

    def depth(self, metres: float, milliseconds: int = 0) -> None:
        self.shoot(DEPTH, np.full((12, 16), metres * 1000, np.uint16), "16UC1", milliseconds)

    def colour(self, value: int, milliseconds: int = 0) -> None:
        self.shoot(COLOUR, np.full((12, 16, 3), value, np.uint8), "rgb8", milliseconds)


def _seen(message: Any, tile: float = 1.0) -> tuple[Any, Any]:
    """The middle of a picture: metres, and red."""
    edge = message.height
    picture = np.frombuffer(message.data, np.uint8).reshape(edge, edge, 3)
    found = decode_image(picture, tile)
    middle = edge // 4
    return float(found.depths[middle, middle]), int(found.colours[middle, middle, 0])


async def _encoded(studio: Any, **parameters: Any) -> tuple[Camera, list[Any]]:
    """A camera, and the pictures that an encoder makes of its images."""
    camera, _ = Camera(studio), DepthCloudEncoder(studio.graph, **{"crop_size": 10, **parameters})
    pictures: list[Any] = studio.heard(RESULT)
    await studio.until(lambda: studio.listeners(DEPTH) and studio.listeners(COLOUR))
    return camera, pictures


async def test_a_pair_becomes_a_picture(studio: Any) -> None:
    camera, pictures = await _encoded(studio, target_resolution=20)
    camera.depth(0.5)
    camera.colour(90)
    await studio.until(lambda: pictures)
    (picture,) = pictures
    assert (picture.width, picture.height, picture.step, picture.encoding) == (40, 40, 120, "rgb8")
    assert picture.header.frame_id == "optical"
    assert _seen(picture) == (pytest.approx(0.5, abs=1e-3), 90)


async def test_pairs_are_of_one_time_and_each_image_is_used_once(studio: Any) -> None:
    camera, pictures = await _encoded(studio, target_resolution=4, slop=0.04)
    camera.depth(0.1, 0)
    camera.colour(1, 41)  # too late for the depth
    await studio.settle()
    assert pictures == []
    camera.depth(0.2, 80)  # 39 ms after the colour
    await studio.until(lambda: pictures)
    camera.colour(2, 90)  # its depth has gone into the first
    await studio.settle()
    assert [_seen(picture) for picture in pictures] == [(pytest.approx(0.2, abs=1e-3), 1)]
    camera.depth(0.3, 91)
    await studio.until(lambda: len(pictures) == 2)
    assert _seen(pictures[-1]) == (pytest.approx(0.3, abs=1e-3), 2)


async def test_it_listens_only_while_it_is_heard(studio: Any) -> None:
    DepthCloudEncoder(studio.graph)
    for _ in range(2):
        await studio.settle()
        assert studio.listeners(DEPTH) == studio.listeners(COLOUR) == 0
        subscription = studio.viewer.subscribe(RESULT, lambda message: None)
        await studio.until(lambda: studio.listeners(DEPTH) and studio.listeners(COLOUR))
        subscription.close()
        await studio.until(lambda: not studio.listeners(DEPTH) and not studio.listeners(COLOUR))


async def test_parameters_are_changed_while_it_works(studio: Any) -> None:
    camera, pictures = await _encoded(studio, target_resolution=8)
    separator = ":" if studio.graph.distro.parameters_belong_to_nodes else "/"
    name = f"/depthcloud_encoder{separator}"
    await studio.viewer.params.set(f"{name}max_depth_per_tile", 3.0)
    await studio.viewer.params.set(f"{name}target_resolution", 6)
    camera.depth(4.5)
    camera.colour(7)
    await studio.until(lambda: pictures)
    assert pictures[0].height == 12
    assert _seen(pictures[0], 3.0) == (pytest.approx(4.5, abs=3e-3), 7)
    for parameter, value, reason in (
        ("max_depth_per_tile", 0.0, "must be a number from 0.01 to 1000 m, got 0"),
        ("target_resolution", 1, "must be a whole number from 2 to 2048, got 1"),
        ("crop_size", 5000, "must be a whole number from 2 to 4096, got 5000"),
    ):
        with pytest.raises(ParameterRejected, match=reason):
            await studio.viewer.params.set(f"{name}{parameter}", value)
    assert await studio.viewer.params.get(f"{name}max_depth_per_tile") == 3.0


def test_numbers_that_cannot_be_are_refused_at_the_start(studio: Any) -> None:
    with pytest.raises(ParameterRejected, match="max_depth_per_tile must be a number"):
        DepthCloudEncoder(studio.graph, max_depth_per_tile=-1.0)
    with pytest.raises(ParameterRejected, match="stride must be a whole number"):
        CloudDecimator(studio.graph, "/points", name="other", stride=0)


@pytest.mark.parametrize("value", [2.5, "wide", True, None, math.nan, math.inf, 1, 5000])
def test_a_whole_number_is_checked(value: object) -> None:
    with pytest.raises(ParameterRejected, match="crop_size must be a whole number from 2 to 4096, got "):
        CROP_SIZE.check(value)


async def test_what_cannot_be_read_is_said_and_not_too_often(studio: Any) -> None:
    lines = studio.heard("/rosout")
    camera, pictures = await _encoded(studio, target_resolution=4)
    for _ in range(3):
        camera.shoot(DEPTH, np.zeros((4, 4, 3), np.uint8), "rgb8")
        camera.colour(1)
        await studio.settle()
    (line,) = [line.msg for line in lines]
    assert line == (f'nothing on {RESULT}: encoding "rgb8" is none of depths; known are 16UC1, mono16, 32FC1')
    studio.clock.advance(10.0)
    camera.shoot(DEPTH, np.zeros((4, 4), np.uint16), "16UC1")
    camera.shoot(COLOUR, np.zeros((4, 4), np.uint16), "strange")
    await studio.until(lambda: len(lines) == 2)
    assert 'encoding "strange"' in lines[-1].msg
    assert pictures == []
    camera.depth(0.5)
    camera.colour(3)
    await studio.until(lambda: pictures)


async def test_grey_and_transparent_colours(studio: Any) -> None:
    camera, pictures = await _encoded(studio, target_resolution=4)
    for pixels, encoding in (
        (np.full((12, 16), 77, np.uint8), "mono8"),
        (np.full((12, 16, 4), 77, np.uint8), "rgba8"),
    ):
        pictures.clear()
        camera.depth(0.5)
        camera.shoot(COLOUR, pixels, encoding)
        await studio.until(lambda: pictures)
        assert _seen(pictures[0])[1] == 77


# -- the work itself ---------------------------------------------------------------------------------------


async def test_work_is_in_a_thread_on_the_newest_and_ends_with_the_node(
    studio: Any, caplog: pytest.LogCaptureFixture
) -> None:
    node = studio.graph.node("worker")
    results = node.advertise("/results", "std_msgs/String")
    proceed, begun, threads = threading.Semaphore(0), threading.Semaphore(0), []

    def slowly(item: int) -> Mapping[str, object]:
        threads.append(threading.current_thread())
        begun.release()
        proceed.acquire(timeout=60)
        return {"data": str(item)}

    work: LatestOnly[int] = LatestOnly(node, results, slowly, lambda: ())
    heard = studio.heard("/results")
    work.offer(1)
    await studio.until(lambda: begun.acquire(blocking=False))
    for item in (2, 3, 4):
        work.offer(item)  # 1 is worked on, and only the last of these will be
    proceed.release()
    await studio.until(lambda: begun.acquire(blocking=False))
    proceed.release()
    await studio.until(lambda: len(heard) == 2)
    assert [message.data for message in heard] == ["1", "4"]
    assert threading.main_thread() not in threads

    work.offer(5)
    await studio.until(lambda: begun.acquire(blocking=False))
    node.close()
    proceed.release()
    await studio.settle()
    assert len(heard) == 2
    assert "Traceback" not in caplog.text


# -- the decimator -----------------------------------------------------------------------------------------


def _points(places: Any, height: int = 1) -> dict[str, Any]:
    data = np.asarray(places, "<f4")
    width = len(data) // height
    return {
        "header": {"frame_id": "optical"},
        "height": height,
        "width": width,
        "fields": [
            {"name": name, "offset": 4 * n, "datatype": 7, "count": 1} for n, name in enumerate("xyz")
        ],
        "point_step": 12,
        "row_step": 12 * width,
        "data": data.tobytes(),
        "is_dense": False,
    }


async def test_a_decimated_cloud(studio: Any) -> None:
    CloudDecimator(studio.graph, "/points", stride=2)
    thin = studio.heard("/points/decimated")
    clouds = studio.camera.advertise("/points", "sensor_msgs/PointCloud2")
    await studio.until(lambda: studio.listeners("/points"))
    clouds.publish(_points([(n, 0, 0) for n in range(16)], height=4))
    await studio.until(lambda: thin)
    assert (thin[0].height, thin[0].width, thin[0].row_step, thin[0].is_dense) == (2, 2, 24, False)
    assert np.frombuffer(thin[0].data, "<f4")[::3].tolist() == [0, 2, 8, 10]
    separator = ":" if studio.graph.distro.parameters_belong_to_nodes else "/"
    await studio.viewer.params.set(f"/cloud_decimator{separator}voxel", 5.0)
    clouds.publish(_points([(n, 0, np.nan if n == 4 else 0) for n in range(16)], height=4))
    await studio.until(lambda: len(thin) == 2)
    assert (thin[1].height, thin[1].width, thin[1].is_dense) == (1, 3, True)
    assert np.frombuffer(thin[1].data, "<f4")[::3].tolist() == [0, 8, 10]


async def test_a_cloud_that_cannot_be_read_is_said(studio: Any) -> None:
    CloudDecimator(studio.graph, "/points", "/thin")
    lines, thin = studio.heard("/rosout"), studio.heard("/thin")
    clouds = studio.camera.advertise("/points", "sensor_msgs/PointCloud2")
    await studio.until(lambda: studio.listeners("/points"))
    clouds.publish({**_points([(0, 0, 0)]), "data": b""})
    await studio.until(lambda: lines)
    assert lines[0].msg.startswith("nothing on /thin: 0 bytes are no cloud of 1x1 points")
    assert thin == []


async def test_nodes_leave_nothing_behind(studio: Any) -> None:
    encoder, decimator = DepthCloudEncoder(studio.graph), CloudDecimator(studio.graph, "/points")
    studio.heard(RESULT)
    studio.heard("/points/decimated")
    await studio.until(lambda: studio.listeners(DEPTH) and studio.listeners("/points"))
    encoder.close()
    decimator.close()
    await studio.settle()
    assert {each.name for each in studio.graph.nodes()} >= {"/camera", "/viewer"}
    assert not {"/depthcloud_encoder", "/cloud_decimator"} & {each.name for each in studio.graph.nodes()}
    assert studio.listeners(DEPTH) == studio.listeners("/points") == 0
