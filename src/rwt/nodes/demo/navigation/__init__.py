"""How the demo robot finds and follows its way."""
