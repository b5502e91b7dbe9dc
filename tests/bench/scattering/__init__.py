"""Error of plain DIT by light of the walls, and of evaluations that correct it.

The truth is simulated: the emitting temperatures are known in every pixel of one trace. It is
evaluated in arrangements of walls, backgrounds and filters, and with correct and wrong models.
"""
