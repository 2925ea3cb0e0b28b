"""The reference of the ops is what the models say."""

from __future__ import annotations

import os
import subprocess
import sys

from rwt_graph import MemoryGraph
from rwt_nodes import Rosapi
from tests.docs.blocks import ROOT


def test_the_reference_of_the_ops_is_current() -> None:
    checked = subprocess.run(
        [sys.executable, str(ROOT / "tools" / "generate_protocol_reference.py"), "--check"],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_every_service_of_rosapi_is_listed() -> None:
    graph = MemoryGraph()
    with Rosapi(graph):
        offered = [service.name for service in graph.services() if service.name.startswith("/rosapi/")]
    own = [name for name in offered if "parameter" not in name]
    page = (ROOT / "docs" / "reference" / "protocol.md").read_text(encoding="utf-8")
    assert len(own) > 20
    assert [name for name in own if f"`{name.removeprefix('/rosapi/')}`" not in page] == []
