"""Finite element batches: simulated pairs, Dask workers, sensitivities, material tests."""
