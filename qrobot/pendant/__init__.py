"""The teach pendant: a page in a browser on the arm's machine, to look at arms and to drive them."""
