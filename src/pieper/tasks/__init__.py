"""What an arm is there for: pick and place, with the arm, its simulator and what a camera sees."""
