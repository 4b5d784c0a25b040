"""Scoring jobs: accepted durably, run in worker processes, found again after a crash."""
