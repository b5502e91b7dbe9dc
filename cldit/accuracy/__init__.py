"""Resolution chosen for a tolerance; the error of the image, estimated by source.

The tolerance is `transport.accuracy_K`, an RMS error of T_app. `converge` is the loop of adaptive
finite elements: solve, estimate, refine.

1. Predict (`predict`). Coarse traces at one wavelength show which cells, ordinates, wavelengths,
   classes of droplet size and lattice of the spray the tolerance needs.
2. Solve (`converge.solve`). The scene is traced with this `Resolution`, which is a type of its own:
   scene and resolution together give the settings of a trace, and the scene is never changed.
3. Estimate (`sources`). Each source of error is varied alone, and the image compared with that of
   the run. Independent sources add up in squares.
4. Refine (`converge.refine`). If the sum exceeds the tolerance, sources above their share get a
   finer resolution, at most twice. A refinement that makes the error larger is discarded.

Terms of the field, and where they are:

- Error allocation (`allocation`): the squares of the sources' errors sum to the square of the
  tolerance. The shares with the least cost are proportional to the powers with which the cost of
  each source grows. What the scene fixes takes no share, and bounds what is worth the cost.
- Richardson extrapolation (`richardson`): the error on the finest of three grids, by the observed
  order of convergence. Outside the asymptotic range no order is inferred, and first order is
  assumed.
- Independent halves (`image_pair`): every image is the mean of two images with independent
  ordinates and paths. Products of the halves' differences are free of noise on average, so that a
  systematic difference is separated from the noise of both images.
- Importance sampling (`drawn_pixels`): of a large image few pixels are traced for the estimates,
  each with a known chance, which makes sums over them unbiased.

Keys that omit physics (`sources.omissions`) are rows of a table: the image is compared with one
that omits nothing. Any other source is a class with `name`, `key`, `cost_power`, `estimate` and
`finer`; a new one needs an entry of the list `SOURCES`, and nothing else changes.
"""
