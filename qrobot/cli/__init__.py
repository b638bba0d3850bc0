"""The `qrobot` command: composition only."""
