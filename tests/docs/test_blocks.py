"""Parser of the blocks of a page; the pages themselves test the runner."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.blocks import blocks_of


def test_an_unknown_mark_is_an_error_that_names_its_place(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- runs: client -->\n```python\n```\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"page\.md:2: 'runs: client' is not a mark"):
        blocks_of(page)
