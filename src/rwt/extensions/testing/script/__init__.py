"""Robots scripted in a file."""
