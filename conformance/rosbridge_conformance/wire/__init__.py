"""How the suite speaks to what it grades: transports and encodings of its own."""
