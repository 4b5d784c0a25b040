"""Collecting demonstrations: the expert, worse drivers, quality tiers, and the dataset's card."""
