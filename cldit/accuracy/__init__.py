"""Resolution chosen for tolerances; the errors of the image, estimated by source.

The tolerances are RMS errors of both results, T_app and emissivity. In here both are in kelvin:
those of emissivity are multiplied by `cldit.optics.tolerance.kelvin_per_emissivity`. `converge` is
the loop of adaptive finite elements: solve, estimate, refine.

1. Predict (`predict`). Coarse traces at one wavelength show which cells, classes of droplet size
   and lattice of the spray the tolerance needs; other sources get a share of it.
2. Solve (`converge.solve`). The scene is traced with this `Resolution`, which is a type of its own:
   scene and resolution together give the settings of a trace, and the scene is never changed. A
   coarse trace of the chosen cells is the image, and is only audited.
3. Estimate (`sources`). Each source of error is varied alone, and the image compared with that of
   the run. Independent sources add up in squares.
4. Refine (`converge.refine`). If the sum exceeds the tolerance, sources above their share get a
   finer resolution, at most twice. A refinement that makes the error larger is discarded.

Terms of the field, and where they are:

- Error allocation (`allocation`): shares of the square of the tolerance with the least cost.
- Richardson extrapolation (`richardson`): the error on the finest of three grids.
- Independent halves (`image_pair`): differences of two images without the noise of either.

Keys that omit physics (`sources.omissions`) are rows of a table. Any other source is a class with
`name`, `key`, `cost_power`, `estimate` and `finer`; a new one needs an entry of `SOURCES` alone.
"""
