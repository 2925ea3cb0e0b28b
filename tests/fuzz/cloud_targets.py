"""Compressed point clouds, as another program sends them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import zstandard

from rwt_interfaces import Registry
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.point_clouds.compressed import compress, decompress
from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.wish import COMPRESSED, DRACO, CloudWish

MOST_BYTES = 1 << 20
_REGISTRY = Registry(JAZZY)
_COMPRESSED = _REGISTRY.message(COMPRESSED)
_CLOUD = _REGISTRY.message("sensor_msgs/PointCloud2")


def compressed_cloud(data: bytes) -> None:
    """A compressed cloud in CDR; with 1 as the first byte, its planes are not compressed."""
    try:
        value: Any = Payload.from_cdr(_COMPRESSED, data[1:]).value()
        message = SimpleNamespace(**{name: getattr(value, name) for name in value.__struct_fields__})
        if data[0] == 1:
            whole = bytes(message.compressed_data)
            head = 16 + 10 * int.from_bytes(whole[6:8], "little")
            message.compressed_data = whole[:head] + zstandard.compress(whole[head:])
        found = decompress(message, MOST_BYTES)
    except (InvalidMessage, InvalidCloud) as error:
        assert 0 < len(str(error)) < 4_000
        return
    cloud: Any = Payload.from_value(_CLOUD, found).value()
    assert len(cloud.data) == cloud.row_step * cloud.height <= MOST_BYTES
    again: Any = Payload.from_value(_COMPRESSED, compress(cloud, CloudWish(precision=0, order="any"))).value()
    assert decompress(again)["width"] == cloud.width
    for order in ("keep", "any"):
        wish = CloudWish(order=order, format=DRACO)
        small: Any = Payload.from_value(_COMPRESSED, compress(cloud, wish)).value()
        assert decompress(small)["width"] <= cloud.width * max(1, cloud.height)
