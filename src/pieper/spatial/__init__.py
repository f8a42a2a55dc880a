"""Rotations, poses, twists and angles as plain arrays. This room knows no robot.

``rotation`` converts, ``pose`` composes and compares, ``twist`` holds exp, log and adjoint of SE(3), ``angle`` wraps.
Each is imported by its own name, so that ``pieper.spatial.twist`` needs NumPy alone.
"""
