"""The depth-cloud encoder: two image topics become one, which is streamed to `ROS3D.DepthCloud` as a video."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from rwt_graph import Graph, Node, Sample
from rwt_graph.qos import SENSOR_DATA
from rwt_nodes.depth_cloud.newest import Closable, NewestWork

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rwt_interfaces.payload import Payload

_NANOSECONDS: Final = 1_000_000_000
_IMAGE: Final = "sensor_msgs/Image"


class DepthCloudEncoder:
    """Publishes depth and colour as one picture, while somebody listens.

    A depth image goes with the latest colour image if their times are `slop` seconds apart at most. Both lie
    on the same pixels (registered), and the middle of both is taken. :mod:`rwt_nodes.depth_cloud.picture` says
    what the picture looks like.

    Args:
        graph: where the topics are.
        depth: topic of `sensor_msgs/Image`, 16UC1 (millimetres) or 32FC1 (metres).
        colour: topic of `sensor_msgs/Image`.
        topic: of the result.
        name: of the node.
        crop_size: edge of the square that is taken out of both, pixels.
        target_resolution: edge of a tile; the picture is twice as large.
        max_depth_per_tile: metres that one of the two depth tiles spans.
        slop: seconds.
    """

    def __init__(
        self,
        graph: Graph,
        depth: str = "/camera/depth/image_raw",
        colour: str = "/camera/image_raw",
        *,
        topic: str = "/depthcloud_encoded",
        name: str = "depthcloud_encoder",
        crop_size: int = 512,
        target_resolution: int = 512,
        max_depth_per_tile: float = 1.0,
        slop: float = 0.05,
    ) -> None:
        self._node = Node(graph, name)
        self._topics = (depth, colour)
        self._crop = crop_size
        self._size = target_resolution
        self._depth_per_tile = max_depth_per_tile
        self._slop_ns = round(slop * _NANOSECONDS)
        self._latest: dict[str, tuple[int, Payload]] = {}
        pictures = self._node.advertise(topic, _IMAGE, SENSOR_DATA)
        self._work: NewestWork[tuple[Payload, Payload]] = NewestWork(
            self._node, pictures, self._encode, self._listen
        )

    def close(self) -> None:
        """Leave the graph."""
        self._node.close()

    def _listen(self) -> tuple[Closable, ...]:
        self._latest.clear()
        return tuple(
            self._node.subscribe(topic, type=_IMAGE, qos=SENSOR_DATA, on_sample=partial(self._take, topic))
            for topic in self._topics
        )

    def _take(self, topic: str, sample: Sample) -> None:
        """Hand on the two latest if they belong together; each is used once."""
        self._latest[topic] = stamp_ns(sample.payload), sample.payload.detach()
        if len(self._latest) < len(self._topics):
            return
        (depth_at, depth), (colour_at, colour) = (self._latest[topic] for topic in self._topics)
        if abs(depth_at - colour_at) <= self._slop_ns:
            self._latest.clear()
            self._work.offer((depth, colour))

    def _encode(self, pair: tuple[Payload, Payload]) -> Mapping[str, object]:
        """Runs in a worker thread; numpy is loaded with the first listener."""
        from rwt_nodes.depth_cloud.depths import read_depths, square
        from rwt_nodes.depth_cloud.picture import encode_picture

        depth: Any = pair[0].value()
        depths = square(read_depths(depth), self._crop, self._size)
        colours = square(_colours(pair[1].value()), self._crop, self._size)
        picture = encode_picture(depths, colours, self._depth_per_tile)
        edge = 2 * self._size
        return {
            "header": depth.header,
            "height": edge,
            "width": edge,
            "encoding": "rgb8",
            "is_bigendian": 0,
            "step": 3 * edge,
            "data": picture.tobytes(),
        }


def stamp_ns(payload: Payload) -> int:
    """The time in the message's header, nanoseconds, however the distribution spells it."""
    message: Any = payload.value()
    stamp = message.header.stamp
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)
    return int(stamp.secs) * _NANOSECONDS + int(stamp.nsecs)


def _colours(message: Any) -> NDArray[Any]:
    """A picture's red, green and blue."""
    import numpy as np

    from rwt_nodes.video.pixels import read_raw

    shown = read_raw(message)
    return np.repeat(shown[:, :, None], 3, axis=2) if shown.ndim == 2 else shown[:, :, :3]
