"""`python -m qrobot` is the `qrobot` command."""

from qrobot.cli.main import main

if __name__ == "__main__":
    main()
