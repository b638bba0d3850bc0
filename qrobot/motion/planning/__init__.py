"""From requests to segments: the way, its times, the transitions, and the ways to stop."""
