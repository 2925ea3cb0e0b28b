"""CPU time of a message that must be completed or converted, from bytes to bytes, without a network.

Every figure is process CPU time, the best of seven runs. Beside it stands what `msgspec.json.decode` and
`encode` of the same bytes take, without a look at any type, and what the complete message of the same type
takes, which is passed on unchanged. Large messages cost several times as much where the allocator gives
memory back after each: MALLOC_MMAP_THRESHOLD_=131072 in the environment shows that (glibc).

Example: python -m bench.message.completion --only Image
"""

from __future__ import annotations

import argparse
import base64
import json
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from rwt_graph.api import Sample
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_protocol.codecs.base import PublishEncoder
from rwt_protocol.codecs.bson import BsonCodec
from rwt_protocol.codecs.cbor import CborCodec, raw_publish_encoder
from rwt_protocol.codecs.json import JsonCodec
from rwt_protocol.limits import WireLimits

RUNS = 7
#: Process CPU time that one run takes at least, in seconds.
RUN_SECONDS = 0.02
TOPIC = "/large"
HEADER = {"stamp": {"sec": 1_700_000_000, "nanosec": 500_000_000}, "frame_id": "camera"}
REGISTRY = Registry(JAZZY)
NOETIC_REGISTRY = Registry(NOETIC)

ENCODERS: dict[str, PublishEncoder] = {
    "JSON": JsonCodec().publish_encoder(TOPIC),
    "CBOR": CborCodec().publish_encoder(TOPIC),
    "cbor-raw": raw_publish_encoder(TOPIC),
    "BSON": BsonCodec().publish_encoder(TOPIC),
}

#: Encodings of the cases that leave in all of them.
ALL = tuple(ENCODERS)

Messages = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One message and the encodings that it leaves in.

    Attributes:
        label: what is special about it.
        type: two-part name.
        message: as its publisher writes it, in JSON's terms.
        complete: the same with everything in place.
        outputs: encodings by name.
    """

    label: str
    type: str
    message: Messages
    complete: Messages
    outputs: tuple[str, ...] = ("JSON",)
    registry: Registry = REGISTRY


def without(message: Messages, *names: str) -> Messages:
    return {name: value for name, value in message.items() if name not in names}


def cases() -> Iterator[Case]:
    """Yield messages as robots' programs send them, complete and incomplete."""
    source = random.Random(1)
    yield from _images(source)
    yield from _clouds(source)
    yield from _compressed_images(source)
    yield from _strings(source)
    yield from _scans(source)
    yield from _maps(source)


def _images(source: random.Random) -> Iterator[Case]:
    image = {
        "header": HEADER,
        "height": 480,
        "width": 640,
        "encoding": "rgb8",
        "is_bigendian": 0,
        "step": 1920,
        "data": base64.b64encode(source.randbytes(921_600)).decode(),
    }
    name = "sensor_msgs/Image"
    yield Case("Image, complete", name, image, image, ALL)
    yield Case("Image, no stamp", name, {**image, "header": {"frame_id": "camera"}}, image, ALL)
    roslibpy = {"seq": 7, "stamp": {"secs": 1_700_000_000, "nsecs": 5}, "frame_id": "camera"}
    yield Case("Image, other spellings", name, {**image, "header": roslibpy}, image)
    yield Case("Image, no header", name, without(image, "header", "is_bigendian"), image)
    old = {**image, "header": roslibpy}
    yield Case("Image of ROS 1, no seq", name, {**image, "header": without(roslibpy, "seq")}, old,
               registry=NOETIC_REGISTRY)  # fmt: skip


def _clouds(source: random.Random) -> Iterator[Case]:
    fields = [
        {"name": axis, "offset": 4 * place, "datatype": 7, "count": 1} for place, axis in enumerate("xyz")
    ]
    cloud = {
        "header": HEADER,
        "height": 1,
        "width": 60_000,
        "fields": fields,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 720_000,
        "data": base64.b64encode(source.randbytes(720_000)).decode(),
        "is_dense": True,
    }
    yield Case("PointCloud2, no fields", "sensor_msgs/PointCloud2", without(cloud, "fields"), cloud)


def _compressed_images(source: random.Random) -> Iterator[Case]:
    jpeg = {
        "header": HEADER,
        "format": "jpeg",
        "data": base64.b64encode(source.randbytes(200_000)).decode(),
    }
    compressed = "sensor_msgs/CompressedImage"
    yield Case("CompressedImage, no stamp", compressed, {**jpeg, "header": {}}, jpeg, ALL)


def _strings(source: random.Random) -> Iterator[Case]:
    text = {"data": "".join(source.choices("abcdefghijklmnopqrstuvwxyz 0123456789", k=1_000_000))}
    yield Case("String 1 MB", "std_msgs/String", text, text, ALL)
    lines = {"data": "".join(source.choices('abcdefghij\n"é', k=1_000_000))}
    yield Case("String 1 MB, escapes", "std_msgs/String", lines, lines, ALL)


