"""Decimated copy of a point cloud topic."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Final

from rwt.extensions.depth_cloud.latest_only import LatestOnly
from rwt_graph import Graph, Node
from rwt_graph.parameters.number_parameters import Number
from rwt_interfaces.payload import Payload
from rwt_participant.handles import Handle
from rwt_participant.qos import SENSOR_DATA

_CLOUD: Final = "sensor_msgs/PointCloud2"

STRIDE: Final = Number("stride", 1, 10_000, "", "Every so many points are taken.", whole=True)
VOXEL: Final = Number("voxel", 0.0, 1000.0, "m", "Edge of a cube of which one point is taken; 0 for none.")


class CloudDecimator(Node):
    """Node that publishes fewer points of a `sensor_msgs/PointCloud2` topic, while it has subscribers.

    Points keep their fields. `stride` and `voxel` are ROS parameters and can be changed while it works.

    Args:
        source: topic with all points.
        topic: topic of the result; by default the name of the source and `/decimated`.
        namespace: namespace of the node; relative names are resolved in it.
        stride: take every n-th point; in organised clouds every n-th row and column.
        voxel: edge in metres of the cubes of which one point each is taken; 0 for none. Applied after
            `stride`; the result is one row of finite points.

    Raises:
        ParameterRejected: a number is out of range.
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
        super().__init__(graph, name, namespace)
        self._source = source
        self._stride, self._voxel = stride, voxel
        STRIDE.declare(self, stride, partial(setattr, self, "_stride"))
        VOXEL.declare(self, voxel, partial(setattr, self, "_voxel"))
        clouds = self.advertise(topic or f"{source}/decimated", _CLOUD, qos=SENSOR_DATA)
        self._work: LatestOnly[Payload] = LatestOnly(self, clouds, self._thin, self._subscribe_inputs)

    def _subscribe_inputs(self) -> tuple[Handle, ...]:
        subscription = self.subscribe_samples(
            self._source,
            type=_CLOUD,
            qos=SENSOR_DATA,
            on_sample=lambda sample: self._work.offer(sample.payload.detach()),
        )
        return (subscription,)

    def _thin(self, payload: Payload) -> Mapping[str, object]:
        """Decimate one cloud. Runs in a worker thread; numpy is loaded with the first subscriber."""
        from rwt_interfaces.point_clouds.records import cloud_of, every, one_per_voxel, read_points

        cloud = payload.value()
        points = every(read_points(cloud), self._stride)
        voxel = self._voxel  # It may be changed meanwhile.
        if not voxel:
            return cloud_of(points, cloud)
        return cloud_of(one_per_voxel(points, voxel), cloud, is_dense=True)
