"""What is fast, and against whom: figures as ratios to a reference measured in the same run."""
