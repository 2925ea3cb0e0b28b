"""Parser of the blocks of a page; the pages themselves test the runner."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.blocks import blocks_of

_PAGE = """\
# Title

<!-- run: client; prints: one
prints: two; noetic: yes -->
```python
print("one")
```

```js
unmarked()
```

<!-- a remark that stands on its own -->

1. In a list:

   ```sh
   true
   ```
"""


def test_marks_belong_to_the_block_right_below(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(_PAGE, encoding="utf-8")
    python, js, shell = blocks_of(page)
    assert (python.language, python.line, python.code) == ("python", 5, 'print("one")\n')
    assert python.value("run") == "client"
    assert python.values("prints") == ["one", "two"]
    assert python.value("noetic") == "yes"
    assert (js.language, js.marks) == ("js", ())
    assert (shell.language, shell.marks) == ("sh", ())


def test_an_unknown_mark_is_an_error_that_names_its_place(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- runs: client -->\n```python\n```\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"page\.md:2: 'runs: client' is not a mark"):
        blocks_of(page)
