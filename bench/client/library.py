"""One client library, measured: `python -m bench.client.library LIBRARY receive|publish URL CASE COUNT`.

Prints the seconds that it took from the first message to the last, as the program that uses the library
sees them, and how many of them its process had a CPU.
"""

from __future__ import annotations

import asyncio
import base64
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import roslibpy

from bench.client.peer import CASES
from rwt_client import Robot, connect

_DRAIN_EVERY = 500


@dataclass(frozen=True, slots=True)
class Taken:
    """Duration of one measurement in seconds: wall time and CPU time."""

    wall: float
    cpu: float


class Interval:
    """From now until :meth:`taken`."""

    def __init__(self) -> None:
        self._wall = time.perf_counter()
        self._cpu = time.process_time()

    def taken(self) -> Taken:
        return Taken(time.perf_counter() - self._wall, time.process_time() - self._cpu)


_LONGEST = 60.0


class Stopwatch:
    """Counts what arrives, and takes the time from the first to the last."""

    def __init__(self, count: int, done: Callable[[], object]) -> None:
        self._left = count
        self._done = done
        self._interval: Interval | None = None
        self.taken = Taken(0.0, 0.0)

    def arrived(self) -> None:
        if self._interval is None:
            self._interval = Interval()
        self._left -= 1
        if not self._left:
            self.taken = self._interval.taken()
            self._done()


def _pixels(data: np.ndarray[Any, np.dtype[np.uint8]], message: Any) -> None:
    picture = data.reshape(message["height"] if isinstance(message, dict) else message.height, -1)
    assert picture.shape == (480, 1920)


# -- this library --------------------------------------------------------------------------------------------


def _ours(work: Callable[[Robot], Any], url: str) -> Taken:
    async def main() -> Taken:
        async with connect(url, ros_version=2, fetch_types=False) as robot:
            taken: Taken = await work(robot)
            return taken

    return asyncio.run(main())


def our_receive(url: str, case: str, count: int) -> Taken:
    async def work(robot: Robot) -> Taken:
        finished = asyncio.Event()
        watch = Stopwatch(count, finished.set)

        def callback(message: Any) -> None:
            if case == "Image":
                _pixels(message.data, message)
            watch.arrived()

        await robot.subscribe(
            "/bench", callback, CASES[case][0], arrays="numpy" if case == "Image" else "list"
        )
        await finished.wait()
        return watch.taken

    return _ours(work, url)


def our_publish(url: str, case: str, count: int) -> Taken:
    type_name, message = CASES[case]

    async def work(robot: Robot) -> Taken:
        finished = asyncio.Event()
        await robot.subscribe("/done", lambda _: finished.set(), "std_msgs/String")
        with await robot.advertise("/bench", type_name) as publisher:
            publisher.publish(message)
            await publisher.drain()
            interval = Interval()
            for number in range(count - 1):
                publisher.publish(message)
                if number % _DRAIN_EVERY == 0:
                    await publisher.drain()
            await finished.wait()
            assert not publisher.dropped
            return interval.taken()

    return _ours(work, url)


# -- roslibpy ------------------------------------------------------------------------------------------------


def their_receive(url: str, case: str, count: int) -> Taken:
    finished = threading.Event()
    watch = Stopwatch(count, finished.set)

    def callback(message: Any) -> None:
        if case == "Image":
            _pixels(np.frombuffer(base64.b64decode(message["data"]), np.uint8), message)
        watch.arrived()

    ros = roslibpy.Ros(url)
    ros.run()
    roslibpy.Topic(ros, "/bench", CASES[case][0]).subscribe(callback)
    finished.wait(_LONGEST)
    ros.close()
    return watch.taken


def their_publish(url: str, case: str, count: int) -> Taken:
    type_name, message = CASES[case]
    finished = threading.Event()
    ros = roslibpy.Ros(url)
    ros.run()
    roslibpy.Topic(ros, "/done", "std_msgs/String").subscribe(lambda _: finished.set())
    topic = roslibpy.Topic(ros, "/bench", type_name)
    topic.advertise()
    topic.publish(roslibpy.Message(message))
    interval = Interval()
    for _ in range(count - 1):
        topic.publish(roslibpy.Message(message))
    finished.wait(_LONGEST)
    taken = interval.taken()
    ros.close()
    return taken


MEASURES: dict[tuple[str, str], Callable[[str, str, int], Taken]] = {
    ("ours", "receive"): our_receive,
    ("ours", "publish"): our_publish,
    ("roslibpy", "receive"): their_receive,
    ("roslibpy", "publish"): their_publish,
}


def main() -> None:
    library, what, url, case, count = sys.argv[1:]
    taken = MEASURES[library, what](url, case, int(count))
    print(taken.wall, taken.cpu)


if __name__ == "__main__":
    main()
