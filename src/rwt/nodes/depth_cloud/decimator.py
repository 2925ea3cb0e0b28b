"""A decimated copy of a point cloud topic, made while it has subscribers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rwt.nodes.depth_cloud.latest_only import Closable, LatestOnly
from rwt.nodes.number_parameters import Number
from rwt_graph import Graph, Node
from rwt_participant.qos import SENSOR_DATA

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload

_CLOUD: Final = "sensor_msgs/PointCloud2"

STRIDE: Final = Number("stride", 1, 10_000, "", "Every so many points are taken.", whole=True)
VOXEL: Final = Number("voxel", 0.0, 1000.0, "m", "Edge of a cube of which one point is taken; 0 for none.")


class CloudDecimator:
    """Publishes fewer of the points of a `sensor_msgs/PointCloud2` topic, while the result has subscribers.

    Points keep their fields. `stride` and `voxel` are ROS parameters and can be changed while it works.

    Args:
        graph: where the topics are.
        source: the topic with all points.
        topic: of the result; by default the source's name and `/decimated`.
        name: of the node.
        namespace: of the node, which names without a slash at their beginning are relative to.
        stride: every so many points are taken, of organised clouds every so many rows and columns.
        voxel: edge of a cube in metres of which one point is taken; 0 for none. It comes after `stride`, and
            what it leaves is one row of points that all have a place.

    Raises:
        ParameterRejected: a number that the parameter of this name does not take.
    """

    def __init__(
        self,
        graph: Graph,
        source: str,
        topic: str | None = None,
        *,
        name: str = "cloud_decimator",
        namespace: str = "/",
        stride: int = 1,
        voxel: float = 0.0,
    ) -> None:
        self._node = Node(graph, name, namespace)
        self._source = source
        STRIDE.declare(self._node, stride, self._set_stride)
        VOXEL.declare(self._node, voxel, self._set_voxel)
        clouds = self._node.advertise(topic or f"{source}/decimated", _CLOUD, qos=SENSOR_DATA)
        self._work: LatestOnly[Payload] = LatestOnly(self._node, clouds, self._thin, self._listen)

    def close(self) -> None:
        """Leave the graph."""
        self._node.close()

    def _set_stride(self, points: float) -> None:
        self._stride = int(points)

    def _set_voxel(self, metres: float) -> None:
        self._voxel = metres

    def _listen(self) -> tuple[Closable, ...]:
        subscription = self._node.subscribe_samples(
            self._source,
            type=_CLOUD,
            qos=SENSOR_DATA,
            on_sample=lambda sample: self._work.offer(sample.payload.detach()),
        )
        return (subscription,)

    def _thin(self, payload: Payload) -> Mapping[str, object]:
        """Decimate one cloud. Runs in a worker thread; numpy is loaded with the first subscriber."""
        from rwt.nodes.depth_cloud.point_cloud import cloud_of, every, one_per_voxel, read_points

        cloud: Any = payload.value()
        points = every(read_points(cloud), self._stride)
        voxel = self._voxel  # It may be changed meanwhile.
        if not voxel:
            return cloud_of(points, cloud)
        return cloud_of(one_per_voxel(points, voxel), cloud, is_dense=True)
