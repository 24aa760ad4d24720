"""The site of the documentation: pages are staged, generated ones added, and zensical builds it."""
