"""Environments, demonstration collection and training methods that stand on ssil_data."""
