"""A program that speaks the line protocol just well enough to be told apart by the runner.

`python scripted_client.py KIND`: `good` subscribes, publishes nothing and hears; the others go wrong.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

KIND = sys.argv[1]


def say(line: dict[str, Any]) -> None:
    print(json.dumps(line), flush=True)


class Client:
    def __init__(self) -> None:
        self.wire: ClientConnection | None = None
        self.topics: dict[str, str] = {}

    def hear(self, wire: ClientConnection) -> None:
        try:
            for text in wire:
                message = json.loads(text)
                if message["topic"] in self.topics:
                    say({"event": "message", "of": self.topics[message["topic"]], "value": message["msg"]})
        except ConnectionClosed:
            return

    def answer(self, command: dict[str, Any]) -> dict[str, Any]:
        match command["do"]:
            case "connect":
                self.wire = connect(command["url"])
                threading.Thread(target=self.hear, args=(self.wire,), daemon=True).start()
            case "close":
                if self.wire is not None:
                    self.wire.close()
            case "subscribe":
                assert self.wire is not None
                self.topics[command["topic"]] = command["as"]
                frame = {"op": "subscribe", "topic": command["topic"], "type": command["type"]}
                self.wire.send(json.dumps(frame))
            case _:
                return {"unsupported": f"no {command['do']}"}
        return {"ok": True}


def main() -> None:
    if KIND == "silent":
        time.sleep(60)
    if KIND == "dead":
        sys.exit("no such library")
    print("hello, I am no JSON", flush=True)
    say({"event": "ready", "library": "scripted", "version": "0.1"})
    client = Client()
    for line in sys.stdin:
        command = json.loads(line)
        if KIND == "dies" and command["do"] == "subscribe":
            sys.exit(3)
        if KIND == "hangs" and command["do"] == "subscribe":
            continue
        if KIND == "refuses" and command["do"] == "subscribe":
            say({"n": command["n"], "error": "no subscriptions today"})
            continue
        if KIND == "throws":
            say({"event": "uncaught", "text": "oh"})
        say({"n": command["n"], **client.answer(command)})


if __name__ == "__main__":
    main()
