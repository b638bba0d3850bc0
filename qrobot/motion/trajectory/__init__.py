"""The trajectory under way: how far the arm is, what comes next, what happened, and whether a setpoint may go out."""
