"""Endurance and scaling: many clients, long runs, several processes, fleets of robots."""
