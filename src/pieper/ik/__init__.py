"""Inverse kinematics: joint values that bring the tip of an arm to a target, and how well they do."""
