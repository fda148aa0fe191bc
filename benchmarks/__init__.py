"""Measurements: scripts (``python benchmarks/bench_normals.py``), and the first paper's tables."""
