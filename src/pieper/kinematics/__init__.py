"""Forward kinematics, Jacobians and what they tell: where an arm is, how it moves, and where it gets stuck."""
