"""Constants of nature; the first two are exact in the SI (BIPM, SI Brochure, 9th edition, 2019)."""

AVOGADRO_PER_MOL = 6.02214076e23
GAS_CONSTANT_J_mol_K = 8.31446261815324  # Avogadro's constant times Boltzmann's
STANDARD_ATMOSPHERE_Pa = 101325.0  # by definition (10th CGPM, 1954)
