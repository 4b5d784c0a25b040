"""The REST service over a store; empty until its first route lands."""
