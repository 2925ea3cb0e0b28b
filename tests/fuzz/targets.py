"""Targets of the fuzzer.

A target takes any bytes and raises nothing: it returns an op or a clean rejection, in bounded memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from tests.fuzz import (
    admission_targets,
    agent_targets,
    asgi_targets,
    cloud_targets,
    file_targets,
    foxglove_targets,
    gate_targets,
    http_targets,
    hub_targets,
    interface_targets,
    peer_targets,
    protocol_targets,
    rclpy_targets,
    ros1_targets,
    wire_targets,
)

Target = Callable[[bytes], None]
"""Function of one input, which is not empty."""

TARGETS: Mapping[str, Target] = {
    target.__name__: target
    for target in (
        protocol_targets.session, protocol_targets.bson, protocol_targets.picture, protocol_targets.bridge,
        foxglove_targets.foxglove, wire_targets.websocket, wire_targets.deflate, wire_targets.json_stream,
        wire_targets.http, wire_targets.description, wire_targets.whole_messages, wire_targets.fragments,
        peer_targets.sctp, peer_targets.stun_messages, peer_targets.turn_messages, peer_targets.media,
        peer_targets.offers, peer_targets.encoded_images, peer_targets.association,
        peer_targets.decoded_images, file_targets.recordings, file_targets.interface_folders,
        interface_targets.payload_json, interface_targets.payload_args, interface_targets.payload_cdr,
        interface_targets.payload_ros1, interface_targets.definition, interface_targets.names,
        admission_targets.admission, admission_targets.settings, agent_targets.agent,
        http_targets.http_resources, gate_targets.gate, asgi_targets.asgi, rclpy_targets.ros_arguments,
        rclpy_targets.content_filter, ros1_targets.tcpros, ros1_targets.xml_rpc, hub_targets.uplink,
        cloud_targets.compressed_cloud,
    )
}  # fmt: skip

CORPUS = Path(__file__).parent / "corpus"
"""A folder of inputs for each target: those that the coverage-guided runs found worth keeping."""


def corpus_of(name: str) -> list[bytes]:
    """The kept inputs of one target."""
    return [path.read_bytes() for path in sorted((CORPUS / name).iterdir())]
