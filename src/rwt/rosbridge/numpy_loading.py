"""Import of numpy in a thread, because it takes a tenth of a second."""

from __future__ import annotations

import re
import sys
import threading
from importlib import import_module
from typing import Final

from rwt.gateways.base import LARGE_BYTES
from rwt_protocol.frames import Buffer
from rwt_protocol.limits import has_more_brackets

_NUMBERS: Final = re.compile(rb"\xd8[\x41-\x57]")
"""CBOR tags of typed arrays except octets (RFC 8746)."""

_MANY_BRACKETS: Final = 64 * 1024


class NumpyLoading:
    """Imports numpy in a thread when the first message needs it."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self.is_over = False

    def holds_up(self, data: Buffer, binary: bool) -> bool:
        """Return True if a message has to wait until numpy is loaded."""
        if self.is_over or len(data) <= LARGE_BYTES:
            return False
        if self._thread is None:
            if "numpy" in sys.modules:
                self.is_over = True
                return False
            if not _needs_numpy(bytes(data), binary):
                return False
            self._thread = threading.Thread(target=_load, name="numpy", daemon=True)
            self._thread.start()
        self.is_over = not self._thread.is_alive()
        return not self.is_over


def _load() -> None:
    try:
        import_module("numpy")
    except ImportError:
        return  # The code that needs numpy reports the error.


def _needs_numpy(data: bytes, binary: bool) -> bool:
    if binary:
        return _NUMBERS.search(data) is not None
    return has_more_brackets(data, _MANY_BRACKETS)
