from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import rwt_graph


def test_every_module_says_what_it_exports() -> None:
    for info in pkgutil.iter_modules(rwt_graph.__path__):
        module = importlib.import_module(f"rwt_graph.{info.name}")
        for name in getattr(module, "__all__", []):
            assert hasattr(module, name), f"{info.name}.{name}"
    assert len(set(rwt_graph.__all__)) == len(rwt_graph.__all__)
    for name in rwt_graph.__all__:
        assert hasattr(rwt_graph, name)


def test_importing_the_graph_loads_no_heavy_library() -> None:
    heavy = "{'numpy', 'pydantic', 'trio', 'PIL', 'cbor2'}"
    code = f"import sys, rwt_graph; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