def _scans(source: random.Random) -> Iterator[Case]:
    ranges = [source.randrange(8 << 6, 9 << 6) / 64 for _ in range(10_000)]
    scan = {
        "header": HEADER,
        "angle_min": -3.0,
        "angle_max": 3.0,
        "angle_increment": 0.015625,
        "time_increment": 0.0,
        "scan_time": 0.125,
        "range_min": 0.125,
        "range_max": 10.0,
        "ranges": ranges,
        "intensities": [],
    }
    yield Case("LaserScan 10k, complete", "sensor_msgs/LaserScan", scan, scan, ALL)
    yield Case("LaserScan 10k, no stamp", "sensor_msgs/LaserScan", {**scan, "header": {}}, scan)
    rough = {**scan, "angle_min": -3.1, "ranges": [round(each + 0.001, 3) for each in ranges]}
    yield Case("LaserScan 10k, no float32s", "sensor_msgs/LaserScan", rough, scan)


def _maps(source: random.Random) -> Iterator[Case]:
    origin = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    grid = {
        "header": HEADER,
        "info": {"map_load_time": {"sec": 0, "nanosec": 0}, "resolution": 0.5, "width": 600, "height": 500,
                 "origin": origin},
        "data": source.choices((-1, 0, 100), k=300_000),
    }  # fmt: skip
    yield Case("OccupancyGrid 300k, complete", "nav_msgs/OccupancyGrid", grid, grid, ALL)
    yield Case("OccupancyGrid 300k, no stamp", "nav_msgs/OccupancyGrid", {**grid, "header": {}}, grid)


def best(action: Callable[[], object]) -> float:
    """Milliseconds of process CPU time of one call: the best of seven runs."""
    started = time.process_time()
    action()
    calls = max(1, int(RUN_SECONDS / max(time.process_time() - started, 1e-6)))
    fastest = float("inf")
    for _ in range(RUNS):
        started = time.process_time()
        for _ in range(calls):
            action()
        fastest = min(fastest, (time.process_time() - started) / calls)
    return fastest * 1e3


def relayed(take: Callable[[], Payload], encode: PublishEncoder) -> bytes:
    """One message from its arrival to the bytes of its frame."""
    return encode(Sample(TOPIC, take(), 1_700_000_000_000_000_000, "/bench")).data


def from_bytes(kind: MessageType, data: bytes, way_in: str) -> Callable[[], Payload]:
    """The way in for one message in some encoding."""
    if way_in == "JSON":
        return partial(Payload.from_json, kind, memoryview(data))
    if way_in == "cbor-raw":
        return partial(Payload.deserialised, kind, data)
    split = (CborCodec() if way_in == "CBOR" else BsonCodec()).split

    def take() -> Payload:
        members: Any = split(data, WireLimits(structure_bytes=1 << 24))[0]
        return Payload.from_value(kind, members["msg"].value)

    return take


def json_text(message: Messages) -> bytes:
    """As compact as browsers write it."""
    return json.dumps(message, separators=(",", ":")).encode()


def decoded_and_encoded(raw: bytes) -> bytes:
    """Decode and encode a message, as a relay does that looks at each one."""
    return msgspec.json.encode(msgspec.json.decode(raw))


def rows(only: str) -> Iterator[tuple[str, float, float, float]]:
    """Label, CPU milliseconds, those of msgspec alone, and those of the complete message."""
    for case in cases():
        if only not in case.label:
            continue
        kind = case.registry.message(case.type)
        raw, complete = (
            json.dumps(each, separators=(",", ":")).encode() for each in (case.message, case.complete)
        )
        plain = best(partial(decoded_and_encoded, raw))
        strict = best(partial(relayed, from_bytes(kind, complete, "JSON"), ENCODERS["JSON"]))
        for output in case.outputs:
            take = from_bytes(kind, raw, "JSON")
            yield f"{case.label} → {output}", best(partial(relayed, take, ENCODERS[output])), plain, strict
        if case.message is not case.complete:
            continue
        made = Payload.from_json(kind, raw)
        backs = {
            way: ENCODERS[way](Sample(TOPIC, made, 0, "/bench")).data
            for way in case.outputs
            if way in ("CBOR", "BSON")
        }
        if "cbor-raw" in case.outputs:
            backs["cbor-raw"] = made.serialised()
        for way, data in backs.items():
            take = from_bytes(kind, data, way)
            yield f"{case.label}: {way} → JSON", best(partial(relayed, take, ENCODERS["JSON"])), plain, strict


def main() -> None:
    """Print the table."""
    summary, _, example = (__doc__ or "").partition("Example: ")
    parser = argparse.ArgumentParser(
        prog="python -m bench.message.completion", description=summary, epilog=f"example: {example}"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="only messages whose label has this in it")
    only = parser.parse_args().only
    print(f"{'':44}{'ms CPU':>9}{'/ msgspec':>11}{'/ complete':>11}")
    for label, cost, plain, strict in rows(only):
        print(f"{label:44}{cost:9.3f}{cost / plain:11.2f}{cost / strict:11.2f}", flush=True)


if __name__ == "__main__":
    main()
