"""The servo daemon: read, estimate, interpolate, law, guard, write, in one compiled cycle."""
