"""The client for Python programs, and a blocking face over it. Nothing is in here yet."""
