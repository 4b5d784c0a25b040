"""One training run: its data, its checkpoints, its history, its progress display."""
