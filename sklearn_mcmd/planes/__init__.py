"""The engine: neighborhoods, their planes, and whose plane explains a point.

Stages and methods to compare with stand on it; nothing here is public.
"""

__all__ = []
