"""The types of settings that several groups of them share."""

from __future__ import annotations

import ipaddress
import re
from contextlib import suppress
from typing import Annotated, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

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


HostName = Annotated[str, AfterValidator(_check_host)]
"""A name in lower case, or an address in its shortest form."""


class Table(BaseModel):
    """A group of settings: one table of the TOML file."""

    model_config = ConfigDict(frozen=True, extra="forbid")
