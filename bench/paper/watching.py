"""Clients that watch the camera, each decoding in its own process what comes to it."""

from __future__ import annotations

import http.client
import io
import json
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Final

import av
import cbor2
import numpy as np
import pybase64
from av.codec.context import Flags
from PIL import Image
from websockets.sync.client import connect

from bench.paper.camera import TOPIC, Picture

Pictures = Generator[Picture, None, None]
"""Pictures that are decoded as they come, until it is closed."""

_PATIENCE: Final = 15.0


@dataclass(slots=True)
class Counted:
    """Bytes that came."""

    bytes: int = 0


def by_rosbridge(host: str, port: int, compression: str, counted: Counted) -> Pictures:
    """The raw topic through the protocol, `none` (JSON) or `cbor`."""
    with connect(f"ws://{host}:{port}", max_size=None, compression=None) as wire:
        wish = {"op": "subscribe", "topic": TOPIC, "compression": compression, "queue_length": 1}
        wire.send(json.dumps(wish))
        while True:
            frame = wire.recv(_PATIENCE)
            counted.bytes += len(frame)
            message: Any = cbor2.loads(frame) if isinstance(frame, bytes) else json.loads(frame)
            data = message["msg"]["data"]
            pixels = pybase64.b64decode(data) if isinstance(data, str) else data
            yield np.frombuffer(pixels, np.uint8).reshape(480, 640, 3)


class _Body(io.RawIOBase):
    """The body of an answer as a file, of which reading takes what is there."""

    def __init__(self, host: str, port: int, query: str, counted: Counted) -> None:
        super().__init__()
        self._connection = http.client.HTTPConnection(host, port, timeout=_PATIENCE)
        self._connection.request("GET", f"/stream?topic={TOPIC}&{query}")
        self._answer = self._connection.getresponse()
        self._counted = counted
        if self._answer.status != 200:
            raise RuntimeError(f"{query}: {self._answer.status} {self._answer.read().decode()}")

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1, /) -> bytes:
        data = self._answer.read1(size)
        self._counted.bytes += len(data)
        return data

    def close(self) -> None:
        self._connection.close()
        super().close()


def by_parts(host: str, port: int, query: str, counted: Counted) -> Pictures:
    """JPEG or PNG pictures of `/stream`."""
    with _Body(host, port, query, counted) as body:
        held = bytearray()
        while True:
            while (end := held.find(b"\r\n\r\n")) < 0:
                held += body.read(65536)
            head = bytes(held[:end]).lower()
            size = int(head.partition(b"content-length:")[2].split()[0])
            while len(held) < end + 4 + size:
                held += body.read(65536)
            picture = bytes(held[end + 4 : end + 4 + size])
            del held[: end + 4 + size]
            yield np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))


def by_video(host: str, port: int, query: str, counted: Counted) -> Pictures:
    """A video of `/stream`, decoded without waiting for more than each picture needs."""
    # The first picture is what the size is learnt from; `nobuffer` would throw it away, and it is the key.
    quick = {"probesize": "1000", "analyzeduration": "0"}
    with (
        _Body(host, port, query, counted) as body,
        av.open(body, "r", options=quick, buffer_size=4096) as file,
    ):
        stream = file.streams.video[0]
        stream.codec_context.thread_count = 1
        stream.codec_context.flags |= Flags.low_delay
        for frame in file.decode(stream):
            yield frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
