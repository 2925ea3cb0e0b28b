"""Colour and depth camera, `/camera/…`: one device with one lens and one frame."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import anyio.to_thread

from rwt.extensions.demo import messages
from rwt.extensions.demo.drive import DifferentialDrive
from rwt.extensions.demo.messages import frame
from rwt.extensions.demo.model.urdf import OPTICAL, Mount
from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.demo.world.map import Pose, World
from rwt_graph import Node, Timer, TopicPublisher
from rwt_participant.qos import SENSOR_DATA

if TYPE_CHECKING:
    from rwt.extensions.demo.world.view import View

#: The cloud has every second row and column of every third image; a full one would be 147 MB/s.
_POINTS_SKIP, _POINTS_EVERY = 2, 3
#: JPEG quality of compressed images, as in image_transport.
_JPEG_QUALITY = 80


class CameraPublisher:
    """Publisher of `/camera/image_raw`, its compressed form, `/camera/depth/image_raw` and
    `/camera/depth/points`, each only while it has subscribers, and their camera infos.

    Images are drawn in a worker thread, from arrays: numpy is loaded with the first subscriber.
    """

    def __init__(self, node: Node, drive: DifferentialDrive, world: World, mount: Mount, lens: Lens) -> None:
        self._node = node
        self._frame = frame(node, OPTICAL)
        self._drive = drive
        self._world = world
        self._mount = mount
        self._lens = lens
        self._view: View | None = None
        self._period = 1 / 30
        self._shots = 0
        self._timer: Timer | None = None
        self._colours = node.advertise("camera/image_raw", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._jpegs = node.advertise(
            "camera/image_raw/compressed", "sensor_msgs/CompressedImage", qos=SENSOR_DATA
        )
        self._infos = node.advertise("camera/camera_info", "sensor_msgs/CameraInfo", qos=SENSOR_DATA)
        self._depths = node.advertise("camera/depth/image_raw", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._depth_infos = node.advertise(
            "camera/depth/camera_info", "sensor_msgs/CameraInfo", qos=SENSOR_DATA
        )
        self._points = node.advertise("camera/depth/points", "sensor_msgs/PointCloud2", qos=SENSOR_DATA)
        self._drawn = (self._colours, self._jpegs, self._depths, self._points)

    def set_rate(self, rate: float) -> None:
        """Start to publish `rate` images per second."""
        self._period = 1 / rate
        if self._timer is not None:
            self._timer.cancel()
            self._timer = self._node.create_timer(self._period, self._shoot)

    def follow_subscribers(self) -> None:
        """Run the timer while there are subscribers, so that an idle robot does not wake up."""
        wanted = self._is_heard(*self._drawn, self._infos, self._depth_infos)
        if wanted and self._timer is None:
            self._timer = self._node.create_timer(self._period, self._shoot)
        elif not wanted and self._timer is not None:
            self._timer.cancel()
            self._timer = None

    async def _shoot(self) -> None:
        header = messages.header(self._node.clock.time_ns(), self._frame)
        self._shots += 1
        for infos in (self._infos, self._depth_infos):
            if infos.subscriber_count:
                infos.publish(self._lens.camera_info(header, self._node.distro))
        if self._is_heard(*self._drawn):
            pose = self._drive.pose.after(Pose(self._mount.x, self._mount.y))
            await anyio.to_thread.run_sync(partial(self._draw, header, pose))

    def _draw(self, header: messages.Message, pose: Pose) -> None:
        """Draw an image in a worker thread; a timer's coroutine never runs twice at a time."""
        if self._view is None:
            from rwt.extensions.demo.world.view import View  # loads numpy

            self._view = View(self._world, self._lens, self._mount.z)
        hits = self._view.cast_rays(pose)
        depths = self._view.depths(hits) if self._is_heard(self._depths, self._points) else None
        if depths is not None and self._depths.subscriber_count:
            self._depths.publish(self._image(header, "16UC1", 2, depths.tobytes()))
        if not self._is_heard(self._colours, self._jpegs, self._points):
            return
        colours = self._view.colours(hits)
        if self._colours.subscriber_count:
            self._colours.publish(self._image(header, "rgb8", 3, colours.tobytes()))
        if self._jpegs.subscriber_count:
            from rwt.media.encoders.jpeg import encode_jpeg

            data = encode_jpeg(colours, _JPEG_QUALITY)
            self._jpegs.publish({"header": header, "format": "rgb8; jpeg compressed bgr8", "data": data})
        if depths is not None and self._points.subscriber_count and self._shots % _POINTS_EVERY == 0:
            from rwt.extensions.demo.world.view import point_cloud

            self._points.publish(point_cloud(header, depths, colours, self._lens, _POINTS_SKIP))

    @staticmethod
    def _is_heard(*topics: TopicPublisher) -> bool:
        return any(topic.subscriber_count for topic in topics)

    def _image(self, header: messages.Message, encoding: str, pixel: int, data: bytes) -> messages.Message:
        return {
            "header": header,
            "width": self._lens.width,
            "height": self._lens.height,
            "encoding": encoding,
            "is_bigendian": 0,
            "step": self._lens.width * pixel,
            "data": data,
        }
