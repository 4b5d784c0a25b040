"""How the service runs: as a command on a socket, in a process of its own, or in this process."""
