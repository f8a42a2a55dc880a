"""The compiled kernels and their checked-in stub (``kernels.pyi``)."""
