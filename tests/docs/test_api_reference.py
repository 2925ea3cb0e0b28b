"""The pages of the packages are what their docstrings say, and leave no public name out."""

from __future__ import annotations

import re

import pytest

from tools import generate_api


@pytest.mark.parametrize("package", generate_api.PACKAGES)
def test_every_public_name_says_what_it_is(package: str) -> None:
    page = (generate_api.TARGET / f"{package}.md").read_text(encoding="utf-8")
    empty = []
    for name, text in re.findall(r"^## `(\w+)`\n(.*?)(?=^##? |\Z)", page, re.MULTILINE | re.DOTALL):
        described = r"^(?!Types: )[A-Z0-9>*`\[](?!class |exception |enum |\w+\().*\w"
        if not re.search(described, text, re.MULTILINE):
            empty.append(name)
    assert empty == []


def test_types_are_links() -> None:
    page = (generate_api.TARGET / "rwt_client.md").read_text(encoding="utf-8")
    assert re.search(r"^`connect\(.*Robot.*`\n\nTypes: .*\[`Robot`\]\(#robot\)", page, re.MULTILINE)
    assert "[`Limits`](rwt_transports.md#limits)" in page
