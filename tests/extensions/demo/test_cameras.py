"""The cameras: what they see agrees with the world, with each other, and costs nothing unless watched."""

from __future__ import annotations

import io
import math
from typing import Any

import anyio
import numpy as np
import pytest
from PIL import Image

from rwt.extensions.demo import DemoRobot
from rwt.extensions.demo.world.lens import MATRICES, Lens
from rwt.extensions.demo.world.map import Box, Pillar, Pose, World, house, walled
from rwt.extensions.demo.world.view import FARTHEST, View
from rwt.extensions.depth_cloud.depth_image import decode_image, square
from rwt_interfaces.point_clouds.records import read_points

HEIGHT = 0.3
#: Straight ahead is a wall at 3 m, and the pillar's nearest point is at 1.5 m, 45 degrees to the left.
ROOM = World(
    Box(-2.0, -4.0, 3.1, 4.0),
    walled(Box(-2.0, -4.0, 3.1, 4.0)),
    (Pillar(1.7 / math.sqrt(2), 1.7 / math.sqrt(2), 0.2),),
)


def _depths(world: World, pose: Pose) -> Any:
    view = View(world, Lens(), HEIGHT)
    return view.depths(view.cast_rays(pose)) / 1000


def test_depth_is_measured_along_the_axis() -> None:
    depths = _depths(ROOM, Pose())
    lens = Lens()
    assert depths[240, 320] == pytest.approx(3.0, abs=1e-3)
    # A flat wall is equally far in every column: depth is not distance.
    assert depths[240, 100:540] == pytest.approx(np.full(440, 3.0), abs=1e-3)
    # The floor, where the row's ray meets it.
    assert depths[479, 320] == pytest.approx(HEIGHT * lens.focal / (479 - lens.cy), abs=2e-3)


def test_left_is_left_and_turning_turns() -> None:
    depths = _depths(ROOM, Pose(heading=math.pi / 4))
    assert depths[240, 320] == pytest.approx(1.5, abs=1e-3)
    half_right = _depths(ROOM, Pose(heading=math.radians(30)))
    lens = Lens()
    column = round(lens.cx - lens.focal * math.tan(math.radians(15)))
    assert half_right[240, column] == pytest.approx(1.5 * math.cos(math.radians(15)), abs=5e-3)


def test_what_is_too_near_or_too_far_is_unknown() -> None:
    assert _depths(ROOM, Pose(x=2.8))[240, 320] == 0.0
    long = World(Box(-1.0, -1.0, 20.0, 1.0), walled(Box(-1.0, -1.0, 20.0, 1.0)))
    far = _depths(long, Pose())
    assert far[240, 320] == 0.0
    assert 0 < far.max() <= FARTHEST


@pytest.mark.parametrize("heading", [0.0, 0.4, math.pi / 2, 2.5, math.pi, -1.9, -math.pi / 2])
def test_the_picture_and_the_depths_show_the_same_walls(heading: float) -> None:
    view = View(house(), Lens(), HEIGHT)
    hits = view.cast_rays(Pose(-3.4, -2.5, heading))
    colours, depths = view.colours(hits), view.depths(hits)
    assert colours.shape == (480, 640, 3)
    assert depths.shape == (480, 640)
    # At the horizon there are only walls: their texture is no grey, and their depth is the column's.
    near = (hits.depth > 0.4) & (hits.depth < FARTHEST - 0.1)
    assert depths[240][near] / 1000 == pytest.approx(hits.depth[near], abs=2e-3)
    spread = np.ptp(colours[240].astype(int), axis=1)
    assert (spread > 5).all()


async def _first(lab: Any, topic: str) -> Any:
    heard = lab.watch(topic)
    with anyio.fail_after(20):
        while not heard:
            lab.clock.advance(0.05)
            await anyio.sleep(0.005)  # the picture is drawn in a worker thread
    return heard[0]


@pytest.mark.anyio
async def test_each_topic_has_its_picture(lab: Any) -> None:
    colour = await _first(lab, "/camera/image_raw")
    assert (colour.encoding, colour.width, colour.height, colour.step) == ("rgb8", 640, 480, 1920)
    assert len(colour.data) == 640 * 480 * 3
    depth = await _first(lab, "/camera/depth/image_raw")
    assert (depth.encoding, depth.width, depth.height, depth.step) == ("16UC1", 640, 480, 1280)
    assert len(depth.data) == 640 * 480 * 2
    jpeg = await _first(lab, "/camera/image_raw/compressed")
    assert "jpeg" in jpeg.format
    decoded = np.asarray(Image.open(io.BytesIO(jpeg.data)).convert("RGB"), float)
    raw = np.frombuffer(colour.data, np.uint8).reshape(480, 640, 3)
    assert np.abs(decoded - raw).mean() < 6
    for topic in ("/camera/camera_info", "/camera/depth/camera_info"):
        info = await _first(lab, topic)
        matrix = getattr(info, MATRICES[lab.graph.distro.name][1])
        assert matrix[2] == pytest.approx(319.5)
        assert info.header.frame_id == colour.header.frame_id == depth.header.frame_id


