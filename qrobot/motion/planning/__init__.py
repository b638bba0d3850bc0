"""Planning of segments from requests: the way, its times, the transitions, and the ways to stop."""
