"""What robot programs are written with: nodes, their endpoints, goals and timers."""
