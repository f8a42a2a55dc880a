"""The command ``pieper``, one file per verb. Nothing here imports NumPy before a verb has work to do."""
