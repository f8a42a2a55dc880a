"""Simulated arms, and pictures of them. `pieper.sim.kinematic` needs nothing but NumPy; MuJoCo draws pictures."""
