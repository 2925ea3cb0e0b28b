"""Writes messages and parameters as YAML, as the ``ros2`` tool prints them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final

from rwt_cli.console.yaml_reader import YamlValue, scalar

_ESCAPED: Final = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
_PLAIN: Final = re.compile(r"[A-Za-z0-9_./+(~^$\\<=;-][^\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff]*")
#: What YAML 1.1 takes for something else than text: numbers with _ or :, dates, <<, =.
_TEXT_IN_1_2_ONLY: Final = re.compile(
    r"[-+]?[0-9][0-9_:.]*|[-+]?\.[0-9_]*|[-+]?0[xb][0-9a-fA-F_]*|[0-9-]+([Tt \t].*)?|<<|=|[-+]?[0-9_.]+[eE].*"
)


def block(value: YamlValue, indent: str = "") -> Iterator[str]:
    """The lines of a value, a line for each member and item."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from _member(f"{indent}{text_of(key)}:", item, indent)
    elif isinstance(value, list) and value:
        for item in value:
            first, *others = block(item, f"{indent}  ")
            yield f"{indent}- {first.removeprefix(f'{indent}  ')}"
            yield from others
    else:
        yield f"{indent}{flow(value)}"


def _member(head: str, item: YamlValue, indent: str) -> Iterator[str]:
    if isinstance(item, dict | list) and item:
        yield head
        yield from block(item, f"{indent}  " if isinstance(item, dict) else indent)
    else:
        yield f"{head} {flow(item)}"


def flow(value: YamlValue) -> str:
    """A value on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{text_of(key)}: {flow(item)}' for key, item in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float):
        return _float(value)
    return text_of(value) if isinstance(value, str) else str(value)


def _float(value: float) -> str:
    if math.isnan(value):
        return ".nan"
    if math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    text = repr(value)
    # YAML 1.1 takes 1e-07 for a text.
    return text.replace("e", ".0e", 1) if "e" in text and "." not in text else text


def text_of(text: str) -> str:
    """A text as a scalar: plain if it reads back as that text, else in quotes."""
    if _is_plain(text):
        return text
    if text.isprintable():
        return "'" + text.replace("'", "''") + "'"
    return f'"{"".join(map(_escaped, text))}"'


def _escaped(character: str) -> str:
    if character in _ESCAPED:
        return _ESCAPED[character]
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _is_plain(text: str) -> bool:
    return (
        bool(_PLAIN.fullmatch(text))
        and text.isprintable()
        and text == text.strip()
        and scalar(text) == text
        and not _TEXT_IN_1_2_ONLY.fullmatch(text)
        and not text.startswith(("- ", "---", "..."))
        and text != "-"
        and ": " not in text
        and " #" not in text
        and not text.endswith(":")
        and not any(c in text for c in ",[]{}")
    )
