"""Materials to build rods of: typical values, for a first design; what is bought has a data sheet of its own."""

from pcm_gym.mechanism.rod import Material

SPRING_STEEL = Material(modulus=200e9, yield_stress=1.0e9, density=7850.0)
"""Cold-rolled spring steel, hardened and tempered, in round numbers.

AISI 301 in spring temper yields at 1014 MPa and 50CrV4 at 1200 MPa (yield strengths as listed in Wikipedia, "Spring
steel"); the modulus of carbon spring steel is 191 (GOST 14959-79, grade 75) to 206 GPa (as spring makers reckon)."""

NITINOL = Material(modulus=83e9, yield_stress=379e6, density=6450.0)
"""Superelastic nickel-titanium, austenite at room temperature, as far as it is linear.

Modulus and density: Shape Memory Applications Inc., "Selected properties of NiTi". Stress: the upper superelastic
plateau of Special Metals Corporation, publication SMC-017 (1999). Beyond it the alloy comes back from strains of 6 %,
but no longer follows Hooke's law."""

FIBREGLASS = Material(modulus=25e9, yield_stress=400e6, density=1800.0)
"""Pultruded glass-fibre reinforced polyester, along its fibres: flexural modulus, flexural strength, density.

Mean values of Top Glass, "Technical data", standard polyester; they are above the least ones of EN 13706-3, grade E23
(23 GPa and 240 MPa). It breaks where metals yield."""
