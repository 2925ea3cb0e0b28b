"""The camera's topics: `/camera/image_raw`, `/camera/depth/image_raw` and their camera infos."""

from __future__ import annotations

from typing import TYPE_CHECKING

import anyio.to_thread

from husky_xarm.camera import Picture, Renderer, RendererGone
from husky_xarm.description import OPTICAL
from husky_xarm.simulation import Simulation
from rwt import SENSOR_DATA, Node
from rwt.extensions.demo import messages
from rwt.extensions.demo.world.lens import Lens

if TYPE_CHECKING:
    from husky_xarm.scene import Snapshot


class CameraPublisher:
    """Publishes them while somebody listens; colour and depth are of the same pixels and the same moment.

    The process that draws is started by the first listener. If a picture takes longer than the time to the
    next, pictures are left out.

    Args:
        rate: pictures a second, at most.
    """

    def __init__(self, node: Node, simulation: Simulation, lens: Lens, rate: float) -> None:
        self._node = node
        self._simulation = simulation
        self._lens = lens
        self._renderer: Renderer | None = None
        self._closed = False
        self._colours = node.advertise("/camera/image_raw", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._depths = node.advertise("/camera/depth/image_raw", "sensor_msgs/Image", qos=SENSOR_DATA)
        self._infos = [
            node.advertise(f"/camera/{kind}camera_info", "sensor_msgs/CameraInfo", qos=SENSOR_DATA)
            for kind in ("", "depth/")
        ]
        node.create_timer(1 / rate, self._shoot)

    def close(self) -> None:
        """End the process that draws."""
        self._closed = True
        if self._renderer is not None:
            self._renderer.close()

    async def _shoot(self) -> None:
        header = messages.header(self._node.clock.time_ns(), OPTICAL)
        for infos in self._infos:
            if infos.subscriber_count:
                infos.publish(self._lens.camera_info(header, self._node.distro))
        if not (self._colours.subscriber_count or self._depths.subscriber_count):
            return
        snapshot = self._simulation.snapshot()
        try:
            picture = await anyio.to_thread.run_sync(self._draw, snapshot)
        except RendererGone:
            if not self._closed:
                self._node.log.error(
                    "the process that draws the camera's pictures has ended; starting another"
                )
                self._renderer = None
            return
        self._publish(header, picture)

    def _draw(self, snapshot: Snapshot) -> Picture:
        """Runs in a worker thread; a timer's coroutine is never run twice at a time, so neither is this."""
        if self._renderer is None:
            self._renderer = Renderer(self._lens)
            if self._closed:  # while it was started
                self._renderer.close()
        return self._renderer.draw(snapshot)

    def _publish(self, header: messages.Message, picture: Picture) -> None:
        if self._depths.subscriber_count:
            self._depths.publish(self._image(header, "16UC1", 2, picture.depths.tobytes()))
        if self._colours.subscriber_count:
            self._colours.publish(self._image(header, "rgb8", 3, picture.colours.tobytes()))

    def _image(self, header: messages.Message, encoding: str, pixel: int, data: bytes) -> messages.Message:
        """`sensor_msgs/Image` of pixels of so many bytes, low byte first."""
        return {
            "header": header,
            "width": self._lens.width,
            "height": self._lens.height,
            "encoding": encoding,
            "is_bigendian": 0,
            "step": self._lens.width * pixel,
            "data": data,
        }
