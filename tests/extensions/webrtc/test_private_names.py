"""Private names of aiortc and aioice. If a release changes them, these tests fail first."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
from aioice import Connection, stun
from aioice.ice import StunProtocol
from aiortc import (
    RTCCertificate,
    RTCDtlsTransport,
    RTCIceGatherer,
    RTCIceTransport,
    RTCPeerConnection,
    RTCRtpReceiver,
    RTCRtpSender,
)
from aiortc.rtcrtpreceiver import NackGenerator
from aiortc.rtcsctptransport import DataChunk, InboundStream, RTCSctpTransport, SackChunk

import rwt_webrtc
from rwt_webrtc.transport.aiortc_internals import Association
from rwt_webrtc.transport.congestion.paced_sender import PacedSender
from rwt_webrtc.transport.ice_agent import GuardedAgent, GuardedProtocol
from rwt_webrtc.transport.reassembly import Reassembly

ASYNC = (
    "_handle_data", "_receive", "_receive_data_chunk", "_receive_sack_chunk", "_data_channel_flush",
    "_receive_forward_tsn_chunk",
    "_data_channel_receive", "_transmit", "_send", "_send_chunk", "_send_sack", "_receive_chunk",
    "_reset_deferred_streams", "stop",
)  # fmt: skip
"""Coroutines of the association that are called or replaced."""


def test_no_other_module_uses_private_names() -> None:
    used = re.compile(r"(?<!\bself)(?<!\bcls)(?<!super\(\))\._[a-zA-Z]")
    folders = (Path(str(rwt_webrtc.__file__)).parent,)
    own = ("aiortc_internals", "ice_agent", "paced_sender")
    modules = [path for folder in folders for path in folder.rglob("*.py") if path.stem not in own]
    assert len(modules) > 20
    assert not [path.name for path in modules if used.search(path.read_text("utf-8"))]


@pytest.mark.parametrize("name", ASYNC)
def test_coroutines_of_the_association(name: str) -> None:
    assert inspect.iscoroutinefunction(getattr(RTCSctpTransport, name))


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("_handle_data", ["self", "data"]),
        ("_receive", ["self", "stream_id", "pp_id", "data"]),
        ("_receive_data_chunk", ["self", "chunk"]),
        ("_receive_sack_chunk", ["self", "chunk"]),
        ("_receive_forward_tsn_chunk", ["self", "chunk"]),
        ("_get_inbound_stream", ["self", "stream_id"]),
        ("_mark_received", ["self", "tsn"]),
        ("_receive_chunk", ["self", "chunk"]),
        ("_update_rto", ["self", "R"]),
        ("_send_chunk", ["self", "chunk"]),
        (
            "_send",
            ["self", "stream_id", "pp_id", "user_data", "expiry", "max_retransmits", "ordered"],
        ),
    ],
)
def test_parameters_of_the_association(name: str, parameters: list[str]) -> None:
    assert list(inspect.signature(getattr(RTCSctpTransport, name)).parameters) == parameters


def test_what_is_asked_of_a_stream() -> None:
    for name in ("add_chunk", "pop_messages", "prune_chunks"):
        ours, theirs = getattr(Reassembly, name), getattr(InboundStream, name)
        assert inspect.signature(ours).parameters.keys() == inspect.signature(theirs).parameters.keys()
    assert InboundStream().sequence_number == 0
    asked = {name for name in vars(InboundStream()) if f".{name}" in inspect.getsource(RTCSctpTransport)}
    assert asked <= {"sequence_number"}


def test_what_is_read_of_chunks() -> None:
    chunk = DataChunk()
    for name in ("flags", "tsn", "stream_id", "stream_seq", "protocol", "user_data"):
        assert hasattr(chunk, name)
    assert SackChunk().advertised_rwnd == 0


@pytest.mark.anyio
async def test_values_of_an_association() -> None:
    peer = RTCPeerConnection()
    peer.createDataChannel("x")
    sctp = peer.sctp
    assert sctp is not None
    for name in (
        "_association_state", "_advertised_rwnd", "_cwnd", "_flight_size", "_outbound_queue",
        "_data_channel_queue", "_data_channels", "_inbound_streams", "_inbound_streams_max",
        "_outbound_streams_count", "_last_received_tsn", "_rto", "_srtt", "_rttvar", "_sack_needed",
        "_sack_misordered", "_sack_duplicates", "_sent_queue", "_advanced_peer_ack_tsn", "_reconfig_deferred",
        "_local_verification_tag", "_local_port", "_remote_port",
    ):  # fmt: skip
        assert hasattr(sctp, name), name
    assert sctp.State.ESTABLISHED
    # What this package adds to the object must not be something that is there.
    added = {name for name in vars(Association) if not name.startswith("__")} - set(vars(RTCSctpTransport))
    assert not added & set(vars(sctp))
    await peer.close()


def test_what_a_sender_is_told_goes_through_what_is_put_in_front() -> None:
    assert list(inspect.signature(RTCRtpSender._handle_rtcp_packet).parameters) == ["self", "packet"]
    assert inspect.iscoroutinefunction(RTCRtpSender._handle_rtcp_packet)
    assert "self._send_keyframe()" in inspect.getsource(RTCRtpSender._handle_rtcp_packet)
    assert "recipient._handle_rtcp_packet(packet)" in inspect.getsource(RTCDtlsTransport._handle_rtcp_data)
    assert "self.__encoder.pack(data)" in inspect.getsource(RTCRtpSender._next_encoded_frame)


@pytest.mark.anyio
async def test_names_of_a_paced_sender() -> None:
    source = inspect.getsource(RTCRtpSender)
    for name in (
        "encoder", "mid", "ntp_timestamp", "octet_count", "packet_count", "rtp_exited",
        "rtp_header_extensions_map", "rtp_history", "rtp_started", "rtp_timestamp",
        "rtx_payload_type", "rtx_sequence_number",
    ):  # fmt: skip
        assert f"self.__{name}" in source, name
    for name, parameters in (("_run_rtp", ["self", "codec"]), ("_retransmit", ["self", "sequence_number"])):
        assert list(inspect.signature(getattr(RTCRtpSender, name)).parameters) == parameters
    assert "self._run_rtp(parameters.codecs[0])" in source and "self._retransmit(seq)" in source
    added = {name for name in vars(PacedSender) if not name.startswith("__")} | set(
        PacedSender.__annotations__
    )
    transport = RTCDtlsTransport(RTCIceTransport(RTCIceGatherer()), [RTCCertificate.generateCertificate()])
    assert not added & set(vars(RTCRtpSender("video", transport)))
    assert hasattr(RTCPeerConnection, "_RTCPeerConnection__remoteDescription")


def test_what_media_is_handed_to() -> None:
    assert list(inspect.signature(RTCDtlsTransport._handle_rtp_data).parameters) == [
        "self", "data", "arrival_time_ms",
    ]  # fmt: skip
    assert list(inspect.signature(RTCDtlsTransport._handle_rtcp_data).parameters) == ["self", "data"]
    receiver = inspect.getsource(RTCRtpReceiver)
    assert "self.__nack_generator.add(packet)" in receiver and "self.__nack_generator.missing" in receiver
    assert "self.missing" in inspect.getsource(NackGenerator.truncate)


@pytest.mark.anyio
async def test_values_of_ice() -> None:
    connection = RTCIceGatherer()._connection
    assert isinstance(connection, Connection)
    assert inspect.iscoroutinefunction(Connection.query_consent)
    assert "self.query_consent()" in inspect.getsource(Connection.connect)
    gather = Connection.get_component_candidates
    assert list(inspect.signature(gather).parameters) == ["self", "component", "addresses", "timeout"]
    assert "self.get_component_candidates(component=" in inspect.getsource(Connection.gather_candidates)
    for name in (
        "_nominated", "_query_consent_task", "_queue", "_protocols", "local_username", "local_password",
        "remote_password",
    ):  # fmt: skip
        assert hasattr(connection, name)
    assert list(inspect.signature(Connection.data_received).parameters) == ["self", "data", "component"]
    assert list(inspect.signature(Connection.request_received).parameters) == [
        "self", "message", "addr", "protocol",
    ]  # fmt: skip
    for name in ("datagram_received", "send_stun"):
        assert name in vars(StunProtocol)
    assert "self.__addr = addr" in inspect.getsource(stun.Transaction)
    assert {"receiver", "transactions"} <= vars(StunProtocol(connection)).keys()
    # What subclasses add to objects must not be something that is there.
    for added, there in ((GuardedAgent, connection), (GuardedProtocol, StunProtocol(connection))):
        names = {*vars(added), *added.__annotations__} - set(dir(type(there)))
        assert not names & set(vars(there))


@pytest.mark.anyio
async def test_the_certificate_of_a_handshake() -> None:
    connection = RTCPeerConnection()
    connection.createDataChannel("any")
    assert connection.sctp is not None
    certificate = vars(connection.sctp.transport)["_RTCDtlsTransport__local_certificate"]
    assert list(inspect.signature(certificate._create_ssl_context).parameters) == ["srtp_profiles"]
    await connection.close()
