"""CPU per delivered message of a ROS 1 topic: `rwt serve` with one JSON client, and subscribers in rospy.

    python -m bench.ros1 twist
    python -m bench.ros1 image

Needs ROS 1 (`make test-ros1` installs it). All subscribers receive from one publisher at the same time.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
from pathlib import Path
from typing import Final

import websockets

from tests.processes import running
from tests.ros1.conftest import Ros

_TICKS: Final = os.sysconf("SC_CLK_TCK")

TYPES: Final = {
    "twist": ("geometry_msgs", "Twist", 500, "message.linear.x = 0.25"),
    "image": ("sensor_msgs", "Image", 20, "message.data = bytes(range(256)) * 3600; message.height = 480"),
}

PUBLISH: Final = """
import threading
from {package}.msg import {name}
publisher = rospy.Publisher('/measured', {name}, queue_size=10)
message = {name}()
{fill}
def publish():
    rate = rospy.Rate({hertz})
    while not rospy.is_shutdown():
        publisher.publish(message)
        rate.sleep()
threading.Thread(target=publish, daemon=True).start()
"""

SUBSCRIBE: Final = """
import json
def nested(value):
    value = plain(value)
    return {{k: nested(v) for k, v in value.items()}} if isinstance(value, dict) else value
from {package}.msg import {name}
count = 0
def received(message):
    global count
    count += 1
    {do}
rospy.Subscriber('/measured', {name}, received)
"""


def cpu_seconds(process: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


async def measure(kind: str, seconds: float) -> dict[str, float]:
    """Return the microseconds of processor time per message of each subscriber."""
    package, name, hertz, fill = TYPES[kind]
    texts = {"package": package, "name": name, "hertz": hertz, "fill": fill}
    with tempfile.TemporaryDirectory() as folder:
        ros = Ros(Path(folder))
        try:
            ros.start_master()
            programs = {"rospy": ros.program("plain"), "rospy with JSON": ros.program("json")}
            for program, do in zip(programs.values(), ("pass", "json.dumps(nested(message))"), strict=True):
                program.run(SUBSCRIBE.format(**texts, do=do))
            environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", ""), "ROS_IP": "127.0.0.1"}
            arguments = ("serve", "--graph", ros.uri, "ws://127.0.0.1:0")
            with running(*arguments, environment=environment, real=True, stderr=None) as (server, url):
                ros.program("publisher").run(PUBLISH.format(**texts))
                await asyncio.sleep(1.5)  # The topic is known then.
                async with websockets.connect(url, max_size=None) as client:
                    await client.send('{"op": "subscribe", "topic": "/measured"}')
                    await client.recv()
                    pids = {"rwt": server.pid, **{each: p.process.pid for each, p in programs.items()}}
                    counted = {each: p.run("result = count") for each, p in programs.items()}
                    before, got = {each: cpu_seconds(pid) for each, pid in pids.items()}, 0
                    end = asyncio.get_running_loop().time() + seconds
                    while asyncio.get_running_loop().time() < end:
                        await client.recv()
                        got += 1
                    used = {each: cpu_seconds(pid) - before[each] for each, pid in pids.items()}
                    counts = {each: p.run("result = count") - counted[each] for each, p in programs.items()}
                    counts["rwt"] = got
        finally:
            ros.close()
    return {each: used[each] / counts[each] * 1e6 for each in used}


def main() -> None:
    """Measure one message type and print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", choices=TYPES)
    parser.add_argument("--seconds", type=float, default=8.0)
    arguments = parser.parse_args()
    found = asyncio.run(measure(arguments.kind, arguments.seconds))
    for each, microseconds in found.items():
        print(
            f"{each:16} {microseconds:8.0f} us CPU per message; rwt / this: {found['rwt'] / microseconds:.2f}"
        )


if __name__ == "__main__":
    main()
