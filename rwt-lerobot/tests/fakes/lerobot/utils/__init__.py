"""Fake of `lerobot.utils`."""
