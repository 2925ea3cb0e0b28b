"""Each package can be imported alone, and none of them drags in what it may not know."""

from __future__ import annotations

import subprocess
import sys

import pytest

PACKAGES = {
    "rwt_interfaces": {"rwt_protocol", "rwt_graph", "rwt_transports", "anyio", "asyncio", "numpy", "cbor2"},
    "rwt_tf2": {"rwt_interfaces", "rwt_protocol", "rwt_graph", "anyio", "asyncio", "numpy", "msgspec"},
    "rwt_protocol": {"rwt_interfaces", "rwt_graph", "anyio", "numpy", "PIL", "cbor2", "websockets", "h11"},
    "rwt_program": {"rwt_protocol", "rwt_graph", "rwt_transports", "numpy", "websockets"},
    "rwt_graph": {"rwt_protocol", "rwt_transports", "rwt_bridge", "numpy", "websockets"},
    "rwt_transports": {"rwt_interfaces", "rwt_graph", "rwt_bridge", "numpy"},
    "rwt_bridge": {"rwt_nodes", "rwt_client", "rwt_cli", "numpy", "PIL"},
    "rwt_http": {"rwt_bridge", "rwt_nodes", "rwt_client", "rwt_cli", "numpy", "PIL"},
    "rwt_mcp": {"rwt_bridge", "rwt_http", "rwt_nodes", "rwt_client", "rwt_cli", "mcp", "numpy", "PIL"},
    "rwt_nodes": {"rwt_bridge", "rwt_client", "rwt_cli", "numpy", "PIL"},
    "rwt_web": {"rwt_graph", "rwt_nodes", "rwt_bridge", "rwt_interfaces", "numpy", "PIL"},
    "rwt_client": {"rwt_bridge", "rwt_graph", "rwt_nodes", "rwt_cli"},
    "rwt_testing": {"rwt_client", "rwt_nodes", "rwt_cli", "pytest", "numpy", "PIL"},
    "rwt_cli": {"rwt_testing", "rwt_pytest"},
    # pytest imports it in every run, of everybody's tests.
    "rwt_pytest": {"rwt_testing", "rwt_cli", "rwt_graph", "rwt_interfaces", "anyio", "numpy", "pydantic"},
}


@pytest.mark.parametrize("package", PACKAGES)
def test_alone(package: str) -> None:
    program = f"import {package}, sys; print(' '.join(name for name in sys.modules if '.' not in name))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not PACKAGES[package] & set(done.stdout.split())
