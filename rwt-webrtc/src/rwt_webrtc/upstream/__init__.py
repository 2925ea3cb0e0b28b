"""Subclasses of aiortc's and aioice's classes, one module for each; no other module uses a private name.

aiortc is pinned below 1.17 and aioice below 0.14. Each module lists the private names that it uses, each with
the reason, and `tests/upstream` of this distribution checks every one against the pinned releases. Drafts of
the hooks that would replace them are in `contrib/upstream` of the repository.
"""
