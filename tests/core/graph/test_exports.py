from __future__ import annotations

import subprocess
import sys

import rwt_graph


def test_every_exported_name_is_there_once() -> None:
    assert len(set(rwt_graph.__all__)) == len(rwt_graph.__all__)
    for name in rwt_graph.__all__:
        assert hasattr(rwt_graph, name)


def test_importing_the_graph_loads_no_heavy_library() -> None:
    heavy = "{'numpy', 'pydantic', 'trio', 'PIL', 'cbor2'}"
    code = f"import sys, rwt_graph; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
