"""Depth-cloud encoder: combines depth and colour images into one topic for `ROS3D.DepthCloud`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from rwt.extensions.depth_cloud.latest_only import LatestOnly
from rwt_graph import Graph, Node, Sample
from rwt_graph.parameters.number_parameters import Number
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.handles import Handle
from rwt_participant.qos import SENSOR_DATA
from rwt_tf2 import stamp_ns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rwt_interfaces.payload import Payload

_IMAGE: Final = "sensor_msgs/Image"

CROP_SIZE: Final = Number(
    "crop_size", 2, 4096, "", "Edge of the square taken out of both images, pixels.", whole=True
)
TARGET_RESOLUTION: Final = Number(
    "target_resolution", 2, 2048, "", "Edge of a tile, pixels; the picture is twice as large.", whole=True
)
MAX_DEPTH_PER_TILE: Final = Number(
    "max_depth_per_tile", 0.01, 1000.0, "m", "Depth that one of the two depth tiles spans."
)


class DepthCloudEncoder(Node):
    """Node that publishes depth and colour as one image, while it has subscribers.

    A depth image is combined with the latest colour image if their stamps differ by at most `slop` seconds.
    Both must be registered (same pixels); the centre of both is used.
    :mod:`rwt.extensions.depth_cloud.depth_image` describes the layout of the result.

    Node, topic and parameters have the names of ROS 1's `depthcloud_encoder`; `crop_size`,
    `target_resolution` and `max_depth_per_tile` are ROS parameters and can be changed while it works.

    Args:
        depth: topic of `sensor_msgs/Image`, 16UC1 (millimetres) or 32FC1 (metres).
        colour: topic of `sensor_msgs/Image`.
        topic: topic of the result, `sensor_msgs/Image` of rgb8.
        namespace: namespace of the node; relative names are resolved in it.
        crop_size: edge of the square crop of both images, in pixels; black outside the images.
        target_resolution: edge of a tile in pixels; the image is twice as large.
        max_depth_per_tile: range of one depth tile in metres.
        slop: maximum difference of the stamps in seconds.

    Raises:
        ParameterRejected: a number is out of range.
    """

    def __init__(
        self,
        graph: Graph,
        depth: str = "camera/depth/image_raw",
        colour: str = "camera/image_raw",
        *,
        topic: str = "depthcloud_encoded",
        name: str = "depthcloud_encoder",
        namespace: str = "/",
        crop_size: int = 512,
        target_resolution: int = 512,
        max_depth_per_tile: float = 1.0,
        slop: float = 0.05,
    ) -> None:
        super().__init__(graph, name, namespace)
        self._topics = (depth, colour)
        self._crop, self._size, self._depth_per_tile = crop_size, target_resolution, max_depth_per_tile
        CROP_SIZE.declare(self, crop_size, partial(setattr, self, "_crop"))
        TARGET_RESOLUTION.declare(self, target_resolution, partial(setattr, self, "_size"))
        MAX_DEPTH_PER_TILE.declare(self, max_depth_per_tile, partial(setattr, self, "_depth_per_tile"))
        self._slop_ns = round(slop * NANOSECONDS)
        self._latest: dict[str, tuple[int, Payload]] = {}
        images = self.advertise(topic, _IMAGE, qos=SENSOR_DATA)
        self._work: LatestOnly[tuple[Payload, Payload]] = LatestOnly(
            self, images, self._encode, self._subscribe_inputs
        )

    def configure(self, crop_size: int, target_resolution: int, max_depth_per_tile: float) -> None:
        """Set all three parameters; see :class:`DepthCloudEncoder`.

        Raises:
            ParameterRejected: one is out of range.
        """
        for number, value in (
            (CROP_SIZE, crop_size),
            (TARGET_RESOLUTION, target_resolution),
            (MAX_DEPTH_PER_TILE, max_depth_per_tile),
        ):
            self.parameters.set(number.name, value)

    def _subscribe_inputs(self) -> tuple[Handle, ...]:
        self._latest.clear()
        return tuple(
            self.subscribe_samples(topic, type=_IMAGE, qos=SENSOR_DATA, on_sample=partial(self._take, topic))
            for topic in self._topics
        )

    def _take(self, topic: str, sample: Sample) -> None:
        message: Any = sample.payload.value()
        self._latest[topic] = stamp_ns(message.header.stamp), sample.payload.detach()
        if len(self._latest) < len(self._topics):
            return
        (depth_at, depth), (colour_at, colour) = (self._latest[topic] for topic in self._topics)
        if abs(depth_at - colour_at) <= self._slop_ns:
            self._latest.clear()
            self._work.offer((depth, colour))

    def _encode(self, pair: tuple[Payload, Payload]) -> Mapping[str, object]:
        """Encode one image. Runs in a worker thread; numpy is loaded with the first subscriber."""
        from rwt.extensions.depth_cloud.depth_image import encode_image, read_depths, square

        depth: Any = pair[0].value()
        crop, size = self._crop, self._size  # They may be changed meanwhile.
        depths = square(read_depths(depth), crop, size)
        colours = square(_colours(pair[1].value()), crop, size)
        image = encode_image(depths, colours, self._depth_per_tile)
        edge = 2 * size
        return {
            "header": depth.header,
            "height": edge,
            "width": edge,
            "encoding": "rgb8",
            "is_bigendian": 0,
            "step": 3 * edge,
            "data": image.tobytes(),
        }


def _colours(message: Any) -> NDArray[Any]:
    import numpy as np

    from rwt.media.encoders.pixels import read_raw

    shown = read_raw(message)
    return np.repeat(shown[:, :, None], 3, axis=2) if shown.ndim == 2 else shown[:, :, :3]
