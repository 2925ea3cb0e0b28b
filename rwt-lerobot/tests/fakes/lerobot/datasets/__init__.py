"""Fake of `lerobot.datasets`."""
