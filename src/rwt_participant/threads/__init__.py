"""Other threads than the event loop's: messages that they publish, and handlers that run in them."""
