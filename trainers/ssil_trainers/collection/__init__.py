"""Collecting demonstrations: who drives, how well, and what is kept."""
