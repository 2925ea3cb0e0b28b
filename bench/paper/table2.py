"""Table II: depth and colour as one video, what it takes and how wrong depths become."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import av
import numpy as np
from av.video.codeccontext import VideoCodecContext
from numpy.typing import NDArray

from bench.paper.depth_scene import LENS, RATE, Shot, drive
from bench.paper.report import Report
from rwt.extensions.depth_cloud.depth_image import DepthImage, decode_image, encode_image, square
from rwt.media.encoders.encoded import Encoded, Encoder
from rwt.media.encoders.image import ImageEncoder
from rwt.media.encoders.video import VideoEncoder
from rwt.media.stream_request import Video, read_request
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

Picture = NDArray[np.uint8]

PICTURES: Final = 3 * RATE
CROP, SIZE, METRES_PER_TILE = LENS.height, 512, 3.0
PAPER_RAW, PAPER_ENCODED = 5_591, 568
RAW: Final = LENS.width * LENS.height * (2 + 3) * RATE / 1000
"""KB/s of depth and colour as the camera gives them."""
_WARM_UP: Final = RATE // 2
"""Pictures in which a codec finds its rate; they are not counted."""
_MULTIPART: Final = 110
"""Bytes around each picture of a stream of parts."""

_NOTES: Final = f"""\
{{seconds:g}} s at {RATE} Hz, 640x480, drawn, with the noise and the shadows of a structured-light sensor; one
picture of {2 * SIZE}x{2 * SIZE} of the middle {CROP}x{CROP}, two tiles of {METRES_PER_TILE:g} m.
Errors are of depths that were measured, after the video was decoded again, from what was measured: a codec
that smooths the sensor's noise away is charged for it. "rainbow" is the picture as other encoders colour it.
ms are CPU time of encoding; drawing is not in it, and making the picture has a row of its own.
The paper's raw is its own figure; 640x480 of depth and colour at 30 Hz are what the third row says.
"""


@dataclass(slots=True)
class Way:
    """One way to send the picture.

    Attributes:
        name: for the table.
        query: what a page asks the video node for.
        colour: changes the picture before it is sent.
        bytes: sent after the warm-up.
        seconds: CPU time of encoding.
        errors: metres, of every measured depth.
        lost: share of the measured depths that are masked, picture by picture.
    """

    name: str
    query: str
    colour: Callable[[Picture], Picture] | None = None
    bytes: int = 0
    seconds: float = 0.0
    errors: list[NDArray[np.float32]] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)

    def rate(self, pictures: int) -> float:
        """KB/s, of 1000 bytes."""
        return self.bytes / 1000 / (pictures - _WARM_UP) * RATE


def rainbow(picture: Picture) -> Picture:
    """The depth tiles with blue filled first, then green, then red; a reader reads the same."""
    other = picture.copy()
    total = picture[:SIZE].astype(np.int16).sum(axis=2, dtype=np.int16)
    other[:SIZE] = np.stack([np.clip(total - below, 0, 255) for below in (510, 255, 0)], axis=2)
    return other


def ways() -> list[Way]:
    """Every codec, thinner to thicker."""
    videos = [
        Way(f"{name} {megabits} Mbit/s", f"type={codec}&bitrate={megabits}000000&qmin=4")
        for name, codec in (("VP8", "vp8"), ("VP9", "vp9"), ("H.264", "h264"))
        for megabits in (1, 2, 4)
    ]
    return [
        *(Way(f"MJPEG q{quality}", f"type=mjpeg&quality={quality}") for quality in (50, 90)),
        *videos,
        Way("VP8 4 Mbit/s, rainbow", "type=vp8&bitrate=4000000&qmin=4", rainbow),
        Way("PNG", "type=png"),
    ]


class Line:
    """One way's encoder, and a viewer that decodes again what comes out of it."""

    def __init__(self, way: Way) -> None:
        self._way = way
        stream = read_request(f"topic=/depthcloud_encoded&{way.query}")
        coding = stream.coding
        self._encoder: Encoder
        if isinstance(coding, Video):
            self._encoder = VideoEncoder(stream, coding, lambda pixels: None)
        else:
            self._encoder = ImageEncoder(stream, coding)
        self._decoder: VideoCodecContext | None = None

    def send(self, number: int, payload: Payload, shot: DepthImage) -> None:
        """Encode one picture, decode it, and note what it took and what it lost."""
        before = time.process_time()
        encoded = self._encoder.encode(payload, number * 1000 // RATE, key=number == 0)
        spent = time.process_time() - before
        if encoded is None:
            return
        found = decode_image(self._shown(encoded), METRES_PER_TILE)
        if number >= _WARM_UP:
            self._way.bytes += len(encoded.data) + (0 if encoded.track else _MULTIPART)
            self._way.seconds += spent
            both = shot.valid & found.valid
            self._way.errors.append(np.abs(found.depths[both] - shot.depths[both]))
            self._way.lost.append(1 - np.count_nonzero(both) / np.count_nonzero(shot.valid))

    def _shown(self, encoded: Encoded) -> Picture:
        if encoded.track is None:
            from PIL import Image

            return np.asarray(Image.open(BytesIO(encoded.data)))
        if self._decoder is None:
            decoder = av.CodecContext.create(encoded.track.codec, "r")
            assert isinstance(decoder, VideoCodecContext)
            if encoded.track.parameters:
                decoder.extradata = encoded.track.parameters
            self._decoder = decoder
        (frame,) = self._decoder.decode(av.Packet(encoded.data))
        return np.asarray(frame.to_ndarray(format="rgb24"))


def _cropped(shot: Shot) -> DepthImage:
    depths = square((shot.depths * np.float32(0.001)).astype(np.float32), CROP, SIZE)
    # Beyond both tiles nothing is sent, in whatever codec.
    valid = (depths > 0) & (depths < 1.98 * METRES_PER_TILE)
    return DepthImage(depths, valid, square(shot.colours, CROP, SIZE))


def _payload(registry: Registry, picture: Picture) -> Payload:
    edge = picture.shape[0]
    message: dict[str, Any] = {
        "height": edge, "width": edge, "encoding": "rgb8", "step": 3 * edge, "data": picture.tobytes()
    }  # fmt: skip
    return Payload.from_value(registry.message("sensor_msgs/Image"), message)


def play(all_ways: Sequence[Way], pictures: int) -> float:
    """Send all pictures every way; the CPU seconds of making one picture."""
    registry, spent = Registry(), 0.0
    lines = [(way, Line(way)) for way in all_ways]
    for number, shot in enumerate(drive(pictures)):
        cropped = _cropped(shot)
        before = time.process_time()
        picture = encode_image(cropped.depths, cropped.colours, METRES_PER_TILE)
        spent += time.process_time() - before
        plain = _payload(registry, picture)
        for way, line in lines:
            line.send(number, _payload(registry, way.colour(picture)) if way.colour else plain, cropped)
    return spent / pictures


def measure(pictures: int = PICTURES) -> Report:
    """The table."""
    all_ways = ways()
    making = play(all_ways, pictures)
    rows = [
        ("paper: raw", f"{PAPER_RAW:,}", "", "", "", "", ""),
        ("paper: encoded, VP8", f"{PAPER_ENCODED:,}", f"{1 - PAPER_ENCODED / PAPER_RAW:.1%}", "", "", "", ""),
        ("raw depth and colour", f"{RAW:,.0f}", "", "", "", "", ""),
        ("the picture", f"{3 * (2 * SIZE) ** 2 * RATE / 1000:,.0f}", "", "", "", "", f"{making * 1000:.1f}"),
        *(row_of(way, pictures) for way in all_ways),
    ]
    return Report(
        "Table II: depth and colour of a camera as one stream",
        ("", "KB/s", "less", "RMS mm", "95 % mm", "masked", "ms"),
        rows,
        (_NOTES.format(seconds=pictures / RATE),),
        out_of_bounds(all_ways, pictures),
        partial(_plot, all_ways, pictures),
    )


def row_of(way: Way, pictures: int) -> tuple[str, ...]:
    rms, most = errors_of(way)
    return (
        way.name,
        f"{way.rate(pictures):,.0f}",
        f"{1 - way.rate(pictures) / RAW:.1%}",
        f"{rms * 1000:.1f}",
        f"{most * 1000:.1f}",
        f"{float(np.mean(way.lost)):.2%}",
        f"{way.seconds / (pictures - _WARM_UP) * 1000:.1f}",
    )


def errors_of(way: Way) -> tuple[float, float]:
    """Root of the mean square, and what 95 of 100 are below; metres."""
    errors = np.concatenate(way.errors)
    return float(np.sqrt(np.mean(errors.astype(np.float64) ** 2))), float(np.percentile(errors, 95))


def out_of_bounds(all_ways: Sequence[Way], pictures: int) -> list[str]:
    """A video takes no more than the paper's, whose raw was far less."""
    return [
        f"{way.name}: {way.rate(pictures):.0f} KB/s, the paper {PAPER_ENCODED}"
        for way in all_ways
        if "bitrate" in way.query and way.rate(pictures) > PAPER_ENCODED
    ]


def _plot(all_ways: Sequence[Way], pictures: int, file: Path) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 4.5), layout="constrained")
    for way in all_ways:
        rms, _ = errors_of(way)
        axes.plot(way.rate(pictures), rms * 1000, "o")
        axes.annotate(way.name, (way.rate(pictures), rms * 1000), xytext=(4, 4), textcoords="offset points")
    axes.axvline(PAPER_ENCODED, color="grey", linestyle="--", label="paper, encoded")
    axes.axvline(PAPER_RAW, color="grey", linestyle=":", label="paper, raw")
    axes.set(xscale="log", yscale="log", xlabel="KB/s", ylabel="RMS of depth, mm", title="Depth clouds")
    axes.legend()
    figure.savefig(file, dpi=120)
    pyplot.close(figure)
