"""How a server fares with many clients, for long, in several processes, and what a fleet of robots takes."""
