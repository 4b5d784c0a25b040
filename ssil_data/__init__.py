"""Which demonstrations can be trusted: leverage, LCoR and the store they live in."""
