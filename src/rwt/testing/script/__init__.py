"""Robots that do what a file says."""
