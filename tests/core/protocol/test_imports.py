"""Modules and time that importing the package costs."""

from __future__ import annotations

import subprocess
import sys

_REPORT = "import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
_OURS = "import rwt_protocol.session, rwt_protocol.dispatcher, rwt_protocol.codecs, rwt_protocol.profiles; "

#: Of the standard library, and light.
_LIGHT = {"difflib", "gc", "_heapq", "heapq", "rwt_protocol"}


def loaded(program: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_it_loads_what_pydantic_and_msgspec_load() -> None:
    base = loaded("import pydantic, msgspec; class_ = pydantic.create_model('M', x=(int, 1)); " + _REPORT)
    ours = loaded(_OURS + _REPORT)
    assert ours - base <= _LIGHT
    assert not ours & {"anyio", "trio", "websockets", "numpy", "PIL", "cbor2", "pybase64"}
