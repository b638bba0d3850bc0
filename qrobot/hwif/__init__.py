"""The hardware interface: one register table, one memory layout, many roads to the board."""
