"""The table in the documentation is what the cases say."""

from __future__ import annotations

from tests.core.transports.rfc6455.__main__ import PAGE, with_table


def test_the_table_in_the_documentation_is_current() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert with_table(page) == page, "run `python -m tests.core.transports.rfc6455` and commit the page"
    assert "NOT as required" not in page
