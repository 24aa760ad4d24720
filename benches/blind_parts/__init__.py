"""Parts of the blind benchmark: a second generator, sets, simpler methods, scores.

`rod*.py` make data without any code of the library: a Cosserat rod of their own.
"""
