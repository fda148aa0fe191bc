"""How work runs: chunks and threads, progress, interrupts, compiled functions.

All rooms stand on it; nothing here is public.
"""

__all__ = []
