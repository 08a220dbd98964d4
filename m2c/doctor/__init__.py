"""What works on this host, what is missing, and the command that mends it."""
