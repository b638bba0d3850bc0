"""The path of one arm: pieces and their transitions, in coordinates in which they are straight."""
