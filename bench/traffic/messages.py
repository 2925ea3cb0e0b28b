"""Messages of the load, complete, in the form that roslibjs uses."""

from __future__ import annotations

import base64
import json
import random
from collections.abc import Mapping
from dataclasses import dataclass

WIDTH, HEIGHT, RGB = 640, 480, 3
STRING_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Stream:
    """One topic, and the messages that take turns on it.

    Attributes:
        unstamped: the messages have no `header.stamp`, and may arrive with one.
    """

    topic: str
    type: str
    messages: tuple[Mapping[str, object], ...]
    unstamped: bool = False

    def is_first(self, delivered: object) -> bool:
        """True if the delivered message is the first one, with or without a stamp."""
        if self.unstamped and isinstance(delivered, dict) and isinstance(delivered.get("header"), dict):
            header = {name: value for name, value in delivered["header"].items() if name != "stamp"}
            delivered = {**delivered, "header": header}
        return delivered == self.messages[0]

    def advertise(self) -> bytes:
        return _text(op="advertise", id=f"advertise:{self.topic}:1", type=self.type, topic=self.topic)

    def subscribe(self, compression: str = "none") -> bytes:
        id_ = f"subscribe:{self.topic}:1"
        return _text(op="subscribe", id=id_, type=self.type, topic=self.topic, compression=compression)

    def publish(self, message: Mapping[str, object]) -> bytes:
        id_ = f"publish:{self.topic}:1"
        return _text(op="publish", id=id_, topic=self.topic, msg=message, latch=False)


def _text(**op: object) -> bytes:
    return json.dumps(op, separators=(",", ":")).encode()


def _six_digits(source: random.Random) -> float:
    """A number whose shortest text always has six decimals, so that all frames have one length."""
    return (source.randrange(10_000, 100_000) * 10 + source.randrange(1, 10)) / 1_000_000


def twist(linear: float, angular: float) -> dict[str, object]:
    return {"linear": {"x": linear, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": angular}}


def twists(topic: str = "/cmd_vel") -> Stream:
    source = random.Random(1)
    messages = tuple(twist(_six_digits(source), _six_digits(source)) for _ in range(64))
    return Stream(topic, "geometry_msgs/Twist", messages)


def scans() -> Stream:
    """A laser scanner's 360 distances, of which each is exact in 32 bits, so that it comes back as it was."""
    source = random.Random(4)
    return Stream("/scan", "sensor_msgs/LaserScan", tuple(_scan(source, number) for number in range(16)))


def _scan(source: random.Random, number: int) -> dict[str, object]:
    return {
        "header": {"stamp": {"sec": 1_700_000_000 + number, "nanosec": 500_000_000}, "frame_id": "laser"},
        "angle_min": -3.0,
        "angle_max": 3.0,
        "angle_increment": 0.015625,
        "time_increment": 0.0,
        "scan_time": 0.125,
        "range_min": 0.125,
        "range_max": 10.0,
        "ranges": [source.randrange(8 << 6, 9 << 6) / 64 for _ in range(360)],
        "intensities": [],
    }


def strings() -> Stream:
    source = random.Random(2)
    letters = "abcdefghijklmnopqrstuvwxyz0123456789 "
    messages = tuple({"data": "".join(source.choices(letters, k=STRING_BYTES))} for _ in range(2))
    return Stream("/text", "std_msgs/String", messages)


def images() -> Stream:
    source = random.Random(3)
    return Stream("/camera/image_raw", "sensor_msgs/Image", tuple(_image(source, n) for n in range(2)))


def unstamped_images() -> Stream:
    """The same pictures from a page that leaves the stamp to the server."""
    images_ = images()
    messages = tuple({**message, "header": {"frame_id": "camera"}} for message in images_.messages)
    return Stream(images_.topic, images_.type, messages, unstamped=True)


def _image(source: random.Random, number: int) -> dict[str, object]:
    return {
        "header": {"stamp": {"sec": 1_700_000_000 + number, "nanosec": 500_000_000}, "frame_id": "camera"},
        "height": HEIGHT,
        "width": WIDTH,
        "encoding": "rgb8",
        "is_bigendian": 0,
        "step": WIDTH * RGB,
        "data": base64.b64encode(source.randbytes(WIDTH * HEIGHT * RGB)).decode(),
    }


def call(service: str, id_: str, a: int, b: int) -> bytes:
    return _text(op="call_service", id=id_, service=service, args={"a": a, "b": b})


def advertise_service(service: str, type_: str) -> bytes:
    return _text(op="advertise_service", type=type_, service=service)
