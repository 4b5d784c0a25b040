"""Access: API keys, and Host and Origin checks where there are none."""
