"""Simulated arms. `pieper.sim.kinematic` needs nothing but NumPy."""
