"""What queries need: datasets and fields in memory, batching, and a bounded executor."""
