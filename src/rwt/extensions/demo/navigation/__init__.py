"""Navigation of the demo robot: path planning and following."""
