"""The types of settings that several groups of them share."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic_core import PydanticKnownError

from rwt_protocol.error_text import plain_type

MIB: Final = 1024 * 1024

#: Beyond what any machine has. Within it sums and products of settings stay exact in a float, and neither a
#: timer of an event loop nor a counter of a library overflows.
_MOST_BYTES: Final = 1 << 40
_MOST: Final = 1_000_000_000

Bytes = Annotated[int, Field(ge=1024, le=_MOST_BYTES)]
Count = Annotated[int, Field(ge=1, le=_MOST)]
CountOrNone = Annotated[int, Field(ge=0, le=_MOST)]
Seconds = Annotated[float, Field(ge=0.001, le=_MOST, allow_inf_nan=False)]
SecondsOrNone = Annotated[float, Field(ge=0, le=_MOST, allow_inf_nan=False)]
Globs = tuple[str, ...]

_LABEL: Final = r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_HOST_NAME: Final = re.compile(rf"{_LABEL}(?:\.{_LABEL})*")


def is_host_name(text: str) -> bool:
    """Return True if a text is a DNS name (RFC 1123 section 2.1); IPv4 addresses look like one."""
    return len(text) <= 253 and _HOST_NAME.fullmatch(text) is not None


def _check_host(text: str) -> str:
    with suppress(ValueError):
        return str(ipaddress.ip_address(text))
    if not is_host_name(text):
        raise ValueError(f"{text!r} is no name or address of a host: expected one such as robot.example.org")
    return text.lower()


def _check_host_glob(text: str) -> str:
    if not is_host_name(re.sub(r"[*?]", "a", text)):
        with suppress(ValueError):
            return str(ipaddress.ip_address(text))
        raise ValueError(
            f"{text!r} is no name of a host: expected one without scheme and port, for example"
            " robot.example.org or *.example.org"
        )
    return text


_ORIGIN: Final = re.compile(
    r"[a-z*][a-z0-9+.*-]*://(?P<host>\[[0-9a-f:.]+\]|[^\s/:?#@\[\]]+)(?::(?:\d{1,5}|\*))?/?", re.IGNORECASE
)


def _check_origin_glob(text: str) -> str:
    if text in ("*", "null", "file://"):
        return text
    found = _ORIGIN.fullmatch(text)
    if found is None:
        raise ValueError(f'{text!r} is no origin: expected one such as https://ui.example.org, or "null"')
    if not found["host"].startswith("["):
        _check_host_glob(found["host"])
    return text


HostGlobs = tuple[Annotated[str, AfterValidator(_check_host_glob)], ...]
"""Names of hosts, in which `*` stands for any characters, and addresses."""

OriginGlobs = tuple[Annotated[str, AfterValidator(_check_origin_glob)], ...]
"""Origins of web pages, in which `*` stands for any characters."""

HostName = Annotated[str, AfterValidator(_check_host)]
"""A name in lower case, or an address in its shortest form."""


#: Types of plain values, with the error of pydantic for others. TOML has these types; nothing is converted.
_PLAIN: Final[Mapping[object, tuple[tuple[type, ...], Literal["bool_type", "int_type", "float_type"]]]] = {
    bool: ((bool,), "bool_type"),
    int: ((int,), "int_type"),
    float: ((int, float), "float_type"),
}


class Table(BaseModel):
    """A group of settings: one table of the TOML file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @field_validator("*", mode="before")
    @classmethod
    def _has_the_type(cls, value: object, info: ValidationInfo) -> object:
        """Reject values that pydantic would convert, such as "yes" for a boolean."""
        field = cls.model_fields[str(info.field_name)]
        plain = _PLAIN.get(plain_type(field.annotation))
        if plain is None or (value is None and field.default is None):
            return value
        types, error = plain
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            raise PydanticKnownError(error)
        return value
