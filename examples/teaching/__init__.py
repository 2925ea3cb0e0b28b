"""People who teach robots at the same time over one server: its side, theirs, and what is told of it.

Each part runs in a process of its own; `examples/demonstrations.py` starts them.
"""
