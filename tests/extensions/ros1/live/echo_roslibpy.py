"""A client of `roslibpy` that sends back what it receives: `echo_roslibpy.py URL`.

A line of its input has topics and their types. Once the server lists them all, it subscribes to each, and
sends what it receives on `/from/TYPE` to `/back/TYPE`. When each topic has had a message, it prints these.
"""

from __future__ import annotations

import json
import sys
import time
from functools import partial
from typing import Any

import roslibpy


def main() -> None:
    """Connect to the URL of the command line."""
    ros = roslibpy.Ros(sys.argv[1])
    ros.run(30)
    types: dict[str, str] = json.loads(sys.stdin.readline())
    service = roslibpy.Service(ros, "/rosapi/topics", "rosapi/Topics")
    while True:
        answer = service.call(roslibpy.ServiceRequest())
        known = dict(zip(answer["topics"], answer["types"], strict=True))
        if types.items() <= known.items():
            break
        time.sleep(0.2)
    received: dict[str, Any] = {}
    topics: list[roslibpy.Topic] = []

    def on_message(name: str, back: roslibpy.Topic | None, message: Any) -> None:
        received[name] = message
        if back is not None:
            back.publish(message)
        if len(received) == len(types):
            sys.stdout.write(json.dumps(received) + "\n")
            sys.stdout.flush()

    for name, type in types.items():
        back = None
        if name.startswith("/from/"):
            back = roslibpy.Topic(ros, name.replace("/from/", "/back/"), type, latch=True)
            back.advertise()
        topics.append(roslibpy.Topic(ros, name, type))
        topics[-1].subscribe(partial(on_message, name, back))
    sys.stdin.read()
    ros.terminate()


if __name__ == "__main__":
    main()
