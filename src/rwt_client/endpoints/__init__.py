"""Endpoints of a client: topics, services, actions, transforms and types."""
