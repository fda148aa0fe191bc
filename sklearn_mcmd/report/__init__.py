"""Reports of the command line: pages that say in words, numbers and maps what a verb did.

The command line alone makes them, so there are no public names here.
"""

__all__ = []
