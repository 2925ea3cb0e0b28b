"""rosbridge v2 as types and bytes: ops, encodings, one peer's session, the dispatcher. No I/O."""
