"""Planning of segments from requests: the way, its times, the transitions, ways to stop, and the check of setpoints."""
