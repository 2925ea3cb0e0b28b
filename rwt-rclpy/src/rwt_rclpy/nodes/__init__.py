"""Nodes of programs in the graph."""
