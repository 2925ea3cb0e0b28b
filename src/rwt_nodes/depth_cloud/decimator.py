"""A thinner copy of a point cloud topic, made while somebody listens to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rwt_graph import Graph, Node
from rwt_graph.qos import SENSOR_DATA
from rwt_nodes.depth_cloud.newest import Closable, NewestWork

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload

_CLOUD: Final = "sensor_msgs/PointCloud2"


class CloudDecimator:
    """Publishes fewer of the points of a `sensor_msgs/PointCloud2` topic.

    Args:
        graph: where the topics are.
        source: the topic with all points.
        topic: of the result; by default the source's name and `/decimated`.
        name: of the node.
        stride: every so many points are taken, of organised clouds every so many rows and columns.
        voxel: edge of a cube in metres of which one point is taken; 0 for none. It comes after `stride`.
    """

    def __init__(
        self,
        graph: Graph,
        source: str,
        topic: str | None = None,
        *,
        name: str = "cloud_decimator",
        stride: int = 1,
        voxel: float = 0.0,
    ) -> None:
        if stride < 1 or not 0 <= voxel < float("inf"):
            raise ValueError(
                f"expected a stride of 1 or more and a voxel of 0 m or more, got {stride} and {voxel}"
            )
        self._node = Node(graph, name)
        self._source = source
        self._stride = stride
        self._voxel = voxel
        clouds = self._node.advertise(topic or f"{source}/decimated", _CLOUD, SENSOR_DATA)
        self._work: NewestWork[Payload] = NewestWork(self._node, clouds, self._thin, self._listen)

    def close(self) -> None:
        """Leave the graph."""
        self._node.close()

    def _listen(self) -> tuple[Closable, ...]:
        subscription = self._node.subscribe(
            self._source,
            type=_CLOUD,
            qos=SENSOR_DATA,
            on_sample=lambda sample: self._work.offer(sample.payload.detach()),
        )
        return (subscription,)

    def _thin(self, payload: Payload) -> Mapping[str, object]:
        """Runs in a worker thread; numpy is loaded with the first listener."""
        from rwt_nodes.depth_cloud.point_cloud import cloud_of, every, one_per_voxel, read_points

        cloud: Any = payload.value()
        points = every(read_points(cloud), self._stride)
        return cloud_of(one_per_voxel(points, self._voxel) if self._voxel else points, cloud)
