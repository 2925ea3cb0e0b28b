"""XML-RPC as ROS 1 uses it: calls and responses as bytes. Without I/O.

The values are decoded by the standard library's unmarshaller, behind a parser that rejects document types:
they could define entities, by which a few bytes become gigabytes.
"""

from __future__ import annotations

import re
import xmlrpc.client
from binascii import b2a_base64
from collections.abc import Iterator
from typing import Any, Final, TypeAlias
from xml.parsers import expat

from rwt_graph.errors import WireError

Value: TypeAlias = Any
"""Value of XML-RPC: bool, int of 32 bits, float, str, bytes, list, dict."""

#: Maximum bytes of a call or response.
BODY_BYTES: Final = 16 * 1024 * 1024

#: Maximum bytes that are decoded at once.
PART_BYTES: Final = 32 * 1024

#: Maximum levels of lists and tables, of elements, and number of elements.
_MOST_LEVELS: Final = 60
_MOST_TAGS: Final = 200
_MOST_ELEMENTS: Final = 300_000

#: Values that are decoded at once, and maximum bytes of one.
_SCALARS: Final = frozenset(("base64", "double", "int", "i4", "boolean"))
_SCALAR_BYTES: Final = 4 * 1024 * 1024

_INT32_MIN: Final = -(2**31)
_INT32_MAX: Final = 2**31 - 1

#: Characters that XML 1.0 cannot contain.
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_RESPONSE_START: Final = "<?xml version='1.0'?>\n<methodResponse><params><param>"
_RESPONSE_END: Final = "</param></params></methodResponse>"

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


def encode_call(method: str, params: tuple[Value, ...]) -> Iterator[str]:
    """Yield the texts of a call; they raise WireError if XML-RPC has no such value."""
    yield f"<?xml version='1.0'?>\n<methodCall><methodName>{_escaped(method)}</methodName><params>"
    for value in params:
        yield "<param>"
        yield from _texts(value, 0)
        yield "</param>"
    yield "</params></methodCall>"


def encode_response(value: Value) -> Iterator[str]:
    """Yield the texts of a successful response, as :func:`encode_call` does."""
    yield _RESPONSE_START
    yield from _texts(value, 0)
    yield _RESPONSE_END


def encode_results(results: Iterator[Value | WireError]) -> Iterator[Iterator[str]]:
    """Yield the texts of a response to `system.multicall`, those of each result by themselves.

    A result is asked for after the texts of those before it.
    """
    yield iter((f"{_RESPONSE_START}<value><array><data>",))
    for result in results:
        is_fault = isinstance(result, WireError)
        yield _texts(_fault(str(result)) if is_fault else [result], 1)
    yield iter((f"</data></array></value>{_RESPONSE_END}",))


def encode_fault(text: str) -> bytes:
    """Return a failed response as XML."""
    texts = "".join(_texts(_fault(text), 0))
    return f"<?xml version='1.0'?>\n<methodResponse><fault>{texts}</fault></methodResponse>".encode()


def _fault(text: str) -> Value:
    return {"faultCode": -1, "faultString": _NOT_XML.sub("?", text)}


def _texts(value: Value, level: int) -> Iterator[str]:
    if level > _MOST_LEVELS:
        raise WireError(f"ROS 1's XML-RPC cannot carry more than {_MOST_LEVELS} levels")
    match value:
        case bool():
            yield f"<value><boolean>{value:d}</boolean></value>"
        case int() if not _INT32_MIN <= value <= _INT32_MAX:
            raise WireError("ROS 1's XML-RPC cannot carry the value: int exceeds XML-RPC limits")
        case int():
            yield f"<value><int>{value}</int></value>"
        case float():
            yield f"<value><double>{value!r}</double></value>"
        case str():
            yield "<value><string>"
            for at in range(0, len(value), PART_BYTES):
                yield _escaped(value[at : at + PART_BYTES])
            yield "</string></value>"
        case bytes() | bytearray():
            yield f"<value><base64>\n{b2a_base64(value).decode()}</base64></value>"
        case list() | tuple():
            yield "<value><array><data>"
            for item in value:
                yield from _texts(item, level + 1)
            yield "</data></array></value>"
        case dict():
            yield "<value><struct>"
            for key, item in value.items():
                if not isinstance(key, str):
                    raise WireError("ROS 1's XML-RPC cannot carry the value: keys must be strings")
                yield f"<member><name>{_escaped(key)}</name>"
                yield from _texts(item, level + 1)
                yield "</member>"
            yield "</struct></value>"
        case _:
            raise WireError(
                f"ROS 1's XML-RPC cannot carry the value: {type(value).__name__} is not supported"
            )


