"""The servo daemon: from the board's image to its torque, in one compiled cycle."""
