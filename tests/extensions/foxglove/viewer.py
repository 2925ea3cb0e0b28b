"""A client of Foxglove's protocol whose wire is two lists; what it says and hears is written out here, in
bytes of its own."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from rwt.extensions.foxglove.client import FoxgloveClient
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from tests.core.rosbridge.recording_client import Client

Text = dict[str, Any]

#: Topics that are there with any node, or with simulated time.
EVERY_NODES = {"/clock", "/parameter_events", "/rosout"}


class Data(NamedTuple):
    """A message of a channel."""

    subscription: int
    time_ns: int
    payload: bytes


class Response(NamedTuple):
    """The answer of a service."""

    service: int
    call: int
    encoding: str
    payload: bytes


class Asset(NamedTuple):
    """A file, or why there is none."""

    request: int
    error: str
    content: bytes


class State(NamedTuple):
    """Event of a recording."""

    status: int
    time_ns: int
    speed: float
    did_seek: int
    request: str


def parsed(data: bytes, *, binary: bool) -> Any:
    """Content of a frame of the server."""
    if not binary:
        return json.loads(data)
    if data[0] == 1:
        subscription, time_ns = struct.unpack_from("<IQ", data, 1)
        return Data(subscription, time_ns, data[13:])
    if data[0] == 2:
        return struct.unpack("<Q", data[1:])[0]
    if data[0] == 3:
        service, call, length = struct.unpack_from("<III", data, 1)
        return Response(service, call, data[13 : 13 + length].decode(), data[13 + length :])
    if data[0] == 4:
        request, status, length = struct.unpack_from("<IBI", data, 1)
        error, content = data[10 : 10 + length].decode(), data[10 + length :]
        assert (status == 1) == bool(error)
        return Asset(request, error, content)
    assert data[0] == 5, data[:20]
    status, time_ns, speed, did_seek, length = struct.unpack_from("<BQfBI", data, 1)
    assert len(data) == 19 + length
    return State(status, time_ns, speed, did_seek, data[19:].decode())


class Viewer(Client):
    """One client of a gateway.

    Attributes:
        gateway: where it is a client.
        channels: what it was told of channels and not told that they are gone, by topic.
        services: the same of services, by name.
        welcome_frames, welcome: everything that came on connecting; :meth:`heard` begins after it.
    """

    def __init__(
        self,
        gateway: FoxgloveGateway,
        address: str = "127.0.0.1",
        *,
        path: str = "/",
        headers: Mapping[str, str] | None = None,
    ) -> None:
        self.gateway = gateway
        self.channels: dict[str, Text] = {}
        self.services: dict[str, Text] = {}
        super().__init__(gateway, address, path=path, headers=headers)  # type: ignore[arg-type]  # only `accept` is called, which bridge and gateway both have
        self.welcome_frames = [frame for frame, _ in self.frames]
        self.welcome = self.heard()

    @property
    def client(self) -> FoxgloveClient:
        """State of the client in the gateway."""
        assert isinstance(self.endpoint, FoxgloveClient)
        return self.endpoint

    def heard(self) -> list[Any]:
        """Everything that has come since the last time."""
        frames, self.frames = self.frames, []
        found = [parsed(frame.data, binary=frame.binary) for frame, _ in frames]
        for each in found:
            self._note(each)
        return found

    def heard_one(self) -> Any:
        """The first of what has come since the last time; None if nothing has."""
        rest, self.frames = self.frames[1:], self.frames[:1]
        found = self.heard()
        self.frames[:0] = rest
        return found[0] if found else None

    def _note(self, said: Any) -> None:
        match said:
            case {"op": "advertise", "channels": channels}:
                self.channels |= {channel["topic"]: channel for channel in channels}
            case {"op": "unadvertise", "channelIds": ids}:
                self.channels = {name: it for name, it in self.channels.items() if it["id"] not in ids}
            case {"op": "advertiseServices", "services": services}:
                self.services |= {service["name"]: service for service in services}
            case {"op": "unadvertiseServices", "serviceIds": ids}:
                self.services = {name: it for name, it in self.services.items() if it["id"] not in ids}

    @property
    def topics(self) -> set[str]:
        """Of the channels, but for those that every node has."""
        return self.channels.keys() - EVERY_NODES

    def heard_of(self, topic: str) -> list[Any]:
        """The texts of one op among what has come."""
        return [each for each in self.heard() if isinstance(each, dict) and each["op"] == topic]

    def heard_data(self) -> list[Data]:
        """The messages of channels among that."""
        return [each for each in self.heard() if isinstance(each, Data)]

    def statuses(self) -> list[str]:
        """The status lines among that."""
        return [
            each["message"] for each in self.heard() if isinstance(each, dict) and each.get("op") == "status"
        ]

    def subscribe(self, topic: str, id: int = 1) -> None:
        self.heard()
        self.say("subscribe", subscriptions=[{"id": id, "channelId": self.channels[topic]["id"]}])

    def advertise(self, topic: str, type: str, encoding: str = "json", id: int = 1) -> None:
        channel = {"id": id, "topic": topic, "encoding": encoding, "schemaName": type}
        self.say("advertise", channels=[channel])

    def publish(self, payload: bytes, id: int = 1) -> None:
        self.say_raw(struct.pack("<BI", 1, id) + payload, binary=True)

    def call(self, service: str | int, payload: bytes, encoding: str = "json", id: int = 1) -> None:
        self.heard()
        number = service if isinstance(service, int) else self.services[service]["id"]
        head = struct.pack("<BIII", 2, number, id, len(encoding)) + encoding.encode()
        self.say_raw(head + payload, binary=True)

    def control(
        self, *, play: bool, speed: float = 1.0, seek_ns: int | None = None, request: str = "r"
    ) -> None:
        head = struct.pack("<BBfBQI", 3, not play, speed, seek_ns is not None, seek_ns or 0, len(request))
        self.say_raw(head + request.encode(), binary=True)
