"""Scoring jobs: a queue that survives the server."""
