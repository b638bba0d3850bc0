"""Fences: distances between the body of an arm and what it keeps out of, or inside which it stays."""
