"""Foxglove's SDK as a peer: its server, and a callback that puts each message of a client on a channel.

The SDK is written in Rust and checks nothing; what a client publishes goes to the subscribers unchanged.

    python -m bench.peers.foxglove_sdk                                 one channel of Twists in JSON
    python -m bench.peers.foxglove_sdk /topic sensor_msgs/Image        one channel in CDR, of a type of ROS 2
"""

from __future__ import annotations

import signal
import sys
import threading

import foxglove
from foxglove.websocket import Capability, Client, ServerListener

from bench.traffic.dialects import FOXGLOVE_CHANNEL
from bench.traffic.messages import twists
from rwt_interfaces.registry import Registry

BACKLOG = 1 << 16
"""Messages that may wait for a client: none of a window is dropped."""


class Echo(ServerListener):
    """Logs to the channel whatever a client sends."""

    def __init__(self, channel: foxglove.Channel) -> None:
        self._log = channel.base.log

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        """One message of a client."""
        self._log(data)


def _channel(topic: str = "", type: str = "") -> foxglove.Channel:
    if not topic:
        return foxglove.Channel(twists().topic, schema={"type": "object"})
    registry = Registry()
    message = registry.message(type)
    text = registry.full_text(message).encode()
    schema = foxglove.Schema(name=registry.type_name(message), encoding="ros2msg", data=text)
    return foxglove.Channel(topic, schema=schema, message_encoding="cdr")


def main() -> None:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    channel = _channel(*sys.argv[1:])
    if channel.id() != FOXGLOVE_CHANNEL:
        raise SystemExit(f"the channel has the id {channel.id()}, not {FOXGLOVE_CHANNEL}")
    server = foxglove.start_server(
        port=0,
        capabilities=[Capability.ClientPublish],
        supported_encodings=["cdr", "json"],
        server_listener=Echo(channel),
        message_backlog_size=BACKLOG,
    )
    print(f"listening on ws://127.0.0.1:{server.port}", flush=True)
    stop.wait()
    server.stop()


if __name__ == "__main__":
    main()
