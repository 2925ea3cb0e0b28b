"""The handlers of rosbridge's ops: each turns an op into verbs of the graph."""
