"""Handlers of rosbridge's ops; each translates an op into verbs of the graph."""
