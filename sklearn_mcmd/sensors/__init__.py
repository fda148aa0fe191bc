"""Where the sensor stood: what its rays tell, and whether a cloud shows its position.

Estimators and the command line ask here, so there are no public names.
"""

__all__: list[str] = []
