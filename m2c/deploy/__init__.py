"""How a system gets onto the computers that run it: `m2c deploy`."""
