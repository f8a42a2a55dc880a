"""A robot as data: descriptions in (URDF, xacro, DH, screws) and the chain that every computation takes."""
