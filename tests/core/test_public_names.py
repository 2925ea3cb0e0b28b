"""Every public name of version 0.1 can still be imported: those of the reference and of the how-to pages."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Final

import pytest

NAMES: Final[dict[str, list[str]]] = json.loads(
    (Path(__file__).parent / "public_names.json").read_text(encoding="utf-8")
)


@pytest.mark.parametrize("module", NAMES)
@pytest.mark.filterwarnings("ignore:.* has moved to:DeprecationWarning")
def test_public_names_can_be_imported(module: str) -> None:
    imported = importlib.import_module(module)
    assert [name for name in NAMES[module] if not hasattr(imported, name)] == []


def test_an_alias_is_the_module_itself_and_warns(monkeypatch: pytest.MonkeyPatch) -> None:
    from rwt.extensions.depth_cloud import depth_image

    monkeypatch.delitem(sys.modules, "rwt.nodes.depth_cloud.depth_image", raising=False)
    with pytest.warns(DeprecationWarning, match=r"has moved to rwt\.extensions\.depth_cloud\.depth_image"):
        alias = importlib.import_module("rwt.nodes.depth_cloud.depth_image")
    assert alias is depth_image
    assert depth_image.__spec__ is not None
    assert depth_image.__spec__.name == "rwt.extensions.depth_cloud.depth_image"
