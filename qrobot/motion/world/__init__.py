"""World of a motion: transforms, position equations, the arm's kinematics and its limits."""
