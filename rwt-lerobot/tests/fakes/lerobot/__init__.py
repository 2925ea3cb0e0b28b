"""Fake of the part of LeRobot that plugins use: base classes, registries and factories, without torch."""
