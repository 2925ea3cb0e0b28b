"""Pictures of topics as a browser shows them."""
