"""Simulated arms, and pictures of them. `pieper.sim.kinematic` needs nothing but NumPy; MuJoCo does the physics and draws."""
