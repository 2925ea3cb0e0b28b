"""Scripted robots: what they offer, and what they do when called."""
