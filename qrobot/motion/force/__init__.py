"""Force control: joints that give way, and what the arm exerts on the world."""
