"""The engine: neighborhoods, their planes, and whose plane explains a point."""
