"""Composition root: settings in, a running server out."""
