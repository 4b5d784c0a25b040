"""Bytes to arrays and back: JSON, Arrow, Parquet, tensors. No request and no context."""
