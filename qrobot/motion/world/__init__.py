"""What a motion is about: transforms, position equations, the arm's kinematics and its limits."""
