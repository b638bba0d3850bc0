"""The trajectory under way: how far the arm is, what comes next, and what happened."""
