"""Audit log of the gate: budget per client, file with a hash chain, and its verification."""