@pytest.mark.anyio
async def test_the_cameras_frame_hangs_on_the_robot(lab: Any) -> None:
    fixed = {transform.child_frame_id: transform for transform in lab.latest("/tf_static").transforms}
    assert fixed["camera_link"].header.frame_id == "base_link"
    assert fixed["camera_link"].transform.translation.z == HEIGHT
    assert fixed["camera_optical_frame"].header.frame_id == "camera_link"
    q = fixed["camera_optical_frame"].transform.rotation
    assert (q.x, q.y, q.z, q.w) == pytest.approx((-0.5, 0.5, -0.5, 0.5))


@pytest.mark.anyio
async def test_pictures_come_at_the_rate_and_only_while_somebody_listens(lab: Any) -> None:
    infos = lab.watch("/camera/camera_info")
    await lab.pass_time(0.1)
    infos.clear()
    await lab.pass_time(1.0)
    assert len(infos) == 20  # the clock is advanced in twenty steps, and missed ticks are skipped
    await lab.user.params.set(lab.parameter("camera_rate"), 10.0)
    infos.clear()
    await lab.pass_time(1.0)
    assert len(infos) == 10


@pytest.mark.anyio
async def test_the_lens_can_be_chosen(lab: Any) -> None:
    robot = DemoRobot(lab.graph, namespace="/small", lens=Lens(80, 60))
    colour = await _first(lab, "/small/camera/image_raw")
    info = await _first(lab, "/small/camera/camera_info")
    assert (colour.width, colour.height, info.width, info.height) == (80, 60, 80, 60)
    robot.close()


@pytest.mark.anyio
async def test_the_points_are_what_the_two_pictures_show(lab: Any) -> None:
    cloud = await _first(lab, "/camera/depth/points")
    assert (cloud.height, cloud.width, cloud.header.frame_id) == (240, 320, "camera_optical_frame")
    points = read_points(cloud)
    depth = np.frombuffer((await _first(lab, "/camera/depth/image_raw")).data, "<u2").reshape(480, 640)
    colour = np.frombuffer((await _first(lab, "/camera/image_raw")).data, np.uint8).reshape(480, 640, 3)
    depth, colour = depth[::2, ::2], colour[::2, ::2]  # every second row and column
    known, lens = depth > 0, Lens()
    assert np.array_equal(np.isfinite(points["z"]), known)
    assert np.array_equal(np.isfinite(points["x"]), known)
    rows, columns = np.mgrid[0:480:2, 0:640:2][:, known]
    assert np.abs(points["z"][known] - depth[known] / 1000).max() < 1e-5
    # Projected through the lens each point lies on its pixel again.
    z = points["z"][known].astype(float)
    assert np.abs(points["x"][known] / z * lens.focal + lens.cx - columns).max() < 1e-2
    assert np.abs(points["y"][known] / z * lens.focal + lens.cy - rows).max() < 1e-2
    packed = np.ascontiguousarray(points["rgb"]).view(np.uint8).reshape(240, 320, 4)
    assert np.array_equal(packed[:, :, 2::-1], colour)


@pytest.mark.anyio
async def test_a_depth_cloud_and_a_thin_cloud_of_the_same_room(lab: Any) -> None:
    thin = read_points(await _first(lab, "/camera/depth/points/decimated"))
    assert 500 < thin.size < 120 * 160
    picture = await _first(lab, "/depthcloud_encoded")
    assert (picture.width, picture.height) == (512, 512)
    found = decode_image(np.frombuffer(picture.data, np.uint8).reshape(512, 512, 3), 3.0)
    depth = np.frombuffer((await _first(lab, "/camera/depth/image_raw")).data, "<u2").reshape(480, 640)
    middle = square(depth * np.float32(0.001), 480, 256)
    assert np.array_equal(found.valid, (middle > 0) & (middle < 5.97))
    assert np.abs(found.depths - middle)[found.valid].max() < 2.1e-3
    assert thin["z"].min() == pytest.approx(found.depths[found.valid].min(), abs=0.1)


@pytest.mark.anyio
async def test_pages_for_openni_cameras_get_the_depth_stream_they_expect_when_asked(lab: Any) -> None:
    """`f: 525`, tiles of a metre, 512 pixels and OpenNI's frame, as in the stock `depthcloud.html`."""
    separator = ":" if lab.graph.distro.parameters_belong_to_nodes else "/"
    crop = f"/depthcloud_encoder{separator}crop_size"
    whole = await lab.user.params.get(crop)
    for asked in (True, False):
        await lab.user.params.set(lab.parameter("openni_depth_cloud"), asked)
        sizes = [
            await lab.user.params.get(f"/depthcloud_encoder{separator}{name}")
            for name in ("target_resolution", "max_depth_per_tile")
        ]
        assert sizes == ([512, 1.0] if asked else [256, 3.0])
        cropped = await lab.user.params.get(crop)
        if asked:
            assert 500 * Lens().focal / cropped == pytest.approx(525, rel=0.002)
        else:
            assert cropped == whole
        frames = {each.child_frame_id for each in lab.latest("/tf_static").transforms}
        assert ("camera_rgb_optical_frame" in frames) is asked
