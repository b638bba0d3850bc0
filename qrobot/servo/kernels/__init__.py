"""Numerics of the cycle that judge nothing: interpolation, velocity, the converter, the force sensor."""
