"""What protects the arm: limit checks of inputs and outputs, monitors of faults, and what they are called."""
