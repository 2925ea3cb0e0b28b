"""Validation of values against their types: lenient decoding, numbers, descriptions of mismatches."""
