"""Robot files to and from the formats of other programs: URDF both ways, Denavit-Hartenberg tables out."""
