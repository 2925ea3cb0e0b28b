"""Conversion between recordings and LeRobot's datasets."""