def _escaped(text: str) -> str:
    if _NOT_XML.search(text):
        raise WireError("XML cannot contain control characters")
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


class Decoder:
    """Decoder of one call or response, in parts: each takes a few milliseconds at most.

    Raises:
        WireError: the parts are not XML-RPC.
    """

    def __init__(self) -> None:
        self._unmarshaller = xmlrpc.client.Unmarshaller(use_builtin_types=True)
        self._unmarshaller.xml("", None)  # Strings are decoded by the parser.
        self._parser = parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = self._on_doctype
        parser.StartElementHandler = self._on_start
        parser.EndElementHandler = self._on_end
        parser.CharacterDataHandler = self._unmarshaller.data
        parser.buffer_text = True
        self._level = self._count = self._began = 0
        self.size = 0

    def feed(self, data: bytes, *, is_last: bool = False) -> None:
        """Decode a part of at most `PART_BYTES`."""
        self.size += len(data)
        try:
            self._parser.Parse(data, is_last)
        except WireError:
            raise
        except _MALFORMED as error:
            raise WireError(f"malformed XML-RPC: {error}") from error
        # The parser reads an unfinished tag or comment again with each part.
        unread = 0 if is_last else self.size - self._parser.CurrentByteIndex
        if self.size > BODY_BYTES or unread > 2 * PART_BYTES:
            raise WireError(f"XML-RPC of more than {BODY_BYTES} bytes, or with such a tag, is not supported")

    def call(self) -> tuple[str, tuple[Value, ...]]:
        """Return method and parameters of a call."""
        params, method = self._close()
        if method is None:
            raise WireError("the request is not a call of XML-RPC")
        return method, params

    def response(self) -> Value:
        """Return the value of a response; raises WireError also for a fault."""
        params, _ = self._close()
        if len(params) != 1:
            raise WireError("the response of XML-RPC has no value")
        return params[0]

    def _close(self) -> tuple[tuple[Value, ...], str | None]:
        self.feed(b"", is_last=True)
        try:
            return self._unmarshaller.close(), self._unmarshaller.getmethodname()
        except xmlrpc.client.Fault as fault:
            raise WireError(f"the other program failed: {fault.faultString}") from fault
        except _MALFORMED as error:
            raise WireError(f"malformed XML-RPC: {error}") from error

    def _on_doctype(self, *_: object) -> None:
        raise WireError("XML-RPC with a document type is not supported")

    def _on_start(self, tag: str, attributes: dict[str, str]) -> None:
        self._level += 1
        self._count += 1
        if self._level > _MOST_TAGS or self._count > _MOST_ELEMENTS:
            raise WireError(
                f"XML-RPC with more than {_MOST_TAGS} levels or {_MOST_ELEMENTS} elements is not supported"
            )
        self._began = self._parser.CurrentByteIndex
        self._unmarshaller.start(tag, attributes)

    def _on_end(self, tag: str) -> None:
        self._level -= 1
        if tag in _SCALARS and self._parser.CurrentByteIndex - self._began > _SCALAR_BYTES:
            raise WireError(f"XML-RPC with a {tag} of more than {_SCALAR_BYTES} bytes is not supported")
        self._unmarshaller.end(tag)
