"""Control laws: what makes torques out of what the servo reads and what it is asked to follow."""
