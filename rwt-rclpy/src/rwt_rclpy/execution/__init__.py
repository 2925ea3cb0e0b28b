"""Execution of callbacks: contexts, executors, callback groups, futures, signals."""
