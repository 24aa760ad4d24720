"""Effects in the coordinates that exist: for tables without all six poses and six wrenches.

A form here has the id of its effect in the catalogue, and takes its place where columns are fewer.
"""
