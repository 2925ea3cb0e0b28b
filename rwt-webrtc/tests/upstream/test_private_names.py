"""Private names of aiortc and aioice: one test for each name that a module of `rwt_webrtc.upstream` lists."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

import aioice
import aiortc
import pytest
from aioice import stun, turn
from aioice.ice import StunProtocol
from aiortc.rtcrtpreceiver import NackGenerator
from aiortc.rtcsctptransport import DataChunk, InboundStream, RTCSctpTransport, SackChunk
from OpenSSL import SSL

import rwt_webrtc
from rwt_webrtc.packets.reassembly import Reassembly

PACKAGE: Final = Path(str(rwt_webrtc.__file__)).parent
UPSTREAM: Final = PACKAGE / "upstream"

BORROWED: Final[dict[str, type]] = {
    "association": RTCSctpTransport,
    "certificate": aiortc.RTCCertificate,
    "dtls_transport": aiortc.RTCDtlsTransport,
    "ice_agent": aioice.Connection,
    "ice_socket": StunProtocol,
    "nack_generator": NackGenerator,
    "peer_connection": aiortc.RTCPeerConnection,
    "rtp_receiver": aiortc.RTCRtpReceiver,
    "rtp_sender": aiortc.RTCRtpSender,
    "transceiver": aiortc.RTCRtpTransceiver,
    "turn_clients": turn.TurnClientMixin,
}
"""Class that each module borrows."""

OTHERS: Final[dict[str, type]] = {
    "Context": SSL.Context,
    "RTCDtlsTransport": aiortc.RTCDtlsTransport,
    "RTCIceGatherer": aiortc.RTCIceGatherer,
    "RTCPeerConnection": aiortc.RTCPeerConnection,
    "Transaction": stun.Transaction,
}
"""Further classes of which a module uses a private name."""


def subclasses() -> Iterator[tuple[type, type]]:
    """Iterate over the classes of the package that borrow one, each with the first that it borrows."""
    for name in BORROWED:
        module = import_module(f"rwt_webrtc.upstream.{name}")
        for ours in vars(module).values():
            if inspect.isclass(ours) and ours.__module__ == module.__name__:
                theirs = (each for each in ours.__mro__ if each.__module__.startswith(("aiortc.", "aioice.")))
                yield from ((ours, each) for each in islice(theirs, 1))


SUBCLASSES: Final = list(subclasses())

CALLED: Final = {
    "_data_channel_receive": ["stream_id", "pp_id", "data"],
    "_next_encoded_frame": ["codec"],
    "_send": ["stream_id", "pp_id", "user_data", "expiry", "max_retransmits", "ordered"],
    "_send_rtp": ["data"],
    "__remoteDescription": [],
    "__updateConnectionState": [],
    "__updateIceConnectionState": [],
    "__updateIceGatheringState": [],
}
"""Parameters of the functions that are called and not replaced."""


class Listed(NamedTuple):
    """A private name as the docstring of a module lists it."""

    module: str
    owner: type
    name: str
    reason: str

    @property
    def attribute(self) -> str:
        """The name as it is spelt outside of its class."""
        return f"_{self.owner.__name__}{self.name}" if self.name.startswith("__") else self.name


def listed(module: str) -> Iterator[Listed]:
    text = str(import_module(f"rwt_webrtc.upstream.{module}").__doc__)
    for names, reason in re.findall(r"^\* ((?:``[\w.]+``,?\s*)+): (.+)$", text, re.MULTILINE):
        for each in re.findall(r"``([\w.]+)``", names):
            owner, _, name = each.rpartition(".")
            yield Listed(module, OTHERS[owner] if owner else BORROWED[module], name, reason)


NAMES: Final = [each for module in BORROWED for each in listed(module)]


@cache
def sources_of(owner: type) -> str:
    return "".join(inspect.getsource(each) for each in owner.__mro__ if each.__module__ != "builtins")


def has(owner: type, name: str) -> bool:
    return re.search(rf"(self\.|def |^ +){name}\b", sources_of(owner), re.MULTILINE) is not None


def used(module: str) -> set[str]:
    """Private attributes that a module uses and does not add itself."""
    tree = ast.parse((UPSTREAM / f"{module}.py").read_text("utf-8"))
    attributes = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    defined = {
        node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    added = defined | {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    private = {name for name in attributes | defined if re.match(r"_(?!_)\w", name)}
    theirs = {each.attribute for each in NAMES if each.module == module}
    return {name for name in private if name in theirs or name not in added or has(BORROWED[module], name)}


def test_every_module_borrows_a_class() -> None:
    assert len(SUBCLASSES) > 10
    assert {path.stem for path in UPSTREAM.glob("*.py")} - {"__init__"} == BORROWED.keys()


def test_no_other_module_uses_private_names() -> None:
    foreign = re.compile(r"(?<!\bself)(?<!\bcls)(?<!super\(\))\._[a-zA-Z]|__class__ =")
    modules = [path for path in PACKAGE.rglob("*.py") if path.parent != UPSTREAM]
    assert len(modules) > 20
    assert not [path.name for path in modules if foreign.search(path.read_text("utf-8"))]


@pytest.mark.parametrize("module", BORROWED)
def test_a_module_lists_what_it_uses(module: str) -> None:
    assert used(module) == {each.attribute for each in NAMES if each.module == module}
    assert "__class__ =" not in (UPSTREAM / f"{module}.py").read_text("utf-8")


@pytest.mark.parametrize("entry", NAMES, ids=lambda entry: f"{entry.owner.__name__}.{entry.name}")
def test_a_private_name(entry: Listed) -> None:
    assert has(entry.owner, entry.name)
    assert entry.reason
    theirs = getattr(entry.owner, entry.attribute, None)
    replaced = any(entry.attribute in vars(ours) and owner is entry.owner for ours, owner in SUBCLASSES)
    if not inspect.isfunction(theirs):
        assert not replaced
    elif replaced:
        # A replacement has an effect if somebody else still calls it.
        folder = Path(inspect.getfile(entry.owner)).parent
        calls = re.compile(rf"\w\.{entry.name}\(")
        assert any(calls.search(path.read_text("utf-8")) for path in folder.glob("*.py"))
    else:
        assert list(inspect.signature(theirs).parameters)[1:] == CALLED[entry.name]


@pytest.mark.parametrize(("ours", "theirs"), SUBCLASSES, ids=lambda each: each.__name__)
def test_replacements_have_the_parameters_of_what_they_replace(ours: type, theirs: type) -> None:
    for name, function in vars(ours).items():
        original = getattr(theirs, name, None)
        if name != "__init__" and inspect.isfunction(function) and inspect.isfunction(original):
            assert (
                inspect.signature(function).parameters.keys() == inspect.signature(original).parameters.keys()
            )
            assert inspect.iscoroutinefunction(function) == inspect.iscoroutinefunction(original), name


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


def test_who_calls_what_is_replaced() -> None:
    def calls(theirs: Any, text: str) -> bool:
        return text in inspect.getsource(theirs)

    assert RTCSctpTransport.State.ESTABLISHED
    assert calls(aiortc.RTCRtpSender._handle_rtcp_packet, "self._send_keyframe()")
    assert calls(aiortc.RTCRtpSender._next_encoded_frame, "self.__encoder.pack(data)")
    assert calls(aiortc.RTCRtpSender.send, "self._run_rtp(parameters.codecs[0])")
    assert calls(aiortc.RTCDtlsTransport._handle_rtcp_data, "recipient._handle_rtcp_packet(packet)")
    assert calls(aiortc.RTCRtpReceiver, "self.__nack_generator.add(packet)")
    assert calls(aiortc.RTCRtpReceiver, "self.__nack_generator.missing")
    assert calls(NackGenerator.truncate, "self.missing")
    assert calls(aiortc.RTCIceTransport.__init__, "self._connection = gatherer._connection")
    assert calls(aioice.Connection.connect, "self.query_consent()")
    assert calls(aioice.Connection.gather_candidates, "self.get_component_candidates(component=")
    assert calls(turn.create_turn_endpoint, "TurnClientUdpProtocol(")
    assert calls(turn.create_turn_endpoint, "TurnClientTcpProtocol(")
