"""How the service runs: the command, the socket, and the service without one."""
