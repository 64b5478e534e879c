"""What numba compiles: vectorisable elementary functions, random numbers, row buffers."""
