"""MkDocs hooks of the documentation site.

- A folder in the table of contents (`how-to/`) stands for its pages, by their titles.
- Pages that lie above `docs/` (the changelog, the bench) are part of it, and links to them lead there.
- A link to any other file of the repository is its path.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
ABOVE = {
    "CHANGELOG.md": "CHANGELOG.md",
    "CODE_OF_CONDUCT.md": "contributing/CODE_OF_CONDUCT.md",
    "SECURITY.md": "contributing/SECURITY.md",
    "bench/README.md": "contributing/bench.md",
}
"""Pages outside of `docs/`, and where they are in the site."""

_LINK = re.compile(r"(?<!!)\[((?:[^\]\[]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_FENCED = re.compile(r"(^ *```.*?^ *```$)", re.MULTILINE | re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of a folder where the table of contents names the folder."""
    docs = Path(config.docs_dir)
    config.nav = [_expanded(entry, docs) for entry in config.nav or ()]
    return config


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that lie above `docs/`."""
    for source, target in ABOVE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        if source == "CHANGELOG.md":  # Its many words would come before every page about them.
            text = f"---\nsearch:\n  exclude: true\n---\n{text}"
        files.append(File.generated(config, target, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links that leave `docs/` to what the site has of them."""
    sources = {target: source for source, target in ABOVE.items()}
    here = page.file.src_uri
    source = ROOT / sources[here] if here in sources else ROOT / "docs" / here
    pieces = _FENCED.split(markdown)
    pieces[::2] = [_LINK.sub(lambda link: _link(link, source, here), text) for text in pieces[::2]]
    return "".join(pieces)


def _expanded(entry: Any, docs: Path) -> Any:
    """An entry of the table of contents, with the pages of its folder if it names one."""
    if not isinstance(entry, dict):
        return entry
    ((title, value),) = entry.items()
    if not (isinstance(value, str) and value.endswith("/")):
        return entry
    return {title: _pages_of(docs / value, docs)}


def _pages_of(folder: Path, docs: Path) -> list[Any]:
    """The pages of a folder, its own first, then by title, then the folders in it."""
    above = [target for target in ABOVE.values() if (docs / target).parent == folder]
    pages = [str(page.relative_to(docs)) for page in folder.glob("*.md")] + above
    pages.sort(key=lambda page: (not page.endswith("/README.md"), page))
    inner = sorted(path for path in folder.iterdir() if path.is_dir() and any(path.glob("*.md")))
    return [*pages, *({path.name.upper(): _pages_of(path, docs)} for path in inner)]


def _link(link: re.Match[str], source: Path, here: str) -> str:
    """A link as the site needs it."""
    text, target = link.groups()
    path, _, fragment = target.partition("#")
    if not path or re.match(r"[a-z]+:", target):
        return link[0]
    aim = (source.parent / path).resolve()
    if not aim.is_relative_to(ROOT):
        return link[0]
    inside = str(aim.relative_to(ROOT))
    if inside in ABOVE:
        site = ABOVE[inside]
    elif aim.is_relative_to(ROOT / "docs") and aim.is_file():
        site = str(aim.relative_to(ROOT / "docs"))
    else:
        return f"{text} (`{inside}`)"
    up = "../" * here.count("/")
    return f"[{text}]({up}{site}{'#' + fragment if fragment else ''})"
