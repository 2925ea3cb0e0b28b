"""`cv_bridge`: images as numpy arrays in OpenCV's layout. OpenCV itself is not needed.

Only conversions that change the order of channels are supported; use OpenCV for others.
"""

from __future__ import annotations

import sys
from typing import Any, Final

import numpy as np

from rwt_participant.images import ENCODINGS
from rwt_rclpy.messages.loaded import message_class

_DEPTHS: Final = {"8U": "u1", "8S": "i1", "16U": "u2", "16S": "i2", "32S": "i4", "32F": "f4", "64F": "f8"}


class CvBridgeError(TypeError):
    """An encoding is unknown, or a conversion is not supported."""


class CvBridge:
    """Converter between `sensor_msgs/Image` and arrays."""

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """Return the numpy type and number of channels. Raises CvBridgeError."""
        layout = ENCODINGS.get(encoding)
        if layout is not None:
            return layout.sample, layout.count
        depth, _, channels = encoding.partition("C")
        if depth in _DEPTHS and (channels.isdigit() or not channels):
            return _DEPTHS[depth], int(channels or 1)
        raise CvBridgeError(f"Unrecognized image encoding [{encoding}]")

    def imgmsg_to_cv2(self, img_msg: Any, desired_encoding: str = "passthrough") -> np.ndarray:
        """Return an image as an array of rows, columns and channels; a view if nothing is converted.

        Raises:
            CvBridgeError: the encoding is unknown, or the conversion is not supported.
        """
        name, channels = self.encoding_to_dtype_with_channels(img_msg.encoding)
        dtype = np.dtype(name).newbyteorder(">" if img_msg.is_bigendian else "<")
        rows = np.frombuffer(img_msg.data, np.uint8).reshape(img_msg.height, img_msg.step)
        pixels = (
            rows[:, : img_msg.width * channels * dtype.itemsize].copy()
            if (rows.shape[1] != img_msg.width * channels * dtype.itemsize)
            else rows
        )
        image = pixels.view(dtype).reshape(img_msg.height, img_msg.width, channels)
        if dtype.byteorder not in ("=", "|") and (dtype.byteorder == ">") != (sys.byteorder == "big"):
            image = image.astype(dtype.newbyteorder("="))
        image = image[..., 0] if channels == 1 else image
        if desired_encoding in ("passthrough", img_msg.encoding):
            return image
        return self._reordered(image, img_msg.encoding, desired_encoding)

    @staticmethod
    def _reordered(image: np.ndarray, present: str, wanted: str) -> np.ndarray:
        orders = ("rgb", "bgr", "rgba", "bgra")
        have, want = present.rstrip("0123456789"), wanted.rstrip("0123456789")
        same_depth = present.removeprefix(have) == wanted.removeprefix(want)
        if not same_depth or have not in orders or want not in orders or len(want) > len(have):
            raise CvBridgeError(f"{present} to {wanted}: convert with cv2.cvtColor, from 'passthrough'")
        channels = [have.index(letter) for letter in want]
        return np.ascontiguousarray(image[..., channels])

    def cv2_to_imgmsg(self, cvim: np.ndarray, encoding: str = "passthrough", header: Any = None) -> Any:
        """Return an array as an image. Raises CvBridgeError if the encoding does not fit the array."""
        channels = 1 if cvim.ndim == 2 else cvim.shape[2]
        depth = next((name for name, code in _DEPTHS.items() if np.dtype(code) == cvim.dtype), None)
        if depth is None:
            raise CvBridgeError(f"no encoding has numbers of type {cvim.dtype}")
        if encoding == "passthrough":
            encoding = f"{depth}C{channels}"
        elif self.encoding_to_dtype_with_channels(encoding) != (_DEPTHS[depth], channels):
            raise CvBridgeError(f"encoding {encoding} is not of {channels} channels of {cvim.dtype}")
        message: Any = message_class("sensor_msgs/Image")(
            height=cvim.shape[0],
            width=cvim.shape[1],
            encoding=encoding,
            is_bigendian=int(sys.byteorder == "big"),
            step=cvim.shape[1] * channels * cvim.itemsize,
            data=np.ascontiguousarray(cvim).tobytes(),
        )
        if header is not None:
            message.header = header
        return message

    def compressed_imgmsg_to_cv2(
        self, cmprs_img_msg: Any, desired_encoding: str = "passthrough"
    ) -> np.ndarray:
        """Return a compressed image as an array, decoded by Pillow, with channels in OpenCV's order."""
        from io import BytesIO

        from PIL import Image

        with Image.open(BytesIO(bytes(cmprs_img_msg.data))) as picture:
            pixels = np.asarray(picture.convert("L" if picture.mode == "L" else "RGB"))
        rgb = pixels if pixels.ndim == 2 else pixels[..., ::-1]
        if desired_encoding == "rgb8":
            return pixels
        return np.ascontiguousarray(rgb)
