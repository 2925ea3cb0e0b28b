"""Generators of Python and TypeScript types from definitions."""
