"""Nodes: what a program joins the graph as."""
