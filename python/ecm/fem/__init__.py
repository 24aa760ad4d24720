"""Finite element batches: simulated pairs, Dask workers, material tests."""
