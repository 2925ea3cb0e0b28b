"""What the depth camera sees as coloured points. Imported with the first listener: it loads numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rwt_nodes.demo.messages import Message
from rwt_nodes.demo.world.lens import Lens

_FLOAT32 = 7
"""A constant of `sensor_msgs/PointField`."""

_FIELDS = ("x", "y", "z", "rgb")
_STEP = 4 * len(_FIELDS)


def point_cloud(
    header: Message, depths: NDArray[np.uint16], colours: NDArray[np.uint8], lens: Lens, skip: int
) -> Message:
    """`sensor_msgs/PointCloud2`, organised as the picture; NaN where no depth was measured.

    Points are in the optical frame: x to the right, y down, z forwards, metres. `rgb` is the bytes blue,
    green, red and 0 taken as a float, as PCL has it.

    Args:
        header: of the message.
        depths: rows x columns, millimetres; 0 is unknown.
        colours: rows x columns x red, green, blue.
        lens: that both were taken through.
        skip: every so many rows and columns become points.
    """
    down, across = (
        (np.arange(0, count, skip, dtype=np.float32) - np.float32(centre)) / np.float32(lens.focal)
        for count, centre in zip(depths.shape, (lens.cy, lens.cx), strict=True)
    )
    depths, colours = depths[::skip, ::skip], colours[::skip, ::skip]
    rows, columns = depths.shape
    points = np.empty((rows, columns, len(_FIELDS)), "<f4")
    z = depths.astype(np.float32) * np.float32(0.001)
    z[depths == 0] = np.nan
    np.multiply(z, across, out=points[:, :, 0])
    np.multiply(z, down[:, None], out=points[:, :, 1])
    points[:, :, 2] = z
    packed = points.view(np.uint8)
    packed[:, :, 12:15] = colours[:, :, ::-1]
    packed[:, :, 15] = 0
    return {
        "header": header,
        "height": rows,
        "width": columns,
        "fields": [
            {"name": name, "offset": 4 * number, "datatype": _FLOAT32, "count": 1}
            for number, name in enumerate(_FIELDS)
        ],
        "is_bigendian": False,
        "point_step": _STEP,
        "row_step": _STEP * columns,
        "data": points.tobytes(),
        "is_dense": False,
    }
