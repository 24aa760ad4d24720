"""Input and output: tables, descriptions, meshes, materials, settings, caches."""
