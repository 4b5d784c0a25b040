"""Who may ask: API keys, and the host names that are answered without them."""
