"""Measured runs of real actuators: what the library says of each, and its error before and after on held-out parts.

`python -m pzt_benchmarks.measured` writes docs/measured.md; it needs the files of ../shared/data, which are never
copied into the project.
"""
