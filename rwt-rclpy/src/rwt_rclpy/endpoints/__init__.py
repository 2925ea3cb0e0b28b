"""Endpoints of nodes: publishers, subscriptions, services, clients, and their quality of service."""
