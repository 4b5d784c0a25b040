"""Processes that may be killed: fits, and bodies that only they may open."""
