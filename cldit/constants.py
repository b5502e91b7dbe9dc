"""Constants of nature, of units, and of the default fuel.

Those of nature are exact in the SI (BIPM, SI Brochure, 9th edition, 2019).
"""

PLANCK_J_s = 6.62607015e-34
LIGHT_SPEED_m_s = 299792458.0
BOLTZMANN_J_K = 1.380649e-23
AVOGADRO_PER_MOL = 6.02214076e23
GAS_CONSTANT_J_mol_K = 8.31446261815324  # AVOGADRO_PER_MOL * BOLTZMANN_J_K
SECOND_RADIATION_CONSTANT_m_K = PLANCK_J_s * LIGHT_SPEED_m_s / BOLTZMANN_J_K

STANDARD_ATMOSPHERE_Pa = 101325.0  # by definition (10th CGPM, 1954)
ZERO_CELSIUS_K = 273.15

HEPTANE_MOLAR_MASS_kg_mol = 0.100204  # C7H16, of the scenes' default fuel
