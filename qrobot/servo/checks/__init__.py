"""Protection of the arm: limit checks of inputs and outputs, monitors of faults, and their names."""
