"""XML-RPC as ROS 1 uses it: calls and responses as bytes. Without I/O.

The values are decoded by the standard library's unmarshaller, behind a parser that rejects document types:
they could define entities, by which a few bytes become gigabytes.
"""

from __future__ import annotations

import re
import xmlrpc.client
from typing import Any, Final, TypeAlias
from xml.parsers import expat

from rwt_graph.errors import WireError

Value: TypeAlias = Any
"""Value of XML-RPC: bool, int of 32 bits, float, str, bytes, list, dict."""

#: Maximum bytes of a call or response.
BODY_BYTES: Final = 16 * 1024 * 1024

_MOST_LEVELS: Final = 200
_MOST_ELEMENTS: Final = 1_000_000

#: Characters that XML 1.0 cannot contain.
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

#: Errors of the unmarshaller on malformed input; it was written for trusted peers.
_MALFORMED: Final = (
    expat.ExpatError,
    xmlrpc.client.Error,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)


def encode_call(method: str, params: tuple[Value, ...]) -> bytes:
    """Return a call as XML.

    Raises:
        WireError: XML-RPC has no such value.
    """
    return _encode(params, method)


def encode_response(value: Value) -> bytes:
    """Return a successful response as XML; raises WireError."""
    return _encode((value,), None)


def encode_fault(text: str) -> bytes:
    """Return a failed response as XML."""
    fault = xmlrpc.client.Fault(-1, _NOT_XML.sub("?", text))
    return xmlrpc.client.dumps(fault, methodresponse=True).encode()


def _encode(params: tuple[Value, ...], method: str | None) -> bytes:
    try:
        text = xmlrpc.client.dumps(params, method, methodresponse=method is None)
        if _NOT_XML.search(text):
            raise WireError("XML cannot contain control characters")
        return text.encode()
    except (OverflowError, TypeError, RecursionError, UnicodeError) as error:
        raise WireError(f"ROS 1's XML-RPC cannot carry the value: {error}") from error


def decode_call(body: bytes) -> tuple[str, tuple[Value, ...]]:
    """Return method and parameters of a call.

    Raises:
        WireError: it is not a call.
    """
    params, method = _decode(body)
    if method is None:
        raise WireError("the request is not a call of XML-RPC")
    return method, params


def decode_response(body: bytes) -> Value:
    """Return the value of a response.

    Raises:
        WireError: it is not a response, or a fault.
    """
    params, _ = _decode(body)
    if len(params) != 1:
        raise WireError("the response of XML-RPC has no value")
    return params[0]


def _decode(body: bytes) -> tuple[tuple[Value, ...], str | None]:
    unmarshaller = xmlrpc.client.Unmarshaller(use_builtin_types=True)
    unmarshaller.xml("", None)  # Strings are decoded by the parser.
    parser = expat.ParserCreate()
    level = count = 0

    def on_doctype(*_: object) -> None:
        raise WireError("XML-RPC with a document type is not supported")

    def on_start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal level, count
        level += 1
        count += 1
        if level > _MOST_LEVELS or count > _MOST_ELEMENTS:
            raise WireError(
                f"XML-RPC with more than {_MOST_LEVELS} levels or {_MOST_ELEMENTS} elements is not supported"
            )
        unmarshaller.start(tag, attributes)

    def on_end(tag: str) -> None:
        nonlocal level
        level -= 1
        unmarshaller.end(tag)

    parser.StartDoctypeDeclHandler = on_doctype
    parser.StartElementHandler = on_start
    parser.EndElementHandler = on_end
    parser.CharacterDataHandler = unmarshaller.data
    parser.buffer_text = True
    try:
        parser.Parse(body, True)
        return unmarshaller.close(), unmarshaller.getmethodname()
    except xmlrpc.client.Fault as fault:
        raise WireError(f"the other program failed: {fault.faultString}") from fault
    except WireError:
        raise
    except _MALFORMED as error:
        raise WireError(f"malformed XML-RPC: {error}") from error
