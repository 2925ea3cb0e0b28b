"""Nodes of robot programs, with their endpoints, services and goals."""
