from __future__ import annotations

import subprocess
import sys


def test_importing_the_graph_loads_no_heavy_library() -> None:
    heavy = "{'numpy', 'pydantic', 'trio', 'PIL', 'cbor2'}"
    code = f"import sys, rwt_graph; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
