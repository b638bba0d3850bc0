"""The hardware interface: one register table, one memory layout, many transports to the board."""
