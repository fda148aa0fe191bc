"""How work runs: chunks and threads, progress and callbacks, interrupts, compiled functions."""
