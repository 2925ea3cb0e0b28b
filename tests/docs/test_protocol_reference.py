"""The reference of the ops is what the models say."""

from __future__ import annotations

import os
import subprocess
import sys

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
