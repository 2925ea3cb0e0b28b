"""Audit log of the gate: file with a hash chain, and its verification."""
