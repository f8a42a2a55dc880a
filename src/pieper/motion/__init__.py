"""How joints get from here to there: limits, trajectories and moves. This room knows no simulator and no network."""
