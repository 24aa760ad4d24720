"""The main job: the paper's three steps as stages, and the loop after them."""
