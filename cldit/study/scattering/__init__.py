"""How much better than plain DIT an evaluation is that knows about scattering, and where it fails.

The truth is simulated: of one trace, the temperatures that emit are known in every pixel. It is
then evaluated in arrangements of walls, backgrounds and filters, and with models of the spray that
are right and that are wrong.
"""
