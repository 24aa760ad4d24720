"""Effects hidden in the simulated rig: what, how large, and the sealed truth."""
