"""Ready-made nodes, written on the public graph API as a user would write them."""
