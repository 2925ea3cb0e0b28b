"""Scripted robots, their topics, services and actions."""
