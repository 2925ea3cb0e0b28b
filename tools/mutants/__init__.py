"""Mutants of the source, drawn with a seed, and the tests that notice them."""
