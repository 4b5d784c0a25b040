"""Worker processes: what may crash or take too much memory runs in one, not in the server."""
